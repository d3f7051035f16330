"""A robot and its numbers in a mirror from left to right."""

from __future__ import annotations

from dataclasses import replace

import pytest
from described import TWO_WHEELER, WALKER

from brickhub.hub.commands import WireNumber
from brickhub.hub.interface import (
    Curve,
    Distance,
    DriveAngle,
    DriveDistance,
    DriveStraight,
    DriveTurnRate,
    Heading,
    MotorAngle,
    Pitch,
    Roll,
    RunAngle,
    SensorReading,
    YawRate,
)
from brickhub.robot import Direction, HubKind, Motor, MotorKind, PoweredUpSensor, Robot, SensorKind

MIRRORED = replace(WALKER, mirrored=(("left_front", "right_front"), ("left_back", "right_back")))
"""Legs on the two sides turn in opposite directions, so that their angles count alike."""
ALIKE = replace(
    TWO_WHEELER,
    motors=tuple(replace(motor, direction=Direction.CLOCKWISE) for motor in TWO_WHEELER.motors),
    mirrored=(("left", "right"),),
)
TWO_SIDED = replace(
    ALIKE,
    hub=HubKind.EV3,
    motors=(
        Motor("left", "B", MotorKind.EV3_LARGE),
        Motor("right", "C", MotorKind.EV3_LARGE),
    ),
    sensors=(),
    needs_imu=False,
)


@pytest.mark.parametrize(
    ("number", "robot", "expected"),
    [
        (Pitch(), TWO_WHEELER, ("pitch", 1)),
        (Roll(), TWO_WHEELER, ("roll", -1)),
        (YawRate(), TWO_WHEELER, ("yaw_rate", -1)),
        (Heading(), TWO_WHEELER, ("heading", -1)),
        (Distance("eyes"), TWO_WHEELER, ("distance", 1)),
        (DriveDistance(-100, 100), TWO_WHEELER, ("drive_distance", 1)),
        (DriveAngle(-100, 100), TWO_WHEELER, ("drive_angle", -1)),
        (DriveStraight(-100, 100), TWO_WHEELER, ("straight", 1)),
        (DriveTurnRate(-100, 100), TWO_WHEELER, ("turn_rate", -1)),
        # A circle to the other side is none of the robot's commands.
        (Curve(-90, 90, radius_mm=100), TWO_WHEELER, ("curve", 0)),
        (MotorAngle("left_back"), MIRRORED, ("right_back_angle", 1)),
        (RunAngle("right_front", -100, 0, 600), MIRRORED, ("left_front", 1)),
        # Without pairs everything stays where it is.
        (MotorAngle("left_back"), WALKER, ("left_back_angle", 1)),
        # Two motors that count alike are mirror images that turn the other way.
        (MotorAngle("left"), ALIKE, ("right_angle", -1)),
        (RunAngle("right", -100, 100, 400), ALIKE, ("left", -1)),
        # The shafts of EV3's large motors go through, so that both sides have them alike.
        (MotorAngle("left"), TWO_SIDED, ("right_angle", 1)),
    ],
)
def test_numbers_in_a_mirror(number: WireNumber, robot: Robot, expected: tuple[str, int]) -> None:
    assert number.in_mirror(robot) == expected


def test_reading_is_that_of_the_sensor_on_the_other_side() -> None:
    sensors = tuple(
        PoweredUpSensor(name, port, SensorKind.COLOR)
        for name, port in (("left_eye", "B"), ("right_eye", "D"))
    )
    robot = replace(TWO_WHEELER, sensors=sensors, mirrored=(("left_eye", "right_eye"),))
    reading = SensorReading("left_eye", "reflection", 0, 100)
    assert reading.in_mirror(robot) == (replace(reading, sensor="right_eye").name, 1)
