"""Policy search: the few numbers of a structured policy, proposed by Bayesian optimisation and
tried on a robot.

A search is asked for the numbers of the next trial, and told its score, or that it was lost:

    structure = structure_for(robot, interface)
    search = BayesianSearch(structure.numbers, seed=1)
    for _ in range(30):
        numbers = search.ask()
        ...  # act by structure.act(observed, numbers) for some steps
        search.tell(trial_score(rewards, settle_steps=3))
    structure.act(observed, search.best)

A Gaussian process (Rasmussen and Williams, 2006) learns the score from the trials, and the next
numbers are those where the score may be highest (upper confidence bound, Srinivas et al., 2010).
What is drawn follows from the seed and the number of trials alone, so that a search that was kept
goes on as if it had never stopped.
"""

import contextlib
import math
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.interface import Interface
from brickhub.robot import Robot
from brickhub.search.feedback import Feedback, feature_of
from brickhub.search.gaussian_process import GaussianProcess
from brickhub.search.oscillators import Oscillators, oscillators
from brickhub.seed import derive_seed

CANDIDATES = 300
"""Numbers among which the next ones are chosen: as many drawn anywhere, and as many near the best
known."""
NEAR = 0.2
"""Standard deviation of the latter, as a share of the range."""


@dataclass(frozen=True)
class Trial:
    """A trial: its numbers ``[p]``, its score, and the world that it was made in."""

    numbers: tuple[float, ...]
    score: float
    world: int = 0


def structure_for(robot: Robot, interface: Interface) -> Oscillators | Feedback:
    """The structure that suits a robot: linear feedback on all channels where a drive base's wheels
    turn, or nothing turns endlessly; else oscillators."""
    # Whether a robot has legs is known only to what would use them.
    if robot.drive_base is None:
        with contextlib.suppress(DescriptionError):
            return oscillators(robot, interface)
    features = [
        feature_of(channel.entry, index) for index, channel in enumerate(interface.channels)
    ]
    return Feedback(features, len(interface.commands))


def trial_score(rewards: Sequence[float], settle_steps: int = 0) -> float:
    """Score of a trial of these rewards of its steps: their mean once the robot has settled, with
    less weight towards both ends (Bartlett's window), as the reward goes up and down with each
    stride. NaN without a step."""
    # A trial that ended while it settled has these rewards only.
    counted = list(rewards[settle_steps:]) or list(rewards)
    if not counted:
        return math.nan
    total = 0.0
    weights = 0.0
    for place, reward in enumerate(counted):
        places_after = len(counted) - 1 - place
        weight = 1.0 + min(place, places_after)
        total += weight * reward
        weights += weight
    return total / weights


