from __future__ import annotations

import numpy as np
import pytest
import scipy  # its parts are imported when they are used
from hypothesis import given
from hypothesis import strategies as st

from bricksrl.errors import DescriptionError
from bricksrl.evaluation.statistics import (
    Interval,
    ends,
    interquartile_mean,
    mean,
    probability_of_improvement,
    seeds_interval,
    stratified_bootstrap_interval,
    wilson_interval,
)

SCORES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


@given(SCORES)
def test_interquartile_mean_equals_scipy_trim_mean(scores: list[float]) -> None:
    assert float(interquartile_mean(np.array(scores))) == pytest.approx(
        float(scipy.stats.trim_mean(scores, 0.25)), abs=1e-6
    )


@given(SCORES)
def test_interquartile_mean_is_bounded_and_order_free(scores: list[float]) -> None:
    value = float(interquartile_mean(np.array(scores)))
    assert min(scores) - 1e-6 <= value <= max(scores) + 1e-6
    assert value == float(interquartile_mean(np.array(scores[::-1])))


def test_interquartile_mean_ignores_one_outlier_of_five() -> None:
    assert float(interquartile_mean(np.array([1.0, 1.0, 1.0, 1.0, -1e9]))) == 1.0


def test_wilson_interval_of_few_trials() -> None:
    assert wilson_interval(0, 5).low == 0.0 and wilson_interval(5, 5).high == 1.0
    # (r + z^2 / 2n -+ z sqrt(r (1 - r) / n + z^2 / 4n^2)) / (1 + z^2 / n), z = 1.95996
    interval = wilson_interval(15, 20)
    assert (interval.low, interval.high) == pytest.approx((0.531299, 0.888138), abs=1e-6)


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 4)])
def test_invalid_counts_raise(successes: int, trials: int) -> None:
    with pytest.raises(DescriptionError, match="not a rate"):
        wilson_interval(successes, trials)


@given(st.lists(SCORES, min_size=1, max_size=4), st.integers(0, 10))
def test_bootstrap_interval_is_bounded_and_reproducible(
    strata: list[list[float]], seed: int
) -> None:
    interval = stratified_bootstrap_interval(strata, mean, seed=seed, resamples=200)
    scores = [score for stratum in strata for score in stratum]
    assert min(scores) - 1e-6 <= interval.low <= interval.high <= max(scores) + 1e-6
    assert interval == stratified_bootstrap_interval(strata, mean, seed=seed, resamples=200)


def test_bootstrap_interval_is_close_to_scipys() -> None:
    scores = np.random.default_rng(0).normal(10.0, 2.0, 50)
    ours = stratified_bootstrap_interval([scores.tolist()], mean, resamples=20_000)
    theirs = scipy.stats.bootstrap(
        (scores,), np.mean, method="percentile", n_resamples=20_000, rng=1
    ).confidence_interval
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.03)


def test_strata_are_not_mixed() -> None:
    # within each stratum all scores are equal, so that nothing is left to chance; mixed, it would
    # be
    assert stratified_bootstrap_interval([[0.0] * 5, [1.0] * 5], mean) == Interval(0.5, 0.5)


@pytest.mark.parametrize("strata", [[], [[1.0], []]])
def test_empty_strata_raise(strata: list[list[float]]) -> None:
    with pytest.raises(DescriptionError, match="at least one score"):
        stratified_bootstrap_interval(strata)


@pytest.mark.parametrize("confidence", [0.8, 0.95, 0.99])
def test_wilson_interval_equals_scipys(confidence: float) -> None:
    for trials in range(1, 8):
        for successes in range(trials + 1):
            ours = wilson_interval(successes, trials, confidence=confidence)
            test = scipy.stats.binomtest(successes, trials)
            theirs = test.proportion_ci(confidence, method="wilson")
            assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)
    assert wilson_interval(3, 7) == wilson_interval(3, 7, confidence=0.95)


def test_wrong_counts_name_what_is_right() -> None:
    with pytest.raises(DescriptionError) as raised:
        wilson_interval(3, 2)
    assert str(raised.value) == "3 successes in 2 trials is not a rate; give 0 to 2 of 1 or more"
    with pytest.raises(DescriptionError) as raised:
        wilson_interval(0, 0)
    assert str(raised.value) == "0 successes in 0 trials is not a rate; give 0 to 1 of 1 or more"


def test_interval_of_seeds_is_of_the_statistic_that_is_asked_for() -> None:
    scores = [0.0, 0.0, 0.0, 0.0, 100.0]
    robust = seeds_interval(scores)
    plain = seeds_interval(scores, mean)
    assert robust is not None and plain is not None
    assert robust == stratified_bootstrap_interval([scores], interquartile_mean)
    assert plain == stratified_bootstrap_interval([scores], mean)
    assert (plain.low, plain.high) == (0.0, 60.0), "in one resample of 40 three are the 100"
    assert seeds_interval(scores[:4]) is None
    assert ends(plain) == [0.0, 60.0] and ends(None) is None


def test_probability_of_improvement_has_the_interval_of_its_bootstrap() -> None:
    """Two samples that overlap by half, and the resamples of another generator."""
    first = np.linspace(0.0, 1.0, 40)
    second = first - 0.25
    wins = np.greater.outer(first, second) + 0.5 * np.equal.outer(first, second)
    rng = np.random.default_rng(99)
    shares = []
    for _ in range(4000):
        rows = rng.integers(0, 40, 40)
        columns = rng.integers(0, 40, 40)
        shares.append(wins[np.ix_(rows, columns)].mean())
    probability, interval = probability_of_improvement(first.tolist(), second.tolist())
    assert probability == pytest.approx(wins.mean())
    assert interval is not None
    wanted = np.quantile(shares, (0.025, 0.975))
    assert (interval.low, interval.high) == pytest.approx(tuple(wanted), abs=0.01)


@pytest.mark.parametrize(("first", "second"), [(5, 4), (4, 5), (5, 5)])
def test_probability_has_an_interval_where_both_have_five_runs(first: int, second: int) -> None:
    probability, interval = probability_of_improvement([1.0] * first, [0.0] * second)
    assert probability == 1.0
    assert interval == (Interval(1.0, 1.0) if first == second else None)


@pytest.mark.parametrize(("first", "second"), [([], [1.0]), ([1.0], [])])
def test_comparison_with_nothing_is_refused(first: list[float], second: list[float]) -> None:
    with pytest.raises(DescriptionError, match="^a comparison needs at least one score of each;"):
        probability_of_improvement(first, second)
