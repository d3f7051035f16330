"""The most probable scales: how probable they are, and the way to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import cast

import pytest

from brickhub.search.scales import Surprise, medians, most_probable

Slopes = Callable[[Sequence[float]], tuple[float, list[float]]]


def test_before_any_trial_scales_are_their_medians() -> None:
    lengths_then_others = [1.7, 1.7, 0.2, 1.0, 0.3]
    assert [math.exp(one) for one in medians(2)] == pytest.approx(lengths_then_others)
    assert len(medians(5)) == 8


@pytest.mark.parametrize("worlds", [[0, 0], [1, 1], [0, 1], [1, 2]])
def test_surprise_of_two_trials_by_hand(worlds: list[int]) -> None:
    """The formulas of a matrix of two rows, and a normal distribution of the logarithms."""
    length, peculiar, amplitude, noise = 0.8, 0.3, 1.2, 0.2
    apart = 0.5
    values = [0.7, -0.4]
    surprise = Surprise([(0.1,), (0.1 + apart,)], (1,), values, worlds)
    logarithms = [math.log(one) for one in (length, peculiar, amplitude, noise)]
    square = (apart / length) ** 2
    covariance = math.exp(-square / 2)
    if worlds == [1, 1]:
        covariance += 0.25 + peculiar**2 * math.exp(-square / 2 / 0.09)
    covariance *= amplitude**2
    variances = []
    for world in worlds:
        own = 0.25 + peculiar**2 if world else 0.0
        variances.append(amplitude**2 * (1 + own) + noise**2 + 1e-8)
    first, second = variances
    determinant = first * second - covariance**2
    fit = second * values[0] ** 2 + first * values[1] ** 2
    fit -= 2 * covariance * values[0] * values[1]
    expected = fit / determinant / 2 + math.log(determinant) / 2
    # Beforehand, logarithms spread by a half.
    for logarithm, median in zip(logarithms, (1.7, 0.2, 1.0, 0.3), strict=True):
        expected += ((logarithm - math.log(median)) / 0.5) ** 2 / 2
    assert surprise(logarithms)[0] == pytest.approx(expected)


class Watched:
    """A function of logarithms, in place of the surprise; notes where it is asked."""

    def __init__(self, function: Slopes) -> None:
        self.asked: list[list[float]] = []
        self._function = function

    def __call__(self, logarithms: Sequence[float]) -> tuple[float, list[float]]:
        self.asked.append(list(logarithms))
        return self._function(logarithms)


def sought(function: Slopes, *start: float) -> tuple[list[float], list[list[float]]]:
    """The scales that are found, and all at which the function was asked."""
    watched = Watched(function)
    found = most_probable(cast("Surprise", watched), list(start))
    return found, watched.asked


def test_steps_grow_by_a_fifth_while_a_slope_keeps_its_sign() -> None:
    found, asked = sought(lambda logarithms: (-logarithms[0], [-3.0]), 1.0)
    places = [place for (place,) in asked]
    assert places[:4] == pytest.approx([1.0, 1.2, 1.44, 1.728])
    assert len(asked) == 40
    assert found == asked[-1]


def test_a_step_against_the_slope_is_half_as_long_and_not_judged_at_once() -> None:
    def valley(logarithms: Sequence[float]) -> tuple[float, list[float]]:
        (place,) = logarithms
        return abs(place), [math.copysign(1.0, place)]

    _, asked = sought(valley, 0.3)
    places = [place for (place,) in asked]
    # 0.2 and 0.24 down are too far; then 0.12 up, which no earlier slope judges.
    step_back = 0.3 - 0.2 - 0.24 + 0.12
    assert places[:4] == pytest.approx([0.3, 0.1, -0.14, step_back])
    assert places[4] == pytest.approx(step_back + 0.12)
    # The step turns at each second place from here on, by half of the step before.
    assert places[5] == pytest.approx(step_back + 0.12 - 0.06)


def test_search_ends_when_steps_are_below_half_a_percent() -> None:
    calls = 0

    def trembling(logarithms: Sequence[float]) -> tuple[float, list[float]]:
        # The sign turns at each place that is judged: every second one.
        nonlocal calls
        calls += 1
        return float(calls), [1.0 if calls % 4 in (1, 0) else -1.0]

    found, asked = sought(trembling, 0.0)
    # 0.2 is halved six times, at every second place: 0.003 is too little.
    assert found == [0.0]
    assert 10 <= len(asked) <= 14
    last_step = abs(asked[-1][0] - asked[-2][0])
    assert 0.0025 < last_step < 0.005


def test_each_logarithm_has_a_step_of_its_own() -> None:
    def tilted_valley(logarithms: Sequence[float]) -> tuple[float, list[float]]:
        first, second = logarithms
        return abs(first) - second, [math.copysign(1.0, first), -1.0]

    _, asked = sought(tilted_valley, 0.1, 0.0)
    assert [first for first, _ in asked[:3]] == pytest.approx([0.1, -0.1, 0.0])
    assert [second for _, second in asked[:3]] == pytest.approx([0.0, 0.2, 0.44])


def test_best_place_is_kept_and_an_impossible_one_ends_the_search() -> None:
    def cliff(logarithms: Sequence[float]) -> tuple[float, list[float]]:
        (place,) = logarithms
        if place > 0.5:
            raise ValueError("not positive definite")
        return place, [-1.0]

    found, asked = sought(cliff, 0.0)
    # Downhill is where the values grow, so the start was best.
    assert found == [0.0]
    assert [place for (place,) in asked] == pytest.approx([0.0, 0.2, 0.44, 0.728])


def test_equal_values_do_not_replace_the_best() -> None:
    found, _ = sought(lambda logarithms: (1.0, [-1.0]), 0.25)
    assert found == [0.25]
