"""Following of an edge: on a computer and on a hub."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.commands import DriveSpeed, DriveTurnRate
from brickhub.hub.interface import Interface, SensorReading, Wait
from brickhub.search.edge import edge_following

LIGHT = SensorReading("light", "reflection", 0, 100, "%")


def test_the_turn_is_in_proportion_to_the_brightness_and_the_hub_computes_the_same() -> None:
    commands = (DriveSpeed(0, 200), DriveTurnRate(-100, 100))
    following = edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0)
    wanted = {40.0: 0.0, 60.0: 0.4, 30.0: -0.2, 100.0: 1.0, 0.0: -0.8}
    on_hub: dict[str, Any] = {"umath": math}
    source = following.hub_source().replace("import umath", "")
    exec(source, on_hub)  # noqa: S102  our own program
    for reflection_pct, turn in wanted.items():
        actions = [pytest.approx(-0.5), pytest.approx(turn)]
        assert following.act([reflection_pct], (50.0, 2.0)) == actions
        assert on_hub["act_by"]([reflection_pct], (50.0, 2.0)) == actions


@pytest.mark.parametrize(
    "commands",
    [(DriveSpeed(0, 200),), (DriveSpeed(0, 200), DriveTurnRate(-50, 100))],
)
def test_other_commands_are_refused(commands: tuple[DriveSpeed | DriveTurnRate, ...]) -> None:
    with pytest.raises(DescriptionError, match="a turn rate to both sides"):
        edge_following(Interface(commands, (LIGHT,), Wait(50)), 40.0)
