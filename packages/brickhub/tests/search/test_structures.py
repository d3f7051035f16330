"""Structured policies: which interfaces they take, and their programs."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.commands import Command
from brickhub.hub.interface import (
    Channel,
    Distance,
    DriveSpeed,
    DriveTurnRate,
    Interface,
    MotorAngle,
    Pitch,
    RunSpeed,
    SensorReading,
    Wait,
    YawRate,
)
from brickhub.search.approach import Approach, approach
from brickhub.search.edge import EdgeFollowing, edge_following
from brickhub.search.structure import formula_source, source_by

DISTANCE = Distance("eye")
LIGHT = SensorReading("light", "reflection", 0, 100, "%")


def of(
    commands: tuple[Command, ...],
    channels: tuple[Channel, ...],
) -> Interface:
    """An interface of steps of 50 ms."""
    return Interface(commands, channels, Wait(50))


def test_approach_of_a_robot_that_drives_and_sees_how_far_it_is() -> None:
    found = approach(of((DriveSpeed(-300, 300),), (DISTANCE,)))
    assert found.top_mm_s == 300
    goal, gain = found.numbers
    assert (goal.name, goal.low, goal.high, goal.unit) == ("goal", 0.0, 800.0, "mm")
    assert (gain.name, gain.low, gain.high, gain.unit) == ("gain", 0.0, 6.0, "1/s")
    assert found.act([350.0], [200.0, 1.0]) == [pytest.approx(0.5)]


@pytest.mark.parametrize(
    ("commands", "channels", "problem"),
    [
        ((), (DISTANCE,), "observes one distance, and nothing else"),
        ((DriveSpeed(-9, 9), DriveTurnRate(-9, 9)), (DISTANCE,), "observes one distance"),
        ((DriveSpeed(-9, 9),), (DISTANCE, Pitch()), "observes one distance"),
        ((DriveSpeed(-9, 9), DriveTurnRate(-9, 9)), (DISTANCE, Pitch()), "observes one distance"),
        ((DriveSpeed(-9, 9),), (Pitch(),), "observes one distance"),
        ((RunSpeed("left", -9, 9),), (DISTANCE,), "commands one speed, as fast backwards"),
        ((DriveSpeed(-8, 9),), (DISTANCE,), "commands one speed, as fast backwards"),
    ],
)
def test_approach_refuses_any_other_interface(
    commands: tuple[Command, ...], channels: tuple[Channel, ...], problem: str
) -> None:
    with pytest.raises(DescriptionError, match=problem):
        approach(of(commands, channels))


def test_yaw_rate_is_read_wherever_it_is() -> None:
    commands = (DriveSpeed(0, 100), DriveTurnRate(-50, 50))
    following = edge_following(of(commands, (LIGHT, MotorAngle("left"), YawRate())), 40.0)
    assert following.yaw_rate == 2
    damping = following.numbers[-1]
    assert (damping.name, damping.low, damping.high) == ("damping", 0.0, 1.0)
    # 10 deg/s back for 20 of turning, of 50 that are possible.
    speed, turn = following.act([40.0, 123.0, -20.0], [50.0, 1.0, 0.5])
    assert (speed, turn) == (pytest.approx(0.0), pytest.approx(-0.2))


def test_speeds_of_an_edge_follower_have_their_units_and_gains_a_limit() -> None:
    following = EdgeFollowing(40.0, (20.0, 100.0), 90.0)
    assert (following.middle_mm_s, following.half_mm_s) == (60.0, 40.0)
    speed, gain = following.numbers
    assert (speed.name, speed.unit) == ("speed", "mm/s")
    assert (gain.name, gain.unit, gain.low, gain.high) == ("gain", "deg/s", -5.0, 5.0)
    # Ten percent brighter, at the largest gain: 50 of 90 deg/s.
    assert following.act([50.0], [60.0, 5.0]) == pytest.approx([0.0, 50.0 / 90.0])


@pytest.mark.parametrize(
    "commands",
    [
        (DriveTurnRate(-50, 50), DriveSpeed(0, 100)),
        (DriveSpeed(0, 100), DriveTurnRate(-50, 50), RunSpeed("arm", -9, 9)),
        (RunSpeed("arm", -9, 9), DriveTurnRate(-50, 50)),
        (DriveSpeed(0, 100), DriveTurnRate(-50, 51)),
    ],
)
def test_edge_is_followed_by_a_speed_and_then_a_turn_rate(commands: tuple[Command, ...]) -> None:
    with pytest.raises(DescriptionError, match="a turn rate to both sides"):
        edge_following(of(commands, (LIGHT,)), 40.0)


def test_program_of_an_approach_is_written_for_the_hub() -> None:
    source = Approach(250.0, 800.0, 6.0).hub_source()
    assert source.startswith("import umath\n\n\ndef approach_at(")
    assert source.endswith(
        "\n\ndef act_by(observed, numbers):\n"
        "    return [approach_at(observed[0], numbers[0], numbers[1], 250)]\n"
    )


def test_formula_of_a_hub_is_that_of_this_computer_without_its_head() -> None:
    source = formula_source("keep_upright")
    assert source.startswith("import umath\n\n\ndef keep_upright(observed, numbers):\n")
    assert source.endswith("    return max(-1.0, min(1.0, gain * off_deg / 100))\n\n")
    assert "the hub's part" not in source


def test_program_acts_by_the_numbers_that_were_found() -> None:
    structure = Approach(250.0, 800.0, 6.0)
    source = source_by(structure, (123.456789, 2.0))
    wanted = (
        "NUMBERS = (123.46, 2,)\n\n\ndef act(observed):\n    return act_by(observed, NUMBERS)\n"
    )
    assert source == f"{structure.hub_source()}\n{wanted}"
    on_hub: dict[str, Any] = {"umath": math}
    exec(source.replace("import umath", ""), on_hub)  # noqa: S102  our own program
    assert on_hub["act"]([223.46]) == [pytest.approx(0.8)]
