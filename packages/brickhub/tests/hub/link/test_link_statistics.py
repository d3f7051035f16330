"""Statistics of a link."""

from __future__ import annotations

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.hub.link.timing import HubClock, LinkStatistics, percentile


@given(st.lists(st.floats(0.0, 10.0), min_size=2))
def test_percentiles_are_interpolated(values: list[float]) -> None:
    hundredths = statistics.quantiles(values, n=100, method="inclusive")
    assert [percentile(values, percent) for percent in (1, 50, 99)] == pytest.approx(
        [hundredths[i] for i in (0, 49, 98)]
    )
    assert (percentile(values, 0), percentile(values, 100)) == (min(values), max(values))


def test_percentile_of_one_value() -> None:
    assert percentile([0.3], 99) == 0.3


def test_percentiles_are_of_the_last_500_exchanges() -> None:
    counted = LinkStatistics()
    assert (counted.round_trip_p50_s, counted.age_p99_s) == (0.0, 0.0)
    for number in range(700):
        counted.record(round_trip_s=float(number), age_s=1000.0 + number)
    assert counted.exchanges == 700
    assert counted.round_trip_p50_s == pytest.approx(449.5)
    assert counted.round_trip_p99_s == pytest.approx(694.01)
    assert counted.age_p50_s == pytest.approx(1449.5)
    assert counted.age_p99_s == pytest.approx(1694.01)


def test_a_clock_of_16_bits_goes_on_and_an_age_is_between_its_bounds() -> None:
    clock = HubClock()
    assert clock.age_s(500, 9.0) == 0.0
    assert [clock.unwrap(time_ms) for time_ms in (60_000, 65_535, 0, 10, 10, 9)] == [
        60_000,
        65_535,
        65_536,
        65_546,
        65_546,
        131_081,
    ]
    # The hub's 0 was between 9.5 s and 10.5 s, then between 9.9 s and 11 s: at 10.2 s, to 0.3 s.
    clock.compare(1000, 10.5, 11.5)
    assert clock.age_s(1000, 12.0) == pytest.approx(1.0)
    clock.compare(2000, 11.9, 13.0)
    assert clock.age_s(2000, 13.0) == pytest.approx(0.8)
    assert clock.age_s(2000, 12.0) == 0.0, "nothing is younger than now"
    # Bounds that contradict each other, as clocks drift: the upper one counts.
    clock.compare(3000, 14.0, 14.5)
    assert clock.age_s(3000, 14.0) == pytest.approx(0.5)


def test_clocks_are_compared_by_the_last_200_exchanges_alone() -> None:
    """The hub's clock loses a millisecond in each exchange, which no older one may outweigh."""
    clock = HubClock()
    for number in range(500):
        clock.compare(1000, 10.0 + 0.001 * number, 10.1 + 0.001 * number)
    # The tightest bounds of exchanges 300 to 499: not before 10.499 s, arrived by 10.4 s.
    assert clock.age_s(1000, 11.0) == pytest.approx(0.6)
    clock = HubClock()
    for number in range(500):
        clock.compare(1000, 10.0 - 0.001 * number, 11.0 - 0.001 * number)
    # Not before 9.7 s, arrived by 10.501 s.
    assert clock.age_s(1000, 11.0) == pytest.approx(11.0 - (9.7 + 10.501) / 2)
