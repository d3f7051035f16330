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
