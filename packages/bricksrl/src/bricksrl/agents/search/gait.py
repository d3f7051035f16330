"""Policy search as a learner: the few numbers of a structured policy, tried on the robot.

A trial acts by one set of numbers for some steps, without a reset; its score is the mean reward
once the robot has settled. `brickhub.search` proposes the numbers. Where it can, the robot's hub
makes a trial by itself, and each step of the environment takes what the hub tells of it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.fields import check_fields
from brickhub.search.bayesian_search import BayesianSearch, trial_score
from brickhub.user_files import NotCode
from bricksrl.agents.learner import Learner
from bricksrl.agents.search.structures import (
    STRUCTURES,
    StructuredActor,
    hub_structure,
    make_structure,
)
from bricksrl.agents.settings import NotNegative, Positive, Presets, Range
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.hub_policy import HubPolicy, most_steps
from bricksrl.envs.rollout import lost_links
from bricksrl.envs.task import never
from bricksrl.envs.transforms import keeps_vectors, layout_of, steps_of
from bricksrl.errors import CheckpointError, DescriptionError, counted


@dataclass(frozen=True)
class GaitSettings:
    """Settings of policy search."""

    structure: Annotated[str, NotCode(tuple(STRUCTURES))] = ""
    """oscillators (legs held at phases), approach (a speed by a distance), upright (two wheels in
    balance), edge (of a line), linear (feedback), or FILE.py:NAME; by default oscillators where
    there are legs."""
    trial_steps: Annotated[int, Range(1)] = 10
    """Steps of a trial."""
    settle_steps: Annotated[int, NotNegative] = 3
    """First steps of a trial, which do not count."""
    random_trials: Annotated[int, Range(1)] = 6
    """Trials spread over all numbers before the first proposal."""
    optimism: Annotated[float, NotNegative] = 2.0
    """Standard deviations by which an unknown score is taken to be better than expected."""
    caution: Annotated[float, NotNegative] = 0.3
    """Standard deviations by which other numbers must be better than the best known to replace
    them."""
    tilt_deg: Annotated[float, Positive] = 35.0
    """Pitch or roll that ends a trial at once; it then scores no more than the worst trial, as one
    that ends without success."""

    falls_late: bool = False
    """Whether a trial that ends early is as good as its steps, and each that it lacks counts as 0:
    where to fall late is better than soon. Else it is no better than the worst trial."""
    on_hub: bool = True
    """Whether the hub makes each trial by itself, where it can; else this computer sends each
    step's commands."""

    def __post_init__(self) -> None:
        check_fields(type(self), vars(self))
        if self.settle_steps >= self.trial_steps:
            raise DescriptionError(
                f"settle_steps is {self.settle_steps}; give fewer than the {self.trial_steps} "
                "of a trial"
            )


PRESETS = {"gait": Presets(GaitSettings(), images=GaitSettings(), paper=GaitSettings())}


