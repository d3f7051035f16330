"""Keeping upright on two wheels: on a computer and on a hub."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.interface import (
    Interface,
    Pitch,
    PitchRate,
    RunDuty,
    RunSpeed,
    Wait,
    WheelsAngle,
    WheelsSpeed,
)
from brickhub.search.upright import upright

CHANNELS = (
    Pitch(),
    PitchRate(),
    WheelsAngle("left", "right"),
    WheelsSpeed("left", "right"),
)
INTERFACE = Interface((RunDuty("left"), RunDuty("right")), CHANNELS, Wait(20))


def test_the_wheels_drive_below_a_robot_that_falls_and_the_hub_computes_the_same() -> None:
    structure = upright(INTERFACE)
    source = structure.hub_source().replace("import umath", "")
    on_hub: dict[str, Any] = {"umath": math}
    exec(source, on_hub)  # noqa: S102  our own program
    # A lean of 1 degree, 10 % for each degree, 0.05 s ahead, 0.01 for what it has rolled.
    numbers = (1.0, 10.0, 0.05, 0.01, 0.01)
    wanted = {
        (1.0, 0.0, 0.0, 0.0): 0.0,
        (3.0, 0.0, 0.0, 0.0): 0.2,
        (1.0, 20.0, 0.0, 0.0): 0.1,
        (1.0, 0.0, -100.0, 0.0): -0.1,
        (1.0, 0.0, 0.0, 200.0): 0.2,
        (20.0, 0.0, 0.0, 0.0): 1.0,
    }
    for observed, action in wanted.items():
        assert structure.act(observed, numbers) == pytest.approx([action, action])
        assert on_hub["act_by"](observed, numbers) == pytest.approx([action, action])


@pytest.mark.parametrize(
    "interface",
    [
        Interface((RunDuty("left"),), CHANNELS, Wait(20)),
        Interface((RunSpeed("left", -9, 9), RunSpeed("right", -9, 9)), CHANNELS, Wait(20)),
        Interface(INTERFACE.commands, CHANNELS[1:], Wait(20)),
    ],
)
def test_other_interfaces_are_refused(interface: Interface) -> None:
    with pytest.raises(DescriptionError, match="commands the voltages of two wheels"):
        upright(interface)


def test_a_search_reaches_as_far_as_a_robot_of_this_size_needs() -> None:
    """What each number does at the ends of its range, as shares of the voltage."""
    structure = upright(INTERFACE)
    lowest, highest = (
        dict(zip((entry.name for entry in structure.numbers), ends, strict=True))
        for ends in zip(*((entry.low, entry.high) for entry in structure.numbers), strict=True)
    )

    def share(*observed: float, **numbers: float) -> float:
        chosen = dict.fromkeys(lowest, 0.0) | {"gain": 1.0} | numbers
        first, second = structure.act(observed, [*chosen.values()])
        assert first == second
        return first

    # All of the voltage at 2.5 degrees, or at 50.
    assert share(2.5, 0.0, 0.0, 0.0, gain=highest["gain"]) == pytest.approx(1.0)
    assert share(2.4, 0.0, 0.0, 0.0, gain=highest["gain"]) < 1.0
    assert share(50.0, 0.0, 0.0, 0.0, gain=lowest["gain"]) == pytest.approx(1.0)
    # A lean to both sides alike, by default of 6 degrees.
    assert share(6.0, 0.0, 0.0, 0.0, lean=highest["lean"]) == 0.0
    assert share(-6.0, 0.0, 0.0, 0.0, lean=lowest["lean"]) == 0.0
    # Ten degrees after a turn of the wheels, or at a turn in a second.
    assert share(0.0, 0.0, 360.0, 0.0, by_angle=highest["by_angle"]) == pytest.approx(0.1, abs=0.01)
    assert share(0.0, 0.0, 0.0, 360.0, by_speed=highest["by_speed"]) == pytest.approx(0.1, abs=0.01)
    assert share(0.0, 100.0, 0.0, 0.0, ahead=highest["ahead"]) == pytest.approx(0.1)
    assert [lowest[name] for name in ("ahead", "by_angle", "by_speed")] == [0.0, 0.0, 0.0]
    assert upright(INTERFACE, 3.5).numbers[0].low == -3.5
