"""A Gaussian process that is told the scores of trials (Rasmussen and Williams, 2006), and expects
those of others."""

import math
from collections.abc import Iterable, Sequence

from brickhub.entry import Entry
from brickhub.search.cholesky import Cholesky, dot
from brickhub.search.kernel import Point, Scales, nearness, place_of, stretched
from brickhub.search.scales import Surprise, medians, most_probable

_GROWTH = 1.2
"""Trials, as a multiple of those at the last time, after which the scales are sought anew: each
time costs as much as hundreds of expectations, and one trial more changes them little."""
_ENOUGH = 100
"""Trials by which the scales are known well enough: the time to seek them grows with the third
power."""
_LEAST_UNIT = 1e-6
"""Equal scores have no deviation to divide by."""
_LEAST_VARIANCE = 1e-12
"""Rounded, a variance may fall below 0 at a point that was tried."""


class GaussianProcess:
    """Scores as a function of numbers; the present world is that of the last trial.

    Args:
        entries: the numbers ``[p]``, with their ranges.
        logarithms: of the scales ``[p + 3]``, as they were found before; ``fitted``: by how many
            trials.
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        logarithms: Sequence[float] | None = None,
        fitted: int = 0,
    ) -> None:
        self.entries = tuple(entries)
        self.logarithms = medians(len(entries)) if logarithms is None else list(logarithms)
        self.fitted = fitted
        self.scales = Scales.of_logarithms(self.logarithms)
        self.mean = 0.0
        self.unit = 1.0
        self._places: list[Point] = []
        self._stretched: list[Point] = []
        self._scores: list[float] = []
        self._worlds: list[int] = []
        self._root = Cholesky()
        self._weights: list[float] = []

    def __len__(self) -> int:
        return len(self._scores)

    @property
    def noise(self) -> float:
        """Standard deviation of a trial's score."""
        return self.unit * self.scales.noise

    def tell(self, numbers: Sequence[float], score: float, world: int = 0) -> None:
        """Add a trial, whose world is the present one from here on."""
        place = place_of(numbers, self.entries)
        self._scores.append(score)
        self.mean = math.fsum(self._scores) / len(self)
        # One score has no deviation.
        # Python in a browser's tab has no module `statistics`.
        deviation = 1.0
        if len(self) > 1:
            squares = math.fsum((score - self.mean) ** 2 for score in self._scores)
            deviation = math.sqrt(squares / (len(self) - 1))
        self.unit = max(deviation, _LEAST_UNIT)
        self._places.append(place)
        self._worlds.append(world)
        self._append(place, world)
        # Not when a search that was kept is told its trials again.
        is_due = len(self) >= self.fitted * _GROWTH
        if is_due and len(self) <= _ENOUGH:
            self._fit_scales()
        self._weights = self._root.solve(self._values())

    def _values(self) -> list[float]:
        """Scores ``[k]``, standardised."""
        return [(score - self.mean) / self.unit for score in self._scores]

    def _append(self, place: Point, world: int) -> None:
        """Add a trial to the matrix, in the present scales."""
        here = stretched(place, self.entries, self.scales)
        covariances = self._covariances(here, world)
        variance = self.scales.variance(world) + self.scales.noise_variance
        self._root.append(covariances, variance)
        self._stretched.append(here)

    def _fit_scales(self) -> None:
        """Seek the most probable scales, and make the matrix anew."""
        sizes = [2 if entry.wraps else 1 for entry in self.entries]
        surprise = Surprise(self._places, sizes, self._values(), self._worlds)
        self.logarithms = most_probable(surprise, self.logarithms)
        self.fitted = len(self)
        self.scales = Scales.of_logarithms(self.logarithms)
        self._root = Cholesky()
        self._stretched = []
        for place, world in zip(self._places, self._worlds, strict=True):
            self._append(place, world)

    def _covariances(self, here: Point, world: int) -> list[float]:
        """Covariances ``[k]`` of a stretched place in a world with the trials of the matrix."""
        if world == 0:
            square = self.scales.amplitude**2
            return [square * nearness(here, there) for there in self._stretched]
        covariance = self.scales.covariance
        return [
            covariance(nearness(here, there), world == other)
            for there, other in zip(self._stretched, self._worlds, strict=False)
        ]

    def _here(self, numbers: Sequence[float]) -> Point:
        return stretched(place_of(numbers, self.entries), self.entries, self.scales)

    def mean_at(self, numbers: Sequence[float]) -> float:
        """Mean of the score of numbers ``[p]`` in the present world, which is sooner known than its
        deviation."""
        covariances = self._covariances(self._here(numbers), self._worlds[-1])
        return self.mean + self.unit * dot(covariances, self._weights)

    def expected(self, numbers: Sequence[float]) -> tuple[float, float]:
        """Mean and standard deviation of the score of numbers ``[p]`` in the present world, without
        noise."""
        world = self._worlds[-1]
        covariances = self._covariances(self._here(numbers), world)
        half = self._root.half_solve(covariances)
        variance = max(self.scales.variance(world) - dot(half, half), _LEAST_VARIANCE)
        mean = dot(covariances, self._weights)
        return self.mean + self.unit * mean, self.unit * math.sqrt(variance)

    def gain(
        self,
        numbers: Sequence[float],
        other: Sequence[float],
    ) -> tuple[float, float]:
        """Mean and standard deviation of the score of numbers ``[p]`` less that of ``other``
        ones."""
        world = self._worlds[-1]
        first = self._here(numbers)
        second = self._here(other)
        covariances = self._covariances(first, world)
        other_covariances = self._covariances(second, world)
        differences = [one - two for one, two in zip(covariances, other_covariances, strict=True)]
        half = self._root.half_solve(differences)
        # Of both together: near each other they rise and fall as one, and the difference is known
        # better than either.
        in_common = self.scales.covariance(nearness(first, second), world > 0)
        beforehand = 2.0 * (self.scales.variance(world) - in_common)
        variance = max(beforehand - dot(half, half), 0.0)
        mean = dot(differences, self._weights)
        return self.unit * mean, self.unit * math.sqrt(variance)

    def most_promising(
        self,
        candidates: Iterable[Sequence[float]],
        optimism: float,
    ) -> Sequence[float]:
        """The candidate whose score may be highest: the mean and ``optimism`` standard deviations
        (the upper confidence bound, Srinivas et al., 2010). The first of equal ones."""
        world = self._worlds[-1]
        beforehand = self.scales.variance(world)
        highest = -math.inf
        chosen: Sequence[float] = ()
        for numbers in candidates:
            covariances = self._covariances(self._here(numbers), world)
            mean = dot(covariances, self._weights)
            bound = self._bound(covariances, mean, beforehand, optimism, highest)
            if bound > highest:
                highest = bound
                chosen = numbers
        return chosen

    def _bound(
        self,
        covariances: Sequence[float],
        mean: float,
        variance: float,
        optimism: float,
        highest: float,
    ) -> float:
        """The upper confidence bound of a candidate, or something lower than the ``highest`` one.

        Each trial takes its part of the variance away, so that the bound falls from trial to trial:
        most candidates are out of the race before all of them have spoken.
        """
        missing = max(highest - mean, 0.0)
        half: list[float] = []
        for row, covariance in zip(self._root.rows, covariances, strict=True):
            part = (covariance - dot(row, half)) / row[-1]
            half.append(part)
            variance -= part * part
            # Squared, so that no optimism at all is no special case.
            if optimism**2 * variance < missing**2:
                return -math.inf
        return mean + optimism * math.sqrt(max(variance, _LEAST_VARIANCE))
