from __future__ import annotations

import numpy as np
import pytest
import scipy  # its parts are imported when they are used
from hypothesis import given
from hypothesis import strategies as st

from bricksrl.errors import DescriptionError
from bricksrl.evaluation.statistics import (
    Interval,
    interquartile_mean,
    mean,
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