class BayesianSearch:
    """A search for the best numbers.

    Args:
        entries: the numbers ``[p]``, with their ranges.
        seed: decides all that is drawn.
        random_trials: trials spread over all numbers before the first proposal.
        optimism: standard deviations by which an unknown score is taken to be better than expected.
        caution: standard deviations by which other numbers must be better than the best known to
            replace them.

    Attributes:
        trials: trials so far.
        best: best numbers ``[p]`` known; the middle of all before the first trial.
        world: number of the present world.
        process: what is expected of numbers that were not tried; it knows the trials so far.
    """

    def __init__(
        self,
        entries: Iterable[Entry],
        *,
        seed: int = 0,
        random_trials: int = 6,
        optimism: float = 2.0,
        caution: float = 0.3,
    ) -> None:
        self.entries = tuple(entries)
        if not self.entries:
            raise DescriptionError("there are no numbers to search; give a structure with some")
        self.seed = seed
        self.optimism = optimism
        self.caution = caution
        self.trials: list[Trial] = []
        self.world = 0
        self.process = GaussianProcess(self.entries)
        self.best = tuple((entry.low + entry.high) / 2.0 for entry in self.entries)
        rng = random.Random(derive_seed(seed, "first trials"))
        self._start = spread(self.entries, random_trials, rng)
        self._asked = self._start[0]

    def ask(self) -> tuple[float, ...]:
        """Numbers ``[p]`` of the next trial, the same until `tell`."""
        return self._asked

    def tell(
        self,
        score: float | None,
        *,
        numbers: Sequence[float] | None = None,
        has_failed: bool = False,
    ) -> None:
        """Take the score of a trial. One that was lost, ``None`` or not finite, is asked for again.

        Args:
            numbers: of the trial, if they are not those that were asked for, such as a person's.
            has_failed: whether the robot fell: its score is then no better than the worst one, as a
                fall may have been a fast one.

        Raises:
            DescriptionError: numbers that are out of their ranges, or too many or too few.
        """
        tried = self._asked if numbers is None else self._checked(numbers)
        if score is None or not math.isfinite(score):
            return
        if has_failed and self.trials:
            score = min(score, *(trial.score for trial in self.trials))
        self._add(Trial(tried, score, self.world))
        likeliest = self._likeliest()
        gain, deviation = self.process.gain(likeliest, self.best)
        if len(self.trials) == 1 or gain > self.caution * deviation:
            self.best = likeliest
        self._asked = self._next(likeliest)

    def begin_elsewhere(self) -> None:
        """Go on in another world: the trials so far tell what may be good there, and the best known
        is tried first."""
        self.world += 1
        self._start = [self.best]
        self._asked = self.best

    def expected(self, numbers: Sequence[float]) -> tuple[float, float]:
        """Mean and standard deviation of the score of numbers ``[p]``, after the first trial."""
        return self.process.expected(numbers)

    def _checked(self, numbers: Sequence[float]) -> tuple[float, ...]:
        if len(numbers) != len(self.entries):
            raise DescriptionError(f"{len(numbers)} numbers; give {len(self.entries)}")
        for number, entry in zip(numbers, self.entries, strict=True):
            # Written so that a NaN is refused too.
            if not entry.low <= number <= entry.high:
                raise DescriptionError(
                    f"'{entry.name}' is {number}; give {entry.low:g} to {entry.high:g}"
                )
        return tuple(map(float, numbers))

    def _add(self, trial: Trial) -> None:
        self.trials.append(trial)
        self.process.tell(trial.numbers, trial.score, trial.world)

    def _likeliest(self) -> tuple[float, ...]:
        """The best numbers among those that were tried in this world, by what is expected of them
        rather than by the score of one trial, which noise may have raised."""
        here = [trial.numbers for trial in self.trials if trial.world == self.world]
        return max(here, key=self.process.mean_at)

    def _next(self, likeliest: tuple[float, ...]) -> tuple[float, ...]:
        tried = sum(trial.world == self.world for trial in self.trials)
        if tried < len(self._start):
            return self._start[tried]
        candidates = self.candidates(likeliest)
        return tuple(self.process.most_promising(candidates, self.optimism))

    def candidates(self, near: Sequence[float]) -> Iterator[tuple[float, ...]]:
        """Numbers ``[p]``, first near some and then anywhere."""
        rng = random.Random(derive_seed(self.seed, "candidates", len(self.trials)))
        # Among those drawn anywhere hardly one is near enough to improve on the best known.
        for _ in range(CANDIDATES):
            pairs = zip(near, self.entries, strict=True)
            beside = [_beside(number, entry, rng) for number, entry in pairs]
            yield tuple(beside)
        for _ in range(CANDIDATES):
            anywhere = [rng.uniform(entry.low, entry.high) for entry in self.entries]
            yield tuple(anywhere)

    def state(self) -> dict[str, Any]:
        """Everything that `tell` and `begin_elsewhere` change: numbers, and lists of numbers."""
        return {
            "seed": self.seed,
            "numbers": [list(trial.numbers) for trial in self.trials],
            "scores": [trial.score for trial in self.trials],
            "worlds": [trial.world for trial in self.trials],
            "world": self.world,
            "start": [list(numbers) for numbers in self._start],
            "asked": list(self._asked),
            "best": list(self.best),
            "scales": list(self.process.logarithms),
            "fitted": self.process.fitted,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from `state`. Raises DescriptionError if it is none of these entries."""
        try:
            trials: list[Trial] = []
            columns = zip(state["numbers"], state["scores"], state["worlds"], strict=True)
            for numbers, score, of_world in columns:
                trials.append(Trial(self._checked(numbers), float(score), int(of_world)))
            start = [self._checked(numbers) for numbers in state["start"]]
            asked = self._checked(state["asked"])
            best = self._checked(state["best"])
            scales = [float(one) for one in state["scales"]]
            if len(scales) != len(self.process.logarithms):
                raise DescriptionError("its scales are those of other numbers")
            seed = int(state["seed"])
            world = int(state["world"])
            fitted = int(state["fitted"])
        except (LookupError, TypeError, ValueError) as error:
            raise DescriptionError(
                f"this is no state of a search for these numbers ({error}); begin a new one"
            ) from None
        self.seed = seed
        self.world = world
        self.best = best
        self.trials = []
        self._start = start
        self._asked = asked
        self.process = GaussianProcess(self.entries, scales, fitted)
        for trial in trials:
            self._add(trial)


def spread(
    entries: Sequence[Entry],
    count: int,
    rng: random.Random,
) -> list[tuple[float, ...]]:
    """``count`` numbers ``[p]`` that fill the ranges evenly, which counts for so few: a Latin
    hypercube (McKay et al., 1979), each of whose rows and columns has one of them."""
    columns: list[list[float]] = []
    for entry in entries:
        span = entry.high - entry.low
        shares = [(place + rng.random()) / count for place in range(count)]
        rng.shuffle(shares)
        column = [entry.low + share * span for share in shares]
        columns.append(column)
    return list(zip(*columns, strict=True))


def _beside(
    number: float,
    entry: Entry,
    rng: random.Random,
) -> float:
    """A number near another one, within its range."""
    span = entry.high - entry.low
    beside = number + rng.gauss(0.0, NEAR) * span
    # Beyond its end an angle begins anew, and any other number stops.
    if entry.wraps:
        return entry.low + (beside - entry.low) % span
    return max(entry.low, min(entry.high, beside))
