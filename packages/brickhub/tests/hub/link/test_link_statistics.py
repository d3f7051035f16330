"""Statistics of a link."""

from __future__ import annotations

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.hub.link.timing import percentile


@given(st.lists(st.floats(0.0, 10.0), min_size=2))
def test_percentiles_are_interpolated(values: list[float]) -> None:
    hundredths = statistics.quantiles(values, n=100, method="inclusive")
    assert [percentile(values, percent) for percent in (1, 50, 99)] == pytest.approx(
        [hundredths[i] for i in (0, 49, 98)]
    )
    assert (percentile(values, 0), percentile(values, 100)) == (min(values), max(values))


def test_percentile_of_one_value() -> None:
    assert percentile([0.3], 99) == 0.3
