"""The most probable scales of a Gaussian process, given the scores of trials.

The negative logarithm of their probability is the marginal likelihood (Rasmussen and Williams,
2006, eq. 5.8) with a distribution of the scales beforehand: few trials alone would let the
likelihood explain them by noise or by the shortest lengths. It is minimised by resilient
propagation (Riedmiller and Braun, 1993), which needs slopes only, and no search along a line.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from brickhub.search.cholesky import Cholesky, dot
from brickhub.search.kernel import Point, Scales

LENGTH = 1.7
"""Median beforehand of each length, in half ranges or radians."""
PECULIAR = 0.2
"""Median beforehand of what is peculiar to a world, as a share of the amplitude."""
AMPLITUDE = 1.0
"""Median beforehand of the amplitude, for scores of variance 1."""
NOISE = 0.3
"""Median beforehand of the standard deviation of a trial's score."""
SPREAD = 0.5
"""Standard deviation beforehand of the scales' logarithms."""
_STEPS = 40
_FIRST_STEP = 0.2
_LEAST_STEP = 0.005
"""Steps of a logarithm: half a percent more or less changes no proposal."""
_FASTER = 1.2
"""Factor of a step while its slope keeps its sign (Riedmiller and Braun, 1993)."""
_SLOWER = 0.5
"""Factor of a step whose slope has changed its sign."""


def medians(count: int) -> list[float]:
    """Logarithms ``[p + 3]`` of the scales of ``count`` numbers before any trial."""
    scales = [LENGTH] * count
    scales += [PECULIAR, AMPLITUDE, NOISE]
    return list(map(math.log, scales))


@dataclass(frozen=True)
class _Pairs:
    """What scales make of all pairs of trials.

    Attributes:
        covariances: of each pair.
        slopes: their changes with half of the squared distance, the other way round.
        peculiar: the parts of them that are peculiar to a later world.
    """

    covariances: list[float]
    slopes: list[float]
    peculiar: list[float]


class Surprise:
    """How little probable scales are, as a function of their logarithms.

    Args:
        places: of trials ``[k]``.
        sizes: how many coordinates each number ``[p]`` has.
        values: standardised scores ``[k]``.
        worlds: the trials' worlds ``[k]``.
    """

    def __init__(
        self,
        places: Sequence[Point],
        sizes: Sequence[int],
        values: Sequence[float],
        worlds: Sequence[int],
    ) -> None:
        self._values = values
        self._are_later = [world > 0 for world in worlds]
        # Of pairs of trials in one list, row by row below the diagonal: (1, 0), (2, 0), (2, 1) ...
        pairs: list[tuple[int, int]] = []
        for row in range(len(places)):
            pairs += [(row, column) for column in range(row)]
        self._are_peculiar: list[bool] = []
        for row, column in pairs:
            is_same_world = worlds[row] == worlds[column]
            self._are_peculiar.append(is_same_world and self._are_later[row])
        # Squared distances by each number: all that the lengths are ever multiplied with.
        self._squares: list[list[float]] = []
        start = 0
        for size in sizes:
            parts = [place[start : start + size] for place in places]
            start += size
            distances = [math.dist(parts[row], parts[column]) for row, column in pairs]
            self._squares.append([distance * distance for distance in distances])

    def __call__(self, logarithms: Sequence[float]) -> tuple[float, list[float]]:
        """The surprise at the scales, and its slopes ``[p + 3]``.

        Raises ValueError if the scales make a matrix that is not positive definite.
        """
        scales = Scales.of_logarithms(logarithms)
        pairs = self._pairs(scales)
        variances = list(map(scales.variance, self._are_later))
        root = _root_of(
            pairs.covariances,
            variances,
            scales.noise_variance,
        )
        weights = root.solve(self._values)
        fit = dot(self._values, weights) / 2.0
        surprise = fit + root.log_determinant() / 2.0
        # Half of the trace of the difference times what a scale changes in the matrix: a pair is
        # in it twice, the diagonal once.
        on_diagonal, off_diagonal = _differences(root, weights)
        by_distance = list(map(float.__mul__, off_diagonal, pairs.slopes))
        slopes: list[float] = []
        for length, squares in zip(scales.lengths, self._squares, strict=True):
            slopes.append(dot(by_distance, squares) / length**2)
        # The logarithm of an amplitude changes a variance by twice as much as itself.
        peculiar_variance = (scales.amplitude * scales.peculiar) ** 2
        by_peculiar = 2.0 * dot(off_diagonal, pairs.peculiar)
        by_peculiar += peculiar_variance * dot(on_diagonal, self._are_later)
        slopes.append(by_peculiar)
        by_amplitude = 2.0 * dot(off_diagonal, pairs.covariances)
        by_amplitude += dot(on_diagonal, variances)
        slopes.append(by_amplitude)
        slopes.append(scales.noise**2 * sum(on_diagonal))
        # And how little probable the scales were before any trial.
        beforehand = medians(len(scales.lengths))
        for index, median in enumerate(beforehand):
            deviation = (logarithms[index] - median) / SPREAD
            surprise += deviation**2 / 2.0
            slopes[index] += deviation / SPREAD
        return surprise, slopes

    def _pairs(self, scales: Scales) -> _Pairs:
        squares_sum = [0.0] * len(self._are_peculiar)
        for length, squares in zip(scales.lengths, self._squares, strict=True):
            factor = 1.0 / length**2
            scaled = [factor * square for square in squares]
            squares_sum = list(map(float.__add__, squares_sum, scaled))
        nears = [math.exp(-0.5 * square) for square in squares_sum]
        # In one world, as most searches are, all three are much sooner known.
        if not any(self._are_later):
            variance = scales.amplitude**2
            covariances = [variance * near for near in nears]
            return _Pairs(covariances, covariances, [0.0] * len(nears))
        peculiar: list[float] = []
        for near, is_peculiar in zip(nears, self._are_peculiar, strict=True):
            peculiar.append(scales.peculiar_part(near) if is_peculiar else 0.0)
        return _Pairs(
            covariances=list(map(scales.covariance, nears, self._are_peculiar)),
            slopes=list(map(scales.slope, nears, self._are_peculiar)),
            peculiar=peculiar,
        )


