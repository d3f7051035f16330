"""Robot descriptions: validation with remedies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.errors import DescriptionError
from brickhub.robot import (
    Chassis,
    DriveBase,
    HubKind,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    Sensor,
    SensorKind,
    UltrasonicSensor,
)
from brickhub.robot.spec import sensor_of, with_end_stops

names = st.from_regex(r"[a-z_][a-z0-9_]{0,8}", fullmatch=True)
hubs = st.sampled_from(HubKind)


@st.composite
def descriptions(draw: st.DrawFn) -> Robot:
    """Any valid robot."""
    hub = draw(hubs)
    count = draw(st.integers(0, len(hub.model.ports)))
    device_names = draw(st.lists(names, min_size=count, max_size=count, unique=True))
    ports = draw(st.permutations(hub.model.ports))
    motors: tuple[Motor, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    for name, port in zip(device_names, ports, strict=False):
        kinds = [kind for kind in (*MotorKind, *SensorKind) if port in hub.model.takes(kind.model)]
        kind = draw(st.sampled_from(kinds))
        if isinstance(kind, MotorKind):
            motors += (Motor(name, port, kind=kind),)
        else:
            sensors += (sensor_of(kind, name, port),)
    base = (
        DriveBase(motors[0].name, motors[1].name, 56, 130)
        if len(motors) > 1 and draw(st.booleans())
        else None
    )
    return Robot(
        draw(names), hub, motors, sensors, base, needs_imu=hub.model.has_imu and draw(st.booleans())
    )


@given(descriptions())
def test_valid_robots_are_values(robot: Robot) -> None:
    assert robot == dataclasses.replace(robot)
    assert hash(robot) == hash(dataclasses.replace(robot))
    assert [robot.motor(motor.name) for motor in robot.motors] == list(robot.motors)
    assert [robot.sensor(sensor.name) for sensor in robot.sensors] == list(robot.sensors)


@given(descriptions(), names)
def test_missing_devices_are_named(robot: Robot, name: str) -> None:
    if name not in {motor.name for motor in robot.motors}:
        with pytest.raises(DescriptionError, match=f"no motor '{name}'"):
            robot.motor(name)
    if name not in {sensor.name for sensor in robot.sensors}:
        with pytest.raises(DescriptionError, match=f"no sensor '{name}'"):
            robot.sensor(name)


@given(hubs, st.text(max_size=3))
def test_ports_follow_hub(hub: HubKind, port: str) -> None:
    motor = Motor("m", port, MotorKind(hub.model.usual_motor))
    if len(port) == 1 and port in hub.model.motor_ports:
        assert Robot("r", hub, (motor,))
    else:
        with pytest.raises(DescriptionError, match="has ports|has no port|does not fit"):
            Robot("r", hub, (motor,))


EV3_MOTOR = Motor("m", "A", MotorKind.EV3_LARGE)
EV3_TOUCH = PoweredUpSensor("button", "1", SensorKind.EV3_TOUCH)


@pytest.mark.parametrize(
    ("hub", "device", "port", "message"),
    [
        (HubKind.EV3, EV3_MOTOR, "1", "is an ev3-large on port 1, .* one of A, B, C, D"),
        (HubKind.EV3, EV3_TOUCH, "B", "is an Ev3TouchSensor on port B, .* one of 1, 2, 3, 4"),
        (
            HubKind.EV3,
            Motor("m", "A"),
            "A",
            "a spike-medium, whose plug fits no port of an ev3 hub",
        ),
        (HubKind.PRIME, EV3_MOTOR, "A", "an ev3-large, whose plug fits no port of a prime hub"),
    ],
)
def test_devices_fit_their_ports(
    hub: HubKind, device: Motor | PoweredUpSensor, port: str, message: str
) -> None:
    moved = dataclasses.replace(device, port=port)
    parts = {"motors" if isinstance(device, Motor) else "sensors": (moved,)}
    with pytest.raises(DescriptionError, match=message):
        Robot("r", hub, **parts)  # type: ignore[arg-type]
    assert Robot("r", HubKind.EV3, (EV3_MOTOR,), (EV3_TOUCH,))


@given(st.text(max_size=5))
def test_names_are_identifiers(name: str) -> None:
    for make in (lambda: Motor(name, "A"), lambda: UltrasonicSensor(name, "A")):
        if name.isidentifier():
            assert make().name == name
        else:
            with pytest.raises(DescriptionError, match="is not a name"):
                make()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"gears": (20,)}, "not a train"),
        ({"gears": (20, 0)}, "not a train"),
        ({"range_deg": (10, 10)}, "is empty"),
        ({"range_deg": (70, 10)}, "is empty"),
        ({"speed_limit_deg_s": 0}, "speed_limit_deg_s is 0"),
        ({"acceleration_deg_s2": -1}, "acceleration_deg_s2 is -1"),
        ({"torque_limit_mnm": 0}, "torque_limit_mnm is 0"),
    ],
)
def test_invalid_motors(fields: dict[str, object], message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        Motor("m", "A", **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("left", "right", "wheel_mm", "axle_mm", "message"),
    [
        ("a", "a", 56, 130, "both 'a'"),
        ("a", "b", -56, 130, "positive"),
        ("a", "b", 56, -1, "positive"),
    ],
)
def test_invalid_drive_bases(
    left: str, right: str, wheel_mm: float, axle_mm: float, message: str
) -> None:
    with pytest.raises(DescriptionError, match=message):
        DriveBase(left, right, wheel_mm, axle_mm)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Mount([60, 0, 12]), r"at_mm is \[60, 0, 12\]; give 3 values, each a number"),  # type: ignore[arg-type]
        (lambda: Mount(("a", 0, 12)), "give 3 values, each a number"),  # type: ignore[arg-type]
        (lambda: Chassis(caster_mm=[-60, 0]), "give 2 values, each a number"),  # type: ignore[arg-type]
        (lambda: Chassis(hub_mm=3), "hub_mm is 3"),  # type: ignore[arg-type]
        (lambda: UltrasonicSensor("eyes", "A", 60), "mount is 60"),  # type: ignore[arg-type]
    ],
)
def test_invalid_mounts_and_chassis(make: Callable[[], object], message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        make()


A, B = Motor("a", "A"), Motor("b", "B")


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        (lambda: Robot("two wheels", HubKind.PRIME), "is not a name"),
        (lambda: Robot("r", HubKind.PRIME, (A, Motor("b", "A"))), "port A is used 2 times"),
        (
            lambda: Robot("r", HubKind.PRIME, (A,), (UltrasonicSensor("eyes", "A"),)),
            "port A is used 2 times",
        ),
        (lambda: Robot("r", HubKind.PRIME, (A, Motor("a", "B"))), "name a is used 2 times"),
        (lambda: Robot("r", HubKind.CITY, needs_imu=True), "no IMU"),
        (
            lambda: Robot("r", HubKind.PRIME, (A,), drive_base=DriveBase("a", "b", 56, 130)),
            "no motor 'b'",
        ),
        (
            lambda: Robot(
                "r",
                HubKind.PRIME,
                (A, Motor("b", "B", gears=(1, 3))),
                drive_base=DriveBase("a", "b", 56, 130),
            ),
            "same gears",
        ),
    ],
)
def test_invalid_robots(robot: object, message: str) -> None:
    assert callable(robot)
    with pytest.raises(DescriptionError, match=message) as info:
        robot()
    assert "\n" not in str(info.value)


def test_small_hubs_have_no_standard_input() -> None:
    for hub in HubKind:
        assert hub.model.has_float == (hub.model.stdin_bytes >= 20)
        assert len(set(hub.model.ports)) == len(hub.model.ports)


@pytest.mark.parametrize(
    "sides", [("up",), ("up", "down"), ("up", "north"), ("up", "ahead", "left")]
)
def test_hub_sides_are_at_right_angles(sides: tuple[str, ...]) -> None:
    with pytest.raises(DescriptionError, match="give two of ahead, back"):
        Robot("mine", HubKind.PRIME, needs_imu=True, hub_sides=sides)


def test_hub_sides_need_imu() -> None:
    with pytest.raises(DescriptionError, match="only the IMU depends on hub_sides"):
        Robot("mine", HubKind.PRIME, hub_sides=("ahead", "down"))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"hub": "prime"}, "hub is 'prime'; give HubKind.PRIME, HubKind.ESSENTIAL, "),
        ({"hub": None}, "hub is None; give HubKind.PRIME"),
        (
            {"motors": Motor("a", "A")},
            r"motors is of type Motor; give several values, each Motor\(...\)",
        ),
        ({"motors": ("A",)}, r"motors is \('A',\); give several values, each Motor\(...\)"),
        (
            {"sensors": None},
            (
                r"sensors is None; give several values, each UltrasonicSensor\(...\) or "
                r"PoweredUpSensor\(...\)"
            ),
        ),
        ({"drive_base": "left right"}, r"drive_base is 'left right'; give DriveBase\(...\)"),
        ({"needs_imu": "no"}, "needs_imu is 'no'; give True or False"),
    ],
)
def test_parts_of_another_type_raise(parts: dict[str, object], message: str) -> None:
    with pytest.raises(DescriptionError, match=message) as caught:
        Robot(**{"name": "r", "hub": HubKind.PRIME, **parts})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_list_of_devices_becomes_tuple() -> None:
    assert hash(Robot("r", HubKind.PRIME, motors=[Motor("m", "A")])) == hash(
        Robot("r", HubKind.PRIME, (Motor("m", "A"),))
    )  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "spike-medium"},
        {"direction": "clockwise"},
        {"gears": 3},
        {"gears": ("a", "b")},
        {"range_deg": 3},
        {"range_deg": (1,)},
        {"range_deg": ("a", "b")},
        {"speed_limit_deg_s": "fast"},
        {"zero_deg": "up"},
    ],
)
def test_motor_of_another_type_raises(change: dict[str, object]) -> None:
    with pytest.raises(DescriptionError, match=f"^{next(iter(change))} is .*; give ") as caught:
        Motor("m", "A", **change)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ("", "'m' has no port; say it, or name a plan that does"),
        ("AB", "'m' is on port AB, but a prime hub has ports A, B, C, D, E, F; move it"),
        ("G", "'m' is on port G, but a prime hub has ports A, B, C, D, E, F; move it"),
        ("1", "'m' is on port 1, but a prime hub has ports A, B, C, D, E, F; move it"),
    ],
)
def test_a_port_that_the_hub_lacks_is_named_beside_those_it_has(port: str, message: str) -> None:
    for parts in ({"motors": (Motor("m", port),)}, {"sensors": (UltrasonicSensor("m", port),)}):
        with pytest.raises(DescriptionError, match=f"^robot 'r': {message}"):
            Robot("r", HubKind.PRIME, **parts)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mount((60.0, 0.0, 0.0)),
        lambda: Mount((60.0, 0.0, -1.0)),
        lambda: Mount((math.inf, 0.0, 12.0)),
        lambda: Mount((60.0, 0.0, 12.0), "inwards"),
        lambda: Chassis(caster_mm=(19.9, 0.0)),
        lambda: Chassis(caster_mm=(-19.9, 70.0)),
        lambda: Chassis(caster_mm=(-60.0, math.inf)),
        lambda: Chassis(hub_mm=(math.nan, 0.0)),
        lambda: Chassis(ballast_g=-0.1),
        lambda: Chassis(ballast_g=math.inf),
    ],
)
def test_what_cannot_be_mounted_on_a_robot_is_refused(make: Callable[[], object]) -> None:
    with pytest.raises(DescriptionError, match=r"cannot (sit at|look)|caster 20 mm or more"):
        make()


def test_mounts_and_casters_at_the_limit_are_accepted() -> None:
    assert Mount((-60.0, -5.0, 0.1), "down").at_mm[2] == 0.1
    for ahead_mm in (20.0, -20.0):
        assert Chassis(caster_mm=(ahead_mm, 0.0), ballast_g=0.0).caster_mm[0] == ahead_mm


def test_a_wheel_turns_once_over_its_circumference() -> None:
    base = DriveBase("a", "b", 56.0, 130.0)
    assert base.turn_deg(math.pi * 56.0) == pytest.approx(360.0)
    assert base.turn_deg(-math.pi * 14.0) == pytest.approx(-90.0)


@pytest.mark.parametrize(("wheel_mm", "track_mm"), [(0.0, 130.0), (56.0, 0.0)])
def test_a_drive_base_without_a_size_needs_a_plan(wheel_mm: float, track_mm: float) -> None:
    base = DriveBase("a", "b", wheel_mm, track_mm)
    with pytest.raises(DescriptionError, match="no wheel diameter or no axle track"):
        Robot("r", HubKind.PRIME, (A, B), drive_base=base)
    robot = Robot("r", HubKind.PRIME, (A, B), drive_base=base, plan="r.ldr")
    with pytest.raises(DescriptionError, match=r"its plan r\.ldr was not read"):
        robot.check_complete()


LEGS = (Motor("left", "A"), Motor("right", "B"), Motor("tail", "C", MotorKind.SPIKE_LARGE))
EYES = (UltrasonicSensor("eye", "D"), PoweredUpSensor("color", "E", SensorKind.COLOR))


@pytest.mark.parametrize(
    ("mirrored", "message"),
    [
        ((("left", "wing"),), "mirrored names 'wing' 1 times"),
        ((("left", "right"), ("tail", "left")), "mirrored names 'left' 2 times"),
        ((("left", "tail"),), "left and tail are no mirror images"),
        ((("eye", "color"),), "eye and color are no mirror images"),
        ((("left", "eye"),), "left and eye are no mirror images"),
    ],
)
def test_only_devices_alike_are_mirror_images(
    mirrored: tuple[tuple[str, str], ...], message: str
) -> None:
    with pytest.raises(DescriptionError, match=message):
        Robot("r", HubKind.PRIME, LEGS, EYES, mirrored=mirrored)
    geared = dataclasses.replace(LEGS[1], gears=(12, 20))
    with pytest.raises(DescriptionError, match="left and right are no mirror images"):
        Robot("r", HubKind.PRIME, (LEGS[0], geared), mirrored=(("left", "right"),))


def test_end_stops_are_given_to_the_motors_of_their_names() -> None:
    robot = Robot("r", HubKind.PRIME, LEGS)
    stopped = with_end_stops(robot, {"right": (-20.0, 70.0)})
    assert stopped.motor("right").end_stops_deg == (-20.0, 70.0)
    assert [stopped.motor(name) for name in ("left", "tail")] == [LEGS[0], LEGS[2]]
    assert with_end_stops(robot, {}) is robot
    with pytest.raises(DescriptionError, match=r"no motor 'eye' \(it has: left, right, tail\)"):
        with_end_stops(robot, {"eye": (0.0, 1.0)})
