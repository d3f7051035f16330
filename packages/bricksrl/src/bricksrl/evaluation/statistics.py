"""Statistics of few runs: robust means, confidence intervals, probability of improvement."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import DescriptionError

Statistic = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Statistic of scores: ``[*batch, n]`` to ``[*batch]``."""


@dataclass(frozen=True)
class Interval:
    """Closed interval from ``low`` to ``high``."""

    low: float
    high: float


def ends(interval: Interval | None) -> list[float] | None:
    """Both ends of an interval, if there is one, for JSON."""
    return None if interval is None else [interval.low, interval.high]


def mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the last axis: ``[*batch, n]`` to ``[*batch]``."""
    return np.asarray(np.mean(scores, axis=-1), dtype=np.float64)


def interquartile_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean without the lowest and highest quarter (rounded down): ``[*batch, n]`` to ``[*batch]``.

    Robust against failed runs like the median, but uses half of the scores.
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=-1)
    n = ordered.shape[-1]
    cut = n // 4
    return mean(ordered[..., cut : n - cut])


def stratified_bootstrap_interval(
    strata: Sequence[Sequence[float]],
    statistic: Statistic = interquartile_mean,
    *,
    resamples: int = 2000,
    seed: int = 0,
) -> Interval:
    """95 % percentile bootstrap interval of a statistic of all scores, resampled within each
    stratum. Raises DescriptionError if there is no stratum, or an empty one.

    Args:
        strata: scores by group, for instance the episodes of each run, or the runs of each task.
        seed: the same seed gives the same interval.
    """
    if not strata or any(len(stratum) == 0 for stratum in strata):
        raise DescriptionError(
            "a bootstrap needs at least one score in each stratum; leave out the empty ones"
        )
    rng = np.random.default_rng(seed)
    parts = []
    # Each stratum keeps its share, so that a run with more episodes does not outweigh the others.
    for stratum in strata:
        scores = np.asarray(stratum, dtype=np.float64)
        drawn = rng.integers(0, scores.size, (resamples, scores.size))
        parts.append(scores[drawn])
    values = statistic(np.concatenate(parts, axis=-1))  # [resamples]
    low, high = np.quantile(values, (0.025, 0.975))
    return Interval(float(low), float(high))


FEWEST_SEEDS = 5
"""Fewest runs for a meaningful interval."""


def seeds_interval(
    scores: Sequence[float], statistic: Statistic = interquartile_mean
) -> Interval | None:
    """95 % bootstrap interval of a statistic of one score per seed or episode; ``None`` for fewer
    than `FEWEST_SEEDS`."""
    # Three scores have few different resamples, so an interval of so few would look more certain
    # than it is.
    if len(scores) < FEWEST_SEEDS:
        return None
    return stratified_bootstrap_interval([scores], statistic)


def probability_of_improvement(
    scores: Sequence[float], others: Sequence[float]
) -> tuple[float, Interval | None]:
    """Probability that a run of the first kind scores higher than one of the second; equal scores
    count half. Raises DescriptionError if one of the two is empty.

    It is the mean over all pairs (Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of
    the Statistical Precipice").

    Returns:
        The probability, and its 95 % bootstrap interval, or ``None`` where one of the two has fewer
        than five runs.
    """
    if not scores or not others:
        raise DescriptionError(
            "a comparison needs at least one score of each; leave out what has none"
        )
    first = np.asarray(scores, dtype=np.float64)
    second = np.asarray(others, dtype=np.float64)

    def share(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        higher = a[..., :, None] > b[..., None, :]
        equal = a[..., :, None] == b[..., None, :]
        return np.asarray((higher + 0.5 * equal).mean((-2, -1)), dtype=np.float64)

    probability = float(share(first, second))
    if min(first.size, second.size) < FEWEST_SEEDS:
        return probability, None
    rng = np.random.default_rng(0)
    drawn = [x[rng.integers(0, x.size, (2000, x.size))] for x in (first, second)]
    low, high = np.quantile(share(*drawn), (0.025, 0.975))
    return probability, Interval(float(low), float(high))


def wilson_interval(
    successes: int,
    trials: int,
    *,
    confidence: float = 0.95,
) -> Interval:
    """Wilson score interval of a success rate, valid for few trials and for rates of 0 and 1.
    Raises DescriptionError if there are no trials, or the successes are not between 0 and
    ``trials``."""
    if trials < 1 or not 0 <= successes <= trials:
        raise DescriptionError(
            f"{successes} successes in {trials} trials is not a rate; give 0 to {max(trials, 1)} "
            "of 1 or more"
        )
    z = NormalDist().inv_cdf((1.0 + confidence) / 2)
    rate = successes / trials
    # The rate is drawn towards one half, as if z ** 2 trials more had half succeeded.
    centre = (successes + z**2 / 2) / (trials + z**2)
    half_width = z * math.sqrt(trials * rate * (1.0 - rate) + z**2 / 4) / (trials + z**2)
    # At the ends the two are equal but for their last digits.
    low = 0.0 if successes == 0 else centre - half_width
    high = 1.0 if successes == trials else centre + half_width
    return Interval(low, high)
