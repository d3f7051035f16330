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
from typing import Annotated, Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.entry import Entry
from brickhub.fields import check_fields
from brickhub.user_files import NotCode
from bricksrl.agents.learner import Learner
from bricksrl.agents.search.structures import STRUCTURES, StructuredActor, make_structure
from bricksrl.agents.settings import NotNegative, Positive, Presets, Range
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import lost_links
from bricksrl.envs.task import never
from bricksrl.envs.transforms import keeps_vectors, layout_of, steps_of
from bricksrl.errors import CheckpointError, DescriptionError, counted

CANDIDATES = 2000
"""Numbers among which the next ones are chosen: as many drawn anywhere, and as many near the best
known."""
NEAR = 0.2
"""Standard deviation of the latter, as a share of half the range; of an angle that wraps, in
radians."""
REACH = 0.3
"""Lengths of what is peculiar to a later world, as a share of those that all worlds share."""
LEVEL = 0.5
"""Level of a later world, as a share of the amplitude."""


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


class Posterior:
    """A Gaussian process given scores ``[k]`` of points ``[k, p, 2]``, see `embedded`; its scales
    are the most probable ones.

    The kernel is the squared exponential of the distance, for angles the periodic kernel (MacKay,
    1998). All ``worlds`` ``[k]`` share the process of the first one, 0; a later one has a level and
    a process of its own on top, which varies faster. The present world is that of the last score.
    The scales are log-normal beforehand, for scores of variance 1.
    """

    MEDIAN = (1.7, 0.2, 1.0, 0.3)
    """Beforehand: length (of half a range, or in radians), what is peculiar to a world as a share
    of the amplitude, amplitude, and standard deviation of the noise."""
    SPREAD = 0.5
    """Standard deviation of their logarithms."""

    def __init__(
        self,
        points: Tensor,
        scores: Tensor,
        worlds: Tensor,
    ) -> None:
        # in double precision: points close together make a matrix that is nearly singular
        scores = scores.double()
        self.points = points
        self.worlds = worlds
        self.mean = scores.mean()
        # one score has no deviation, and equal ones have none
        if len(scores) > 1:
            self.unit = scores.std().clamp_min(1e-6)
        else:
            self.unit = torch.ones_like(self.mean)
        self._values = (scores - self.mean) / self.unit
        self._fit_scales()

    def _fit_scales(self) -> None:
        """Find the scales that are most probable given the scores."""
        length, *others = self.MEDIAN
        # one length for each number, then what all share: [p + 3]
        medians = torch.tensor([length] * self.points.shape[1] + others)
        # logarithms: the optimiser then needs no limits to keep the scales positive
        median = medians.double().log()
        self.scales = median.clone().requires_grad_()
        optimizer = torch.optim.LBFGS([self.scales], max_iter=30, line_search_fn="strong_wolfe")

        def loss() -> Tensor:
            optimizer.zero_grad()
            self._factorise()
            # The negative log of the marginal likelihood (Rasmussen and Williams, 2006, eq. 5.8)
            # without its constant, and that of the scales' own distribution: few trials alone would
            # let the likelihood explain them by noise or by the shortest lengths.
            fit = (self._values @ self._weights) / 2
            surprise = fit + self._root.diagonal().log().sum()
            deviations = (self.scales - median) / self.SPREAD
            total: Tensor = surprise + (deviations**2).sum() / 2
            total.backward()
            return total

        optimizer.step(loss)
        with torch.no_grad():
            self._factorise()

    def _kernel(
        self,
        a: Tensor,
        b: Tensor,
        a_world: Tensor,
        b_world: Tensor,
    ) -> Tensor:
        """Covariance of points in their worlds."""
        *_, peculiar, amplitude, _ = self.scales.exp()
        lengths = self.scales[:-3].exp()[:, None]
        a = (a / lengths).flatten(1)
        b = (b / lengths).flatten(1)
        # A product of matrices would be faster, but rounds distances of equal points away from 0.
        distance = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist")
        near = (-distance.square() / 2).exp()
        in_same_later_world = (a_world[:, None] == b_world) & (b_world > 0)
        # a length that is REACH times as long is a power of the same exponential
        nearer = near ** (1.0 / REACH**2)
        peculiarities = in_same_later_world * (LEVEL**2 + peculiar**2 * nearer)
        covariance: Tensor = amplitude**2 * (near + peculiarities)
        return covariance

    def _factorise(self) -> None:
        # a trial that is repeated makes equal rows, which only some noise keeps apart
        noise = (2 * self.scales[-1]).exp() + 1e-8
        kernel = self._kernel(
            self.points,
            self.points,
            self.worlds,
            self.worlds,
        )
        noisy_kernel = kernel + noise * torch.eye(len(kernel))
        self._root = torch.linalg.cholesky(noisy_kernel)
        weights = torch.cholesky_solve(self._values[:, None], self._root)  # [k, 1]
        self._weights = weights[:, 0]

    @property
    def noise(self) -> Tensor:
        """Standard deviation of a trial's score."""
        deviation: Tensor = self.unit * self.scales[-1].detach().exp()
        return deviation

    @torch.no_grad()
    def at(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation ``[c]`` of the score in the present world at points ``[c, p,
        2]``, without noise."""
        here = self.worlds[-1:]
        kernel = self._kernel(
            points,
            self.points,
            here,
            self.worlds,
        )
        half = torch.linalg.solve_triangular(self._root, kernel.T, upper=False)
        known = half.square().sum(0)
        # all points have the same variance beforehand, so that the first stands for them
        beforehand = self._kernel(
            points[:1],
            points[:1],
            here,
            here,
        )  # [1, 1]
        # rounded, the difference may fall below 0 at a point that was tried
        variance = (beforehand - known).clamp_min(1e-12)
        deviation = variance.sqrt()[0]
        mean = kernel @ self._weights
        return self.mean + self.unit * mean, self.unit * deviation

    @torch.no_grad()
    def gain(
        self,
        point: Tensor,
        other: Tensor,
    ) -> tuple[float, float]:
        """Mean and standard deviation of the score of ``point`` ``[p, 2]`` less that of the
        ``other``."""
        both = torch.stack((point, other))
        here = self.worlds[-1:]
        kernel = self._kernel(
            both,
            self.points,
            here,
            self.worlds,
        )
        half = torch.linalg.solve_triangular(self._root, kernel.T, upper=False)
        # of both together: near each other they rise and fall as one, and the difference is known
        # better than either
        covariance = self._kernel(both, both, here, here) - half.T @ half  # [2, 2]
        sign = torch.tensor([1.0, -1.0]).double()
        variance = sign @ covariance @ sign
        deviation = variance.clamp_min(0).sqrt()
        mean = sign @ kernel @ self._weights
        return float(self.unit * mean), float(self.unit * deviation)


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
    """

    actor: StructuredActor
    settings: GaitSettings
    start: Tensor
    tilts: list[int]
    succeeds: Callable[[Tensor], Tensor]
    numbers: Tensor = field(init=False)
    scores: Tensor = field(init=False)
    worlds: Tensor = field(init=False)
    world: int = field(default=0, init=False)
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

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state_dict`. Raises CheckpointError if the state is of another algorithm or
        structure."""
        super().load_state_dict(state)
        try:
            search = state["search"]
            self.world = int(state["world"])
            self.start = search["start"]
            self.numbers = search["numbers"]
            self.scores = search["scores"]
            self.worlds = search["worlds"]
        except (LookupError, TypeError):
            raise CheckpointError(
                "the checkpoint has no trials; resume with the agent that it had"
            ) from None


def bounds(entries: tuple[Entry, ...]) -> tuple[Tensor, Tensor]:
    """Lowest and highest numbers ``[p]``."""
    low = torch.tensor([entry.low for entry in entries])
    high = torch.tensor([entry.high for entry in entries])
    return low, high


def embedded(numbers: Tensor, entries: tuple[Entry, ...]) -> Tensor:
    """Numbers ``[c, p]`` as points ``[c, p, 2]``, float64: an angle that wraps on the unit circle,
    others in -1..1."""
    low, high = bounds(entries)
    share = (2 * (numbers - low) / (high - low) - 1).double()  # [c, p], -1..1
    wraps = torch.tensor([entry.wraps for entry in entries])
    angle = math.pi * share
    circle = torch.stack((angle.cos(), angle.sin()), -1)
    # a second coordinate of 0 adds nothing to a distance: one kernel serves for both kinds
    line = torch.stack((share, torch.zeros_like(share)), -1)
    return torch.where(wraps[:, None], circle, line)


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
        on_policy=True,
        updates_per_step=0.0,
        actor=actor,
        settings=settings,
        start=low + spread * (high - low),
        tilts=tilts,
        succeeds=succeeds,
    )
