"""The most probable scales of a Gaussian process, given the scores of trials.

The negative logarithm of their probability is the marginal likelihood (Rasmussen and Williams,
2006, eq. 5.8) with a distribution of the scales beforehand: few trials alone would let the
likelihood explain them by noise or by the shortest lengths. It is minimised by resilient
propagation (Riedmiller and Braun, 1993), which needs slopes only, and no search along a line.
"""

import itertools
import math
from collections.abc import Sequence

from brickhub.search.cholesky import Cholesky, dot
from brickhub.search.kernel import Point, Scales

LENGTH, PECULIAR, AMPLITUDE, NOISE = 1.7, 0.2, 1.0, 0.3
"""Medians beforehand: of each length, and of the other scales."""
SPREAD = 0.5
"""Standard deviation beforehand of the scales' logarithms."""
_STEPS = 40
_FIRST_STEP = 0.2
_LEAST_STEP = 0.005
"""Steps of a logarithm: half a percent more or less changes no proposal."""
_FASTER, _SLOWER = 1.2, 0.5
"""Factors of a step while its slope keeps its sign, and when that changes (Riedmiller and Braun,
1993)."""


def medians(count: int) -> list[float]:
    """Logarithms ``[p + 3]`` of the scales of ``count`` numbers before any trial."""
    scales = [LENGTH] * count + [PECULIAR, AMPLITUDE, NOISE]
    return [math.log(scale) for scale in scales]


class Surprise:
    """How little probable scales are, as a function of their logarithms.

    Args:
        places: of trials ``[k]``; ``sizes``: how many coordinates each number ``[p]`` has.
        values: standardised scores ``[k]``; ``worlds``: the trials' worlds ``[k]``.
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
        # of pairs of trials in one list, row by row below the diagonal: (1, 0), (2, 0), (2, 1) ...
        pairs = [(row, column) for row in range(len(places)) for column in range(row)]
        self._are_peculiar = [
            worlds[row] == worlds[column] and worlds[row] > 0 for row, column in pairs
        ]
        self._is_one_world = not any(self._are_later)
        # squared distances by each number: all that the lengths are ever multiplied with
        self._squares: list[list[float]] = []
        ends = list(itertools.accumulate(sizes))
        for start, end in zip([0, *ends], ends, strict=False):
            parts = [place[start:end] for place in places]
            distances = itertools.starmap(math.dist, ((parts[i], parts[j]) for i, j in pairs))
            self._squares.append([distance * distance for distance in distances])

    def __call__(self, logarithms: Sequence[float]) -> tuple[float, list[float]]:
        """The surprise at the scales, and its slopes ``[p + 3]``.

        Raises ValueError if the scales make a matrix that is not positive definite.
        """
        scales = Scales.of_logarithms(logarithms)
        variances = [scales.variance(later) for later in self._are_later]
        inverse_squares = [1.0 / length**2 for length in scales.lengths]
        halves = [0.0] * len(self._are_peculiar)
        for factor, squares in zip(inverse_squares, self._squares, strict=True):
            halves = [half + factor * square for half, square in zip(halves, squares, strict=True)]
        nears = [math.exp(-0.5 * half) for half in halves]
        covariances, by_distance, by_peculiar = self._covariances(scales, nears)
        root = Cholesky()
        start = 0
        for row, variance in enumerate(variances):
            root.append(covariances[start : start + row], variance + scales.noise_variance)
            start += row
        weights = root.solve(self._values)
        fit = dot(self._values, weights) / 2.0
        surprise = fit + root.log_determinant() / 2.0
        # half the trace of (inverse - weights weights^T) with the change of the matrix
        on_diagonal, off_diagonal = _differences(root, weights)
        slopes: list[float] = []
        by_distances = [
            difference * slope for difference, slope in zip(off_diagonal, by_distance, strict=True)
        ]
        for factor, squares in zip(inverse_squares, self._squares, strict=True):
            slopes.append(factor * dot(by_distances, squares))
        peculiar_variance = (scales.amplitude * scales.peculiar) ** 2
        slopes.append(
            2.0 * dot(off_diagonal, by_peculiar)
            + peculiar_variance * dot(on_diagonal, self._are_later)
        )
        slopes.append(2.0 * dot(off_diagonal, covariances) + dot(on_diagonal, variances))
        slopes.append(scales.noise**2 * sum(on_diagonal))
        beforehand = medians(len(scales.lengths))
        for index, (one, median) in enumerate(zip(logarithms, beforehand, strict=True)):
            deviation = (one - median) / SPREAD
            surprise += deviation**2 / 2.0
            slopes[index] += deviation / SPREAD
        return surprise, slopes

    def _covariances(
        self,
        scales: Scales,
        nears: list[float],
    ) -> tuple[list[float], list[float], list[float]]:
        """Of pairs: the covariance, its slope by half the squared distance (the other way round),
        and what of it is peculiar to a later world."""
        if self._is_one_world:
            square = scales.amplitude**2
            covariances = [square * near for near in nears]
            return covariances, covariances, [0.0] * len(nears)
        covariances = list(map(scales.covariance, nears, self._are_peculiar))
        slopes = list(map(scales.slope, nears, self._are_peculiar))
        peculiar = [
            scales.peculiar_part(near) if is_peculiar else 0.0
            for near, is_peculiar in zip(nears, self._are_peculiar, strict=True)
        ]
        return covariances, slopes, peculiar


def _differences(root: Cholesky, weights: Sequence[float]) -> tuple[list[float], list[float]]:
    """The inverse matrix less the products of weights: its diagonal, and its pairs."""
    columns = root.inverse_columns()
    on_diagonal: list[float] = []
    off_diagonal: list[float] = []
    for row, column in enumerate(columns):
        for other in range(row):
            inverse = dot(column, columns[other][row - other :])
            off_diagonal.append(inverse - weights[row] * weights[other])
        on_diagonal.append(dot(column, column) - weights[row] ** 2)
    return on_diagonal, off_diagonal


def most_probable(surprise: Surprise, start: Sequence[float]) -> list[float]:
    """Logarithms ``[p + 3]`` of the most probable scales, sought from ``start``."""
    logarithms = list(start)
    best = logarithms
    least = math.inf
    steps = [_FIRST_STEP] * len(logarithms)
    before = [0.0] * len(logarithms)
    for _ in range(_STEPS):
        try:
            value, slopes = surprise(logarithms)
        except ValueError:
            # so far out that rounding decides: what was best so far is good enough
            break
        if value < least:
            least = value
            best = logarithms
        if max(steps) < _LEAST_STEP:
            break
        moved: list[float] = []
        for index, (one, slope) in enumerate(zip(logarithms, slopes, strict=True)):
            turns = slope * before[index]
            if turns > 0.0:
                steps[index] *= _FASTER
            elif turns < 0.0:
                steps[index] *= _SLOWER
            # a step that has just turned is not judged again
            before[index] = 0.0 if turns < 0.0 else slope
            moved.append(one - math.copysign(steps[index], slope))
        logarithms = moved
    return best