def _root_of(
    covariances: Sequence[float],
    variances: Sequence[float],
    noise_variance: float,
) -> Cholesky:
    """Root of the matrix with these pairs and, with noise, these variances."""
    root = Cholesky()
    start = 0
    for row, variance in enumerate(variances):
        of_row = covariances[start : start + row]
        root.append(of_row, variance + noise_variance)
        start += row
    return root


def _differences(root: Cholesky, weights: Sequence[float]) -> tuple[list[float], list[float]]:
    """The inverse matrix less the products of weights: its diagonal, and its pairs."""
    columns = root.inverse_columns()
    on_diagonal: list[float] = []
    off_diagonal: list[float] = []
    for row, column in enumerate(columns):
        weight = weights[row]
        for other in range(row):
            # A column begins at its diagonal, and what is above it is 0.
            inverse = dot(column, columns[other][row - other :])
            off_diagonal.append(inverse - weight * weights[other])
        on_diagonal.append(dot(column, column) - weight * weight)
    return on_diagonal, off_diagonal


def most_probable(surprise: Surprise, start: Sequence[float]) -> list[float]:
    """Logarithms ``[p + 3]`` of the most probable scales, sought from ``start``."""
    logarithms = list(start)
    best = logarithms
    least = math.inf
    steps = [_FIRST_STEP] * len(logarithms)
    slopes_before = [0.0] * len(logarithms)
    for _ in range(_STEPS):
        try:
            value, slopes = surprise(logarithms)
        except ValueError:
            # So far out that rounding decides: what was best so far is good enough.
            break
        if value < least:
            least = value
            best = logarithms
        if max(steps) < _LEAST_STEP:
            break
        logarithms = logarithms[:]
        for index, slope in enumerate(slopes):
            agreement = slope * slopes_before[index]
            if agreement > 0.0:
                steps[index] *= _FASTER
            elif agreement < 0.0:
                steps[index] *= _SLOWER
                # A step that has just turned is not judged again.
                slope = 0.0
            slopes_before[index] = slope
            logarithms[index] -= math.copysign(steps[index], slopes[index])
    return best
