"""Descriptions of robots: what follows from gears and directions, and words of refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from brickhub.errors import DescriptionError
from brickhub.robot import (
    BENCH,
    Chassis,
    Direction,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.robot.spec import HUB_FLAT, LOOKS, sensor_of, with_end_stops

A, B = Motor("a", "A"), Motor("b", "B")


@pytest.mark.parametrize(
    ("gears", "turn_deg", "shaft_turns"),
    [
        ((), 360.0, 1.0),
        ((1, 1), 360.0, 1.0),
        ((20, 60), 120.0, 3.0),
        ((60, 20), 1080.0, 1 / 3),
        # What is between the first and the last one changes nothing.
        ((12, 100, 36), 120.0, 3.0),
    ],
)
def test_output_turns_less_the_more_teeth_it_has(
    gears: tuple[int, ...], turn_deg: float, shaft_turns: float
) -> None:
    motor = Motor("m", "A", gears=gears)
    assert motor.turn_deg == pytest.approx(turn_deg)
    assert motor.shaft_turns == pytest.approx(shaft_turns)
    other = replace(motor, direction=Direction.COUNTERCLOCKWISE)
    assert other.turn_deg == pytest.approx(turn_deg)
    assert other.shaft_turns == pytest.approx(-shaft_turns)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        (
            {"gears": (20,)},
            r"motor 'm': gears \(20,\) are not a train; give the teeth from motor to output, e.g.",
        ),
        (
            {"range_deg": (10, 10)},
            r"motor 'm': range \(10, 10\) is empty; give \(lowest, highest\) in degrees",
        ),
        (
            {"end_stops_deg": (5.0, 5.0)},
            r"motor 'm': end stops \(5.0, 5.0\) leave no way; give \(lowest, highest\) in degrees",
        ),
        ({"speed_limit_deg_s": 0}, "motor 'm': speed_limit_deg_s is 0; give a positive number or"),
        (
            {"kind": MotorKind.TRAIN, "torque_limit_mnm": 9},
            "motor 'm': a train motor has no encoder; omit torque_limit_mnm",
        ),
        (
            {"kind": MotorKind.TRAIN, "range_deg": (0, 9)},
            "motor 'm': a train motor has no encoder; omit range_deg",
        ),
        ({"port": 3}, "'m' is on port 3; give the port's letter, such as 'A'"),
    ],
)
def test_motor_that_cannot_be(fields: dict[str, Any], says: str) -> None:
    with pytest.raises(DescriptionError, match=f"^{says}"):
        Motor(**{"name": "m", "port": "A", **fields})


def test_plain_motor_needs_nothing() -> None:
    assert Motor("m", "A", MotorKind.TRAIN, end_stops_deg=(0.0, 5.0)).end_stops_deg == (0.0, 5.0)


EYES = UltrasonicSensor("eyes", "C")


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"name": "my robot"}, "'my robot' is not a name; use letters, digits and underscores"),
        (
            {"motors": (A, Motor("c", "A"))},
            "robot 'r': port A is used 2 times; give each device its own",
        ),
        (
            {"sensors": (UltrasonicSensor("a", "D"),)},
            "robot 'r': name a is used 2 times; give each device its own",
        ),
        (
            {"hub": HubKind.CITY, "motors": (A,), "needs_imu": True},
            "robot 'r': a city hub has no IMU; choose a prime, essential or technic hub",
        ),
        (
            {"drive_base": DriveBase("a", "b")},
            "robot 'r': its drive base has no wheel diameter or no axle track; say both in mm, or",
        ),
        (
            {"motors": (A, replace(B, gears=(1, 2))), "drive_base": DriveBase("a", "b", 56, 112)},
            "robot 'r': both motors of a drive base need the same gears",
        ),
        (
            {"hub_sides": ("up", "left")},
            "robot 'r': only the IMU depends on hub_sides; omit them, or say needs_imu=True",
        ),
        (
            {"hub_sides": ("up", "up"), "needs_imu": True},
            r"robot 'r': the hub's top and front cannot look \('up', 'up'\); give two of ahead, ",
        ),
    ],
)
def test_robot_that_cannot_be(fields: dict[str, Any], says: str) -> None:
    plain = {"name": "r", "hub": HubKind.PRIME, "motors": (A, B), "sensors": (EYES,)}
    if fields.get("hub") is HubKind.CITY:
        plain["sensors"] = ()
    with pytest.raises(DescriptionError, match=f"^{says}"):
        Robot(**{**plain, **fields})


def test_names_with_hyphens_are_for_robots_alone() -> None:
    assert Robot("two-wheeler", HubKind.PRIME).name == "two-wheeler"
    with pytest.raises(DescriptionError, match="'left-wheel' is not a name"):
        Motor("left-wheel", "A")


def test_hub_lies_flat_unless_it_is_said() -> None:
    assert Robot("r", HubKind.PRIME).hub_sides == HUB_FLAT == ("up", "ahead")
    sides = ("back", "left")
    assert Robot("r", HubKind.PRIME, needs_imu=True, hub_sides=sides).hub_sides == sides


@pytest.mark.parametrize("top", LOOKS)
@pytest.mark.parametrize("front", LOOKS)
def test_top_and_front_are_at_right_angles(top: str, front: str) -> None:
    axes = [{"ahead", "back"}, {"left", "right"}, {"up", "down"}]
    are_of_one_axis = any({top, front} <= axis for axis in axes)
    if are_of_one_axis:
        with pytest.raises(DescriptionError, match="at right angles"):
            Robot("r", HubKind.PRIME, needs_imu=True, hub_sides=(top, front))
    else:
        assert Robot("r", HubKind.PRIME, needs_imu=True, hub_sides=(top, front))


def test_robot_with_a_plan_is_checked_when_it_is_read() -> None:
    robot = Robot("r", HubKind.CITY, (A, A), needs_imu=True, plan="r.ldr")
    says = "its plan r.ldr was not read; write completed"
    with pytest.raises(DescriptionError, match=says):
        robot.check_complete()
    Robot("r", HubKind.PRIME).check_complete()


@pytest.mark.parametrize(
    ("names", "direction", "other", "sign"),
    [
        # Mounted the other way round, two that count in opposite directions turn alike.
        (("a", "b"), Direction.COUNTERCLOCKWISE, "b", 1),
        (("a", "b"), Direction.CLOCKWISE, "b", -1),
        (("b", "a"), Direction.CLOCKWISE, "b", -1),
        # One in the middle turns the other way.
        (("a", "a"), Direction.CLOCKWISE, "a", -1),
    ],
)
def test_motor_in_a_mirror(
    names: tuple[str, str], direction: Direction, other: str, sign: int
) -> None:
    robot = Robot("r", HubKind.PRIME, (A, replace(B, direction=direction)), mirrored=(names,))
    assert robot.in_mirror("a") == (other, sign)


def test_what_is_in_no_pair_is_its_own_image() -> None:
    robot = Robot("r", HubKind.PRIME, (A, B), (EYES,), mirrored=(("eyes", "eyes"),))
    assert robot.in_mirror("a") == ("a", 1)
    assert robot.in_mirror("eyes") == ("eyes", 1)
    assert robot.in_mirror("unknown") == ("unknown", 1)


def test_device_that_a_robot_lacks() -> None:
    with pytest.raises(DescriptionError, match=r"^robot 'r' has no motor 'c' \(it has: a, b\)$"):
        Robot("r", HubKind.PRIME, (A, B)).motor("c")
    with pytest.raises(DescriptionError, match=r"^robot 'r' has no sensor 'c' \(it has: none\)$"):
        Robot("r", HubKind.PRIME).sensor("c")


def test_sensor_by_its_kind() -> None:
    assert sensor_of(SensorKind.ULTRASONIC, "eyes", "C") == EYES
    light = PoweredUpSensor("light", "D", SensorKind.LIGHT)
    assert sensor_of(SensorKind.LIGHT, "light", "D") == light


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Mount((0.0, 0.0, 5.0), "north"), "a sensor cannot look 'north'; choose ahead, ba"),
        (
            lambda: Mount((0.0, 0.0, -5.0)),
            r"a sensor cannot sit at \(0.0, 0.0, -5.0\); give mm ahead, to the left and above the",
        ),
        (lambda: DriveBase("a", "a"), "drive base: left and right are both 'a'; name two motors"),
        (
            lambda: DriveBase("a", "b", -1.0),
            "drive base: wheel diameter and axle track must be positive millimetres",
        ),
        (
            lambda: Chassis(caster_mm=(5.0, 0.0), ballast_g=3.0),
            r"a chassis with its caster at \(5.0, 0.0\) mm and 3.0 g; put the caster 20 mm or more",
        ),
    ],
)
def test_parts_that_cannot_be(make: Any, says: str) -> None:
    with pytest.raises(DescriptionError, match=f"^{says}"):
        make()


def test_end_stops_keep_those_of_other_motors() -> None:
    robot = Robot("r", HubKind.PRIME, (replace(A, end_stops_deg=(0.0, 9.0)), B))
    stopped = with_end_stops(robot, {"b": (-1.0, 1.0)})
    assert [motor.end_stops_deg for motor in stopped.motors] == [(0.0, 9.0), (-1.0, 1.0)]
    anew = with_end_stops(robot, {"a": (-1.0, 1.0)})
    assert [motor.end_stops_deg for motor in anew.motors] == [(-1.0, 1.0), None]


def test_bench_has_a_motor_on_each_port() -> None:
    assert (BENCH.name, BENCH.hub, BENCH.needs_imu) == ("bench", HubKind.PRIME, True)
    assert [(motor.name, motor.port) for motor in BENCH.motors] == [
        (f"motor_{port.lower()}", port) for port in "ABCDEF"
    ]
    assert {motor.kind for motor in BENCH.motors} == {MotorKind.SPIKE_MEDIUM}
