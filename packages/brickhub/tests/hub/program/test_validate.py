"""Validation errors with remedies."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
from described import ROBO_ARM, RUN_AWAY, SPINNING, TWO_WHEELER

from brickhub.errors import BricksError, DescriptionError, ProgramError
from brickhub.hub.interface import (
    Distance,
    DriveStraight,
    Interface,
    MotorAngle,
    Pitch,
    RunAngle,
    SensorReading,
    UntilDone,
    Wait,
    YawRate,
)
from brickhub.hub.program.generate import generate, validate
from brickhub.robot import DriveBase, HubKind, Motor, PoweredUpSensor, Robot, SensorKind

LEFT = RunAngle("left", -100, 100, 400)


def changed(**fields: Any) -> Interface:
    return dataclasses.replace(SPINNING, **fields)


@pytest.mark.parametrize("interface", [RUN_AWAY, SPINNING])
def test_paper_interfaces_are_valid(interface: Interface) -> None:
    validate(TWO_WHEELER, interface)


@pytest.mark.parametrize(
    ("interface", "message"),
    [
        (changed(commands=(RunAngle("tail", -1, 1, 10),)), "no motor 'tail'"),
        (changed(channels=(MotorAngle("tail"),)), "no motor 'tail'"),
        (changed(channels=(Distance("nose"),)), "no sensor 'nose'"),
        (changed(channels=()), "no channels"),
        (changed(channels=(Pitch(), Pitch())), "'pitch' is named 2 times"),
        (changed(commands=(LEFT, LEFT)), "'left' is named 2 times"),
        (
            changed(commands=(LEFT, DriveStraight(-1, 1))),
            "'left' is moved by the commands 'left' and 'straight'",
        ),
        (changed(commands=(RunAngle("left", 10, 10, 400),)), "give low < high"),
        (changed(commands=(RunAngle("left", -3277, 10, 400),)), r"within \+-3276.7"),
        (changed(commands=(RunAngle("left", float("nan"), 10, 400),)), "ranges from nan"),
        (changed(commands=(RunAngle("left", -1, 1, 0),)), "speed 0"),
        (changed(channels=(MotorAngle("left", 0, 4000),)), "'left_angle' ranges from 0 to 4000"),
        (changed(settle=Wait(0)), "0 ms"),
        (changed(settle=UntilDone(70_000)), "70000 ms"),
        (changed(settle=Wait(0.1 * 1000)), "time_ms is 100.0; give a whole number"),  # type: ignore[arg-type]
    ],
)
def test_mismatches_raise(interface: Interface, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        validate(TWO_WHEELER, interface)


def test_too_many_commands_raise() -> None:
    commands = tuple(RunAngle(f"m{index}", -1, 1, 10) for index in range(9))
    with pytest.raises(DescriptionError, match="at most 8"):
        validate(TWO_WHEELER, changed(commands=commands))


@pytest.mark.parametrize(
    ("reading", "message"),
    [
        (
            SensorReading("light", "hsv", 0, 100),
            "hsv.. is 3 numbers; give as part one of hue, saturation, value",
        ),
        (SensorReading("light", "hsv", 0, 100, part="pitch"), "one of hue, saturation, value"),
        (SensorReading("light", "reflection", 0, 100, part="hue"), "reflection.. is one number"),
    ],
)
def test_reading_is_one_number(reading: SensorReading, message: str) -> None:
    robot = Robot("seer", HubKind.PRIME, sensors=(PoweredUpSensor("light", "B", SensorKind.COLOR),))
    with pytest.raises(DescriptionError, match=message):
        validate(robot, Interface((), (reading,), Wait(100)))


def test_driving_needs_drive_base() -> None:
    with pytest.raises(DescriptionError, match="no drive base"):
        validate(
            ROBO_ARM, Interface((DriveStraight(-1, 1),), (MotorAngle("low", 10, 70),), UntilDone())
        )


def test_wheels_have_no_range() -> None:
    motors = (Motor("left", "A", range_deg=(0, 90)), Motor("right", "B"))
    robot = Robot(
        "odd", HubKind.PRIME, motors=motors, drive_base=DriveBase("left", "right", 56, 130)
    )
    with pytest.raises(DescriptionError, match="wheels turn endlessly"):
        validate(robot, Interface((DriveStraight(-1, 1),), (MotorAngle("left"),), UntilDone()))


@pytest.mark.parametrize("channel", [Pitch(), YawRate()])
def test_a_city_hub_has_no_imu(channel: Pitch | YawRate) -> None:
    robot = Robot("tram", HubKind.CITY, motors=(Motor("left", "A"),))
    with pytest.raises(DescriptionError, match="IMU"):
        validate(robot, Interface((LEFT,), (channel,), Wait(10)))


def test_move_hub_raises() -> None:
    robot = Robot("vernie", HubKind.MOVE, motors=(Motor("left", "A"),))
    with pytest.raises(ProgramError, match="is not supported; choose a prime"):
        generate(robot, Interface((LEFT,), (MotorAngle("left"),), Wait(10)))


def test_validation_messages_have_remedies() -> None:
    with pytest.raises(BricksError) as info:
        validate(TWO_WHEELER, changed(channels=()))
    assert "\n" not in str(info.value) and ";" in str(info.value)
