"""The Gaussian process against the formulas, written as plainly as they stand in the book."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from operator import sub

import pytest

from brickhub.entry import Entry
from brickhub.search import gaussian_process
from brickhub.search.cholesky import Cholesky, dot
from brickhub.search.gaussian_process import GaussianProcess
from brickhub.search.kernel import LEVEL, REACH, Scales, nearness, place_of, stretched
from brickhub.search.scales import Surprise, medians, most_probable

PHASE, SPEED = Entry("phase", 0.0, 360.0, "deg", wraps=True), Entry("speed", -1.0, 1.0)
ENTRIES = (PHASE, SPEED)
Matrix = list[list[float]]


def drawn(rng: random.Random) -> tuple[float, ...]:
    return tuple(rng.uniform(entry.low, entry.high) for entry in ENTRIES)


def inverted(matrix: Matrix) -> Matrix:
    """The inverse, by Gauss and Jordan."""
    size = len(matrix)
    rows = [[*row, *(float(i == j) for j in range(size))] for i, row in enumerate(matrix)]
    for i in range(size):
        pivot = rows[i][i]
        rows[i] = [entry / pivot for entry in rows[i]]
        for j in range(size):
            if j != i:
                factor = rows[j][i]
                rows[j] = [
                    one - factor * other for one, other in zip(rows[j], rows[i], strict=True)
                ]
    return [row[size:] for row in rows]


def positive(rng: random.Random, size: int) -> Matrix:
    rows = [[rng.gauss(0.0, 1.0) for _ in range(size)] for _ in range(size)]
    return [[dot(one, other) + (one is other) for other in rows] for one in rows]


def test_a_root_that_grows_is_that_of_the_matrix_and_solves_it() -> None:
    rng = random.Random(1)
    matrix = positive(rng, 7)
    root = Cholesky()
    for size, row in enumerate(matrix):
        root.append(row[:size], row[size])
        assert len(root) == size + 1
        values = [rng.gauss(0.0, 1.0) for _ in range(size + 1)]
        solution = root.solve(values)
        assert [dot(row[: size + 1], solution) for row in matrix[: size + 1]] == pytest.approx(
            values
        )
    inverse = inverted(matrix)
    columns = root.inverse_columns()
    assert dot(columns[3], columns[1][2:]) == pytest.approx(inverse[3][1])
    assert math.exp(root.log_determinant()) == pytest.approx(
        math.prod(row[-1] for row in root.rows) ** 2
    )


def test_a_matrix_that_is_none_of_covariances_is_refused() -> None:
    root = Cholesky()
    root.append([], 1.0)
    for covariance in (2.0, math.nan):
        with pytest.raises(ValueError, match="not positive definite"):
            root.append([covariance], 1.0)


def test_expectations_are_those_of_the_formulas() -> None:
    """Mean and deviation by the inverse of the kernel's matrix, with the scales that were found, in
    two worlds."""
    rng = random.Random(2)
    tried, worlds = [drawn(rng) for _ in range(9)], [0] * 5 + [1] * 4
    scores = [math.cos(math.radians(phase)) + speed for phase, speed in tried]
    process = GaussianProcess(ENTRIES)
    for numbers, score, world in zip(tried, scores, worlds, strict=True):
        process.tell(numbers, score, world)
    scales = process.scales

    def covariance(one: tuple[float, ...], other: tuple[float, ...], both_later: bool) -> float:
        (x, y, s), (u, v, t) = place_of(one, ENTRIES), place_of(other, ENTRIES)
        phase, speed = scales.lengths
        apart = ((x - u) ** 2 + (y - v) ** 2) / phase**2 + (s - t) ** 2 / speed**2
        own = LEVEL**2 + scales.peculiar**2 * math.exp(-apart / REACH**2 / 2)
        return scales.amplitude**2 * (math.exp(-apart / 2) + both_later * own)

    pairs = list(zip(tried, worlds, strict=True))
    matrix = [[covariance(a, b, bool(v and w)) for b, w in pairs] for a, v in pairs]
    for index, row in enumerate(matrix):
        row[index] += scales.noise_variance
    inverse = inverted(matrix)
    unit, mean = process.unit, sum(scores) / 9
    values = [(score - mean) / unit for score in scores]
    points = [drawn(rng) for _ in range(3)]
    expected = []
    for point in points:
        cross = [covariance(point, other, bool(world)) for other, world in pairs]
        weighted = [dot(row, cross) for row in inverse]
        variance = covariance(point, point, True) - dot(cross, weighted)
        expected.append((mean + unit * dot(weighted, values), unit * math.sqrt(variance)))
        assert process.expected(point) == pytest.approx(expected[-1], rel=1e-6)
    gain, doubt = process.gain(points[0], points[1])
    assert gain == pytest.approx(expected[0][0] - expected[1][0])
    assert 0.0 < doubt < expected[0][1] + expected[1][1]


def test_the_slopes_of_the_surprise_are_its_differences() -> None:
    rng = random.Random(3)
    places = [place_of(drawn(rng), ENTRIES) for _ in range(8)]
    surprise = Surprise(places, (2, 1), [rng.gauss(0.0, 1.0) for _ in places], [0] * 4 + [1] * 4)
    logarithms = [one + 0.2 for one in medians(2)]
    _, slopes = surprise(logarithms)
    for index, slope in enumerate(slopes):
        beside = [logarithms[:], logarithms[:]]
        beside[0][index] += 1e-5
        beside[1][index] -= 1e-5
        difference = sub(*(surprise(one)[0] for one in beside)) / 2e-5
        assert slope == pytest.approx(difference, abs=1e-5)


def test_the_scales_found_are_the_most_probable_ones() -> None:
    rng = random.Random(4)
    tried = [drawn(rng) for _ in range(15)]
    values = [math.sin(3.0 * speed) + 0.1 * rng.gauss(0.0, 1.0) for _, speed in tried]
    surprise = Surprise([place_of(one, ENTRIES) for one in tried], (2, 1), values, [0] * 15)
    found = most_probable(surprise, medians(2))
    least, slopes = surprise(found)
    assert max(map(abs, slopes)) < 0.05
    assert all(surprise([one + rng.gauss(0.0, 0.3) for one in found])[0] > least for _ in range(9))
    scales = Scales.of_logarithms(found)
    assert scales.lengths[0] > 2.0 * scales.lengths[1], "the phase decides nothing"


def test_a_process_is_told_trial_by_trial_or_all_at_once() -> None:
    """To the last digit: a search that was kept is told its trials again."""
    rng = random.Random(5)
    first = GaussianProcess(ENTRIES)
    trials = [(drawn(rng), rng.gauss(0.0, 1.0)) for _ in range(14)]
    for numbers, score in trials:
        first.tell(numbers, score)
    again = GaussianProcess(ENTRIES, first.logarithms, first.fitted)
    for numbers, score in trials:
        again.tell(numbers, score)
    assert first.fitted < 14
    assert again.expected(trials[0][0]) == first.expected(trials[0][0])


def test_359_degrees_are_near_1_and_a_repeated_trial_is_no_trouble() -> None:
    process = GaussianProcess(ENTRIES)
    for phase, score in ((1.0, 3.0), (90.0, 1.0), (180.0, 0.0), (270.0, 1.0), (1.0, 3.0)):
        process.tell((phase, 0.0), score)
    assert process.expected((1.0, 0.0))[0] == pytest.approx(
        process.expected((359.0, 0.0))[0], abs=0.02
    )
    assert process.expected((1.0, 0.0))[1] < process.expected((45.0, -0.9))[1]


@pytest.mark.parametrize("optimism", [0.0, 2.0])
def test_the_most_promising_candidate_is_that_of_all_bounds(optimism: float) -> None:
    rng = random.Random(6)
    process = GaussianProcess(ENTRIES)
    for _ in range(12):
        process.tell(drawn(rng), rng.gauss(0.0, 1.0))
    candidates = [drawn(rng) for _ in range(200)]

    def bound(numbers: tuple[float, ...]) -> float:
        mean, deviation = process.expected(numbers)
        return mean + optimism * deviation

    assert process.most_promising(candidates, optimism) == max(candidates, key=bound)


def test_inner_product_is_as_long_as_the_shorter() -> None:
    assert dot([1.0, 2.0, 3.0], [4.0, 5.0]) == 14.0
    assert dot([], [4.0]) == 0.0


@pytest.mark.parametrize("world", [0, 1])
def test_gain_is_known_better_than_either_score(world: int) -> None:
    """Mean and deviation of a difference, by the inverse of the kernel's matrix."""
    rng = random.Random(7)
    tried = [drawn(rng) for _ in range(6)]
    process = GaussianProcess(ENTRIES)
    for numbers in tried:
        process.tell(numbers, math.sin(numbers[1]), world)
    scales = process.scales
    places = [place_of(numbers, ENTRIES) for numbers in tried]

    def covariance(one: tuple[float, ...], other: tuple[float, ...]) -> float:
        near = nearness(stretched(one, ENTRIES, scales), stretched(other, ENTRIES, scales))
        return scales.covariance(near, world > 0)

    matrix = [[covariance(one, other) for other in places] for one in places]
    for index, row in enumerate(matrix):
        row[index] += scales.noise_variance
    inverse = inverted(matrix)
    values = [(math.sin(numbers[1]) - process.mean) / process.unit for numbers in tried]
    numbers, other = drawn(rng), drawn(rng)
    first, second = place_of(numbers, ENTRIES), place_of(other, ENTRIES)
    differences = [covariance(first, one) - covariance(second, one) for one in places]
    weighted = [dot(row, differences) for row in inverse]
    beforehand = covariance(first, first) + covariance(second, second)
    beforehand -= 2 * covariance(first, second)
    variance = beforehand - dot(differences, weighted)
    gain, deviation = process.gain(numbers, other)
    assert gain == pytest.approx(process.unit * dot(weighted, values))
    assert deviation == pytest.approx(process.unit * math.sqrt(variance))
    assert process.gain(numbers, numbers) == (0.0, 0.0)
    assert process.mean_at(numbers) - process.mean_at(other) == pytest.approx(gain)
    assert process.mean_at(numbers) == pytest.approx(process.expected(numbers)[0])


