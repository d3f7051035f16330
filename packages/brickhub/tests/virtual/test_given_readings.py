"""Readings, end stops and start angles of a command line: what they are for, what suits them."""

from __future__ import annotations

import pytest

from brickhub.errors import DescriptionError, TwinError
from brickhub.robot import Direction, HubKind, Motor, MotorKind, Robot, Sense, SensorKind
from brickhub.virtual.given_readings import (
    GivenReading,
    end_stops_of,
    parse_device,
    parse_end_stop,
    parse_reading,
    parse_start,
)


@pytest.mark.parametrize(
    ("device", "value", "sense"),
    [
        ("ColorSensor", "red", Sense.SURFACE),
        ("ColorSensor", "40%", Sense.SURFACE),
        ("ColorSensor", "120,80,50", Sense.SURFACE),
        ("ColorSensor", ".ambient=20%", Sense.AMBIENT),
        ("UltrasonicSensor", "200mm", Sense.DISTANCE),
        ("UltrasonicSensor", "200", Sense.DISTANCE),
        ("ForceSensor", "3N", Sense.FORCE),
        ("ForceSensor", "pressed", Sense.FORCE),
        ("TiltSensor", "10,-5deg", Sense.TILT),
        ("InfraredSensor", ".count=4", Sense.COUNT),
        ("Ev3GyroSensor", "90deg", Sense.ROTATION),
        ("Ev3GyroSensor", "90", Sense.ROTATION),
        ("Ev3GyroSensor", "90,15", Sense.ROTATION),
        ("Ev3InfraredSensor", ".beacon=40,-10", Sense.BEACON),
        ("Ev3InfraredSensor", "40%", Sense.DISTANCE),
    ],
)
def test_reading_is_for_the_sense_that_suits_it(device: str, value: str, sense: Sense) -> None:
    named = value if value.startswith(".") else f"={value}"
    assert parse_reading(f"B{named}").sense_of(device) == sense


@pytest.mark.parametrize(
    ("device", "value", "says"),
    [
        ("ColorSensor", "=1,2", "is not a surface"),
        ("ColorSensor", ".ambient=1,2", "is not a ambient"),
        ("UltrasonicSensor", "=1,2", "is not a distance"),
        ("UltrasonicSensor", "=red", "senses distance, not surface"),
        ("ForceSensor", "=1,2", "is not a force"),
        ("TiltSensor", "=10deg", "is not a tilt"),
        ("TiltSensor", "=1,2,3", "is not a tilt"),
        ("Ev3GyroSensor", "=1,2,3", "is not a rotation"),
        ("Ev3InfraredSensor", ".beacon=40", "is not a beacon"),
        ("Light", "=40%", "senses nothing"),
    ],
)
def test_reading_that_does_not_suit_is_refused(device: str, value: str, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        parse_reading(f"B{value}").sense_of(device)


def test_value_holds_from_its_time_on_and_the_first_one_before() -> None:
    reading = GivenReading("B", None, (1.0, 2.0), (10.0, 20.0))
    assert [reading.at(time_s) for time_s in (0.0, 1.0, 1.9, 2.0, 9.0)] == [10, 10, 10, 20, 20]


@pytest.mark.parametrize(
    ("text", "port", "stops"),
    [("C=-90..120", "C", (-90, 120)), ("c=0..10", "C", (0, 10)), ("A=-5.5..0", "A", (-5.5, 0))],
)
def test_end_stops(text: str, port: str, stops: tuple[float, float]) -> None:
    assert parse_end_stop(text) == (port, stops)


@pytest.mark.parametrize("text", ["C=5..10", "C=-10..-5", "C=-90", "G=-1..1", "C=1..2..3", ""])
def test_pairs_that_are_no_end_stops(text: str) -> None:
    with pytest.raises(DescriptionError, match="give"):
        parse_end_stop(text)


@pytest.mark.parametrize(
    ("text", "port", "angle_deg"),
    [("A=90", "A", 90), ("b = -180", "B", -180), ("S2=179.5", "2", 179.5)],
)
def test_starts(text: str, port: str, angle_deg: float) -> None:
    assert parse_start(text) == (port, angle_deg)


@pytest.mark.parametrize("text", ["A=180", "A=-180.5", "A=x", "A", "G=1"])
def test_angles_beyond_a_turn_are_no_starts(text: str) -> None:
    with pytest.raises(DescriptionError, match="is not a start angle"):
        parse_start(text)


def test_end_stops_of_a_robot_are_angles_of_its_outputs() -> None:
    """A third of the shaft's; for a motor that counts the other way round, low and high change
    places."""
    motor = Motor("arm", "A", direction=Direction.COUNTERCLOCKWISE, gears=(12, 36))
    robot = Robot("one", HubKind.PRIME, (motor,))
    assert end_stops_of(robot, ["A=-90..120"]) == {"arm": (-40.0, 30.0)}
    with pytest.raises(DescriptionError, match="no motor on port B for an end stop"):
        end_stops_of(robot, ["B=-90..120"])


@pytest.mark.parametrize(
    ("text", "device"),
    [
        ("A=interactive", ("A", MotorKind.INTERACTIVE)),
        ("b=colorsensor", ("B", SensorKind.COLOR)),
        ("S1=TouchSensor", ("1", SensorKind.EV3_TOUCH)),
        ("2=GyroSensor", ("2", SensorKind.EV3_GYRO)),
        ("C=Nothing", ("C", None)),
    ],
)
def test_devices_on_ports(text: str, device: tuple[str, object]) -> None:
    assert parse_device(text) == device


@pytest.mark.parametrize("text", ["A=", "G=interactive", "A=engine", "interactive"])
def test_what_is_no_device_is_refused(text: str) -> None:
    with pytest.raises(DescriptionError, match="is not a device on a port"):
        parse_device(text)
