"""Policy search: the few numbers of a structured policy, tried on the robot, proposed by Bayesian
optimisation.

A trial acts by one set of numbers for some steps, without a reset; its score is the mean reward
once the robot has settled. A Gaussian process (Rasmussen and Williams, 2006) learns the score from
the trials, and the next numbers are those where the score may be highest (upper confidence bound,
Srinivas et al., 2010).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.entry import Entry
from brickhub.fields import check_fields
from brickhub.user_files import NotCode
from bricksrl.agents.learner import Learner
from bricksrl.agents.search.posterior import Posterior, bounds, embedded
from bricksrl.agents.search.structures import STRUCTURES, StructuredActor, make_structure
from bricksrl.agents.settings import NotNegative, Positive, Presets, Range
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import lost_links
from bricksrl.envs.task import never
from bricksrl.envs.transforms import keeps_vectors, layout_of, steps_of
from bricksrl.errors import DescriptionError, counted

CANDIDATES = 2000
"""Numbers among which the next ones are chosen: as many drawn anywhere, and as many near the best
known."""
NEAR = 0.2
"""Standard deviation of the latter, as a share of half the range; of an angle that wraps, in
radians."""


@dataclass(frozen=True)
class GaitSettings:
    """Settings of policy search."""

    structure: Annotated[str, NotCode(tuple(STRUCTURES))] = ""
    """oscillators (legs held at phases), linear (feedback), or FILE.py:NAME; by default oscillators
    where there are legs."""
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
        start: numbers ``[s, p]`` of the first trials.
        tilts: indices of pitch and roll in the observation.
        succeeds: success of an episode that ends with these observations ``[*batch, 1, n]``; others
            end in a fall or the like.
        numbers, scores, worlds: of the trials so far, ``[k, p]``, ``[k]`` and ``[k]``.
        updates: trials that a proposal has been made from.
    """

    on_policy: ClassVar[bool] = True

    actor: StructuredActor
    settings: GaitSettings
    start: Tensor
    tilts: list[int]
    succeeds: Callable[[Tensor], Tensor]
    numbers: Tensor = field(init=False)
    scores: Tensor = field(init=False)
    worlds: Tensor = field(init=False)
    world: int = field(default=0, init=False)
    updates: int = field(default=0, init=False)
    rewards: list[float] = field(default_factory=list, init=False)  # of the present trial

    def __post_init__(self) -> None:
        super().__post_init__()
        # empty, of the shapes and types that trials will have
        self.numbers = self.start[:0]
        self.scores = self.start[:0, 0]
        self.worlds = self.start[:0, 0].long()
        self.actor.trial.copy_(self.start[0])

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
            if has_failed:
                # A fall may have been a fast one: its rewards alone would invite more of them.
                highest = float(self.scores.min()) if len(self.scores) else math.inf
                self._score(highest)
            elif ended or len(self.rewards) == self.settings.trial_steps:
                self._score(math.inf)

    def _score(self, highest: float) -> None:
        """End the trial, with a score of at most the ``highest``: a mean with less weight towards
        both ends (Bartlett's window), as the reward goes up and down with each stride."""
        # a trial that ended while it settled has these rewards only
        settled = self.rewards[self.settings.settle_steps :]
        counted = torch.tensor(settled or self.rewards)
        places = torch.arange(1.0, len(counted) + 1)
        weights = torch.minimum(places, places.flip(0))
        mean = (counted * weights).sum() / weights.sum()
        score = mean.clamp_max(highest)[None].to(self.scores)
        self.numbers = torch.cat((self.numbers, self.actor.trial[None]))
        self.scores = torch.cat((self.scores, score))
        self.worlds = torch.cat((self.worlds, torch.tensor([self.world])))
        self.end_episodes()

    def end_episodes(self, robot: int | None = None) -> None:
        """Drop the present trial, if any: what follows does not follow from it."""
        self.rewards = []

    def begin_elsewhere(self) -> None:
        """Go on in another world: the trials so far tell what may be good there, and the best known
        is tried first."""
        super().begin_elsewhere()
        self.world += 1
        self.start = self.actor.best[None].clone()
        self.actor.trial.copy_(self.actor.best)

    def learn(self, steps: int = 1) -> dict[str, Tensor]:
        """Propose the numbers of the next trial if one has ended. Returns metrics."""
        if self.updates == len(self.scores):
            return {}
        self.updates = len(self.scores)
        entries = self.actor.structure.numbers
        points = embedded(self.numbers, entries)
        here = self.worlds == self.world
        posterior = Posterior(points, self.scores, self.worlds)
        # The best known is chosen among what was tried in this world, by the mean rather than by
        # the score of one trial, which noise may have raised.
        means, _ = posterior.at(points[here])
        likeliest = self.numbers[here][means.argmax()]
        compared = torch.stack((likeliest, self.actor.best))
        gain, deviation = posterior.gain(*embedded(compared, entries))
        if self.updates == 1 or gain > self.settings.caution * deviation:
            self.actor.best.copy_(likeliest)
        tried = int(here.sum())
        if tried < len(self.start):
            self.actor.trial.copy_(self.start[tried])
        else:
            # the upper confidence bound (Srinivas et al., 2010)
            candidates = self._candidates(entries, likeliest)
            means, deviations = posterior.at(embedded(candidates, entries))
            bound = means + self.settings.optimism * deviations
            self.actor.trial.copy_(candidates[bound.argmax()])
        best, _ = posterior.at(embedded(self.actor.best[None], entries))
        return {"trial_reward": self.scores[-1], "best_reward": best[0], "noise": posterior.noise}

    def _candidates(
        self,
        entries: tuple[Entry, ...],
        near: Tensor,
    ) -> Tensor:
        """Numbers ``[2 CANDIDATES, p]``, anywhere and near some."""
        low, high = bounds(entries)
        span = high - low
        shares = torch.rand(CANDIDATES, len(entries))
        anywhere = low + shares * span
        # among those drawn anywhere hardly one is near enough to improve on the best known
        steps = torch.randn(CANDIDATES, len(entries))
        nearby = near + steps * NEAR * span
        # beyond its end an angle begins anew, and any other number stops
        wraps = torch.tensor([entry.wraps for entry in entries])
        wrapped = low + torch.remainder(nearby - low, span)
        nearby = torch.where(wraps, wrapped, nearby.clamp(low, high))
        return torch.cat((anywhere, nearby))

    def state_dict(self) -> dict[str, Any]:
        """Everything that learning changes."""
        search = {
            "start": self.start,
            "numbers": self.numbers,
            "scores": self.scores,
            "worlds": self.worlds,
        }
        return {**super().state_dict(), "search": search, "world": self.world}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        search = state["search"]
        self.updates = int(state["updates"])
        self.world = int(state["world"])
        self.start = search["start"]
        self.numbers = search["numbers"]
        self.scores = search["scores"]
        self.worlds = search["worlds"]


def build(
    env: EnvBase,
    settings: GaitSettings,
    device: torch.device | str = "cpu",
) -> PolicySearch:
    """Policy search for an environment. The first trials are drawn from torch's global
    generator."""
    structure = make_structure(env, settings.structure)
    low, high = bounds(structure.numbers)
    # of torch's generator, as all that a run draws: one seed decides it
    seed = int(torch.randint(2**31, ()))
    # Sobol's points fill the range more evenly than independent draws, which counts for so few
    sequence = torch.quasirandom.SobolEngine(len(low), scramble=True, seed=seed)
    spread = sequence.draw(settings.random_trials)
    actor = StructuredActor(structure, (low + high) / 2).to(device)
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
        start=low + spread * (high - low),
        tilts=tilts,
        succeeds=succeeds,
    )