def test_scores_are_measured_by_their_own_deviation() -> None:
    process = GaussianProcess(ENTRIES)
    process.tell((10.0, 0.1), 5.0)
    assert (process.mean, process.unit) == (5.0, 1.0)
    process.tell((80.0, -0.3), 9.0)
    assert process.mean == 7.0
    assert process.unit == pytest.approx(math.sqrt(8.0))
    process.tell((200.0, 0.9), 1.0)
    assert (process.mean, process.unit) == (5.0, pytest.approx(4.0))
    assert process.noise == pytest.approx(4.0 * process.scales.noise)
    assert len(process) == 3


def test_equal_scores_have_the_least_deviation() -> None:
    process = GaussianProcess(ENTRIES)
    for speed in (0.1, 0.4):
        process.tell((10.0, speed), 2.0)
    assert process.unit == 1e-6


def test_scales_are_sought_after_a_fifth_more_trials_and_at_most_a_hundred(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts = []

    def same(surprise: Surprise, start: Sequence[float]) -> list[float]:
        counts.append(len(process))
        return list(start)

    monkeypatch.setattr(gaussian_process, "most_probable", same)
    rng = random.Random(8)
    process = GaussianProcess(ENTRIES)
    for _ in range(110):
        process.tell(drawn(rng), rng.gauss(0.0, 1.0))
    assert counts[:13] == [1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 27]
    assert counts[-3:] == [58, 70, 84]
    # The next time would be by 101 trials.
    counts.clear()
    process = GaussianProcess(ENTRIES, medians(2), 83)
    for _ in range(110):
        process.tell(drawn(rng), rng.gauss(0.0, 1.0))
    assert counts == [100]


def test_first_of_equal_candidates_is_chosen() -> None:
    process = GaussianProcess(ENTRIES)
    process.tell((10.0, 0.5), 1.0)
    first, second = [40.0, 0.2], [40.0, 0.2]
    assert process.most_promising([first, second], 2.0) is first
    assert process.most_promising([], 2.0) == ()