@dataclass(kw_only=True)
class PolicySearch(Learner):
    """A learner that searches the numbers of ``actor``'s structure, on one robot or on copies that
    try the same.

    Attributes:
        search: proposes numbers, and knows the trials so far.
        tilts: indices of pitch and roll in the observation.
        succeeds: success of an episode that ends with these observations ``[*batch, 1, n]``; others
            end in a fall or the like.
        updates: trials that a proposal has been made from.
        rewards: of the present trial.
    """

    on_policy: ClassVar[bool] = True

    actor: StructuredActor
    settings: GaitSettings
    search: BayesianSearch
    tilts: list[int]
    succeeds: Callable[[Tensor], Tensor]
    updates: int = field(default=0, init=False)
    rewards: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._act_as_proposed()

    def _act_as_proposed(self) -> None:
        """Let the actor know what to try, and what is best."""
        self.actor.trial.copy_(torch.tensor(self.search.ask()))
        self.actor.best.copy_(torch.tensor(self.search.best))

    @property
    def needs_hub(self) -> bool:
        """Whether the structure is of no use but on the robot's hub."""
        return bool(getattr(self.actor.structure, "needs_hub", False))

    def use_hub_of(self, env: EnvBase) -> str:
        """Let the robot's hub make each trial by itself, if it can. Returns a line that says so, or
        why not."""
        # A simulation has neither a hub nor a link.
        if not interface_of(env).robots:
            return ""
        reason = self._by_steps_because(env)
        if reason:
            return f"trials are made step by step from here, as {reason}"
        interface_of(env).act_by_trials(self._hub_policy())
        return "the hub makes each trial by itself, by numbers that are sent once"

    def _by_steps_because(self, env: EnvBase) -> str:
        """Why the computer has to act step by step, in a clause; "" if the hub can."""
        ours = interface_of(env)
        if not self.settings.on_hub:
            return "on_hub is false"
        if ours.connect_to is None or ours.task is None:
            return ours.by_steps_because
        if hub_structure(self.actor) is None:
            return "the hub does not know this structure"
        most = most_steps(ours.task.interface)
        if self.settings.trial_steps > most:
            return f"a hub makes {most} of these steps in a trial at most"
        counts_on = any(channel.accumulates for channel in ours.task.interface.channels)
        # A hub counts from the start of a trial, and an environment from that of an episode.
        if counts_on and self.settings.trial_steps < ours.task.max_steps:
            return "it observes what counts from the start of an episode"
        return ""

    def _hub_policy(self) -> HubPolicy:
        """The actor's policy, as a hub acts by it."""
        single = hub_structure(self.actor)
        assert single is not None  # noqa: S101
        # The policy acts by a copy, with the same tensors.
        actor = next(one for one in self.acting.modules() if isinstance(one, StructuredActor))

        def next_trial() -> tuple[list[float], int | None]:
            numbers: list[float] = []
            for number, entry in zip(actor.acted_by.tolist(), single.numbers, strict=True):
                # In 32 bits, an end of a range may be a little beyond it.
                numbers.append(min(max(number, entry.low), entry.high))
            return numbers, self.settings.trial_steps if actor.is_trial else None

        return HubPolicy(
            single.numbers,
            single.hub_source(),
            self.settings.tilt_deg,
            next_trial,
        )

    def remember(
        self,
        frames: TensorDictBase,
        robot: int = 0,
    ) -> None:
        """Add frames ``[time]`` or ``[copies, time]`` to the trial; the reward is the mean over the
        copies."""
        # a trial with a gap has no score: nobody knows what the robot did meanwhile
        lost = lost_links(frames)
        if lost is not None and bool(lost.any()):
            self.end_episodes()
            return
        for frame in frames.unbind(-1):
            self.rewards.append(float(frame["next", "reward"].mean()))
            observation = frame["next", "observation"]
            ended = bool(frame["next", "terminated"].any())
            tilts = observation[..., self.tilts].abs() > self.settings.tilt_deg
            has_failed = bool(tilts.any())
            if ended and not has_failed:
                has_failed = not bool(self.succeeds(observation[..., None, :]).all())
            is_whole = len(self.rewards) == self.settings.trial_steps
            if has_failed or ended or is_whole:
                self._tell(has_failed=has_failed)
                self.end_episodes()

    def _tell(self, *, has_failed: bool) -> None:
        """Tell the search the score of the trial."""
        settings = self.settings
        if settings.falls_late:
            self.search.tell(sum(self.rewards) / settings.trial_steps)
            return
        score = trial_score(self.rewards, settings.settle_steps)
        self.search.tell(score, has_failed=has_failed)

    def end_episodes(self, robot: int | None = None) -> None:
        """Drop the present trial, if any: what follows does not follow from it."""
        self.rewards = []

    def begin_elsewhere(self) -> None:
        """Go on in another world: the trials so far tell what may be good there, and the best known
        is tried first."""
        super().begin_elsewhere()
        self.search.begin_elsewhere()
        self._act_as_proposed()

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        """Act by the numbers of the next trial if one has ended. Returns metrics."""
        trials = self.search.trials
        if self.updates == len(trials):
            return {}
        self.updates = len(trials)
        self._act_as_proposed()
        best_reward, _ = self.search.expected(self.search.best)
        metrics = {
            "trial_reward": trials[-1].score,
            "best_reward": best_reward,
            "noise": self.search.process.noise,
        }
        return {name: torch.tensor(value) for name, value in metrics.items()}

    def state_dict(self) -> dict[str, Any]:
        """Everything that learning changes."""
        return {**super().state_dict(), "search": self.search.state()}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        self.updates = int(state["updates"])
        try:
            self.search.load_state(state["search"])
        except DescriptionError as error:
            raise CheckpointError(
                f"the checkpoint does not fit this agent ({error}); resume with the settings it had"
            ) from None
        self._act_as_proposed()


def build(
    env: EnvBase,
    settings: GaitSettings,
    device: torch.device | str = "cpu",
) -> PolicySearch:
    """Policy search for an environment. Its seed is drawn from torch's global generator."""
    structure = make_structure(env, settings.structure)
    search = BayesianSearch(
        structure.numbers,
        # of torch's generator, as all that a run draws: one seed decides it
        seed=int(torch.randint(2**31, ())),
        random_trials=settings.random_trials,
        optimism=settings.optimism,
        caution=settings.caution,
    )
    actor = StructuredActor(structure, torch.tensor(search.best)).to(device)
    policy = TensorDictModule(actor, in_keys=["observation"], out_keys=["action"])
    places = layout_of(env).places
    task = interface_of(env).task
    if task is not None:
        # an environment that repeats actions makes several steps of the task in one
        episode_steps = task.max_steps // steps_of(env)
        if settings.trial_steps > episode_steps:
            steps = counted(episode_steps, "step")
            raise DescriptionError(
                f"no trial of {settings.trial_steps} steps ends in an episode of {steps}; give "
                "fewer trial_steps"
            )
    tilts = [places[name] for name in ("pitch", "roll") if name in places]
    # the task's function reads the task's numbers, which a transform may have changed
    succeeds: Callable[[Tensor], Tensor] = never
    if task is not None and keeps_vectors(env):
        succeeds = task.success
    return PolicySearch(
        policy=policy,
        actor=actor,
        settings=settings,
        search=search,
        tilts=tilts,
        succeeds=succeeds,
    )
