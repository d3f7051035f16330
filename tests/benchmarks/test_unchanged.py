"""Results that a change of the code has not moved."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.unchanged import LEAST, compared, numbers

RETURNS = [float(number) for number in range(LEAST)]


def result(returns: list[float], cpu_s: float, **more: Any) -> dict[str, Any]:
    measured = {"agents": {"sac": {"returns": returns, "cpu_s": cpu_s}}, **more}
    return {**measured, "machine": {"cores": 2}, "versions": {}, "code": {"commit": "1"}}


def test_numbers_are_known_by_their_places() -> None:
    found = dict(numbers({"a": [1, 2.5], "b": {"c": True}, "d": "3"}))
    assert found == {"a[0]": 1, "a[1]": 2.5, "b.c": True}


def test_times_are_left_out_and_all_else_has_to_be_equal() -> None:
    nows = [result(RETURNS, 2.0), result(RETURNS, 3.0)]
    same = compared([result(RETURNS, 9.0)], nows)
    assert same.is_unchanged
    assert (same.same, same.moved) == (LEAST, ())
    other = compared([result([*RETURNS[:-1], 9.5], 2.0)], nows)
    assert not other.is_unchanged
    assert other.moved == ("agents.sac.returns[9]: 9.5 then, 9.0 now",)


def test_a_time_that_is_the_same_twice_is_found_by_a_third_run() -> None:
    thens = [result(RETURNS, 9.0)]
    nows = [result(RETURNS, 2.0), result(RETURNS, 2.0)]
    assert compared(thens, nows).moved == ("agents.sac.cpu_s: 9.0 then, 2.0 now",)
    assert compared(thens, [*nows, result(RETURNS, 2.5)]).is_unchanged
    assert compared([*thens, result(RETURNS, 8.0)], nows).is_unchanged


@pytest.mark.parametrize(
    ("then", "now"),
    [
        # too few numbers say nothing
        (result(RETURNS[1:], 1.0), result(RETURNS[1:], 1.5)),
        (result(RETURNS, 1.0, falls=3), result(RETURNS, 1.5)),
        (result(RETURNS, 1.0), result(RETURNS, 1.5, falls=3)),
        (result(RETURNS, 1.0), result(RETURNS[1:], 1.5)),
    ],
)
def test_what_is_gone_new_or_too_little_is_not_unchanged(
    then: dict[str, Any], now: dict[str, Any]
) -> None:
    agents = now["agents"]["sac"]
    again = {**now, "agents": {"sac": {**agents, "cpu_s": 2.0}}}
    assert not compared([then], [now, again]).is_unchanged
