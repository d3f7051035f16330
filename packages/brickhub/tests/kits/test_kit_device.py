"""Virtual devices of LEGO's kits, by the packets that they get and send."""

from __future__ import annotations

import math

import pytest
from kit_world import World, encode

from brickhub.kits.kit_protocol import Done, MotorState
from brickhub.kits.virtual_devices import (
    ColorSensor,
    Controller,
    DoubleMotor,
    SingleMotor,
)

RUN_DONE, RUN_TIME_DONE, RUN_DEGREES_DONE, TANK_DONE, TURN_DONE = 123, 127, 125, 157, 161


@pytest.fixture
def world() -> World:
    return World()


def test_device_of_each_kind(world: World) -> None:
    kinds = [type(device) for device in (world.double, world.single, world.color, world.controller)]
    assert kinds == [DoubleMotor, SingleMotor, ColorSensor, Controller]


def test_command_is_answered_at_its_end(world: World) -> None:
    assert world.send(world.single, encode("run_for_time", 1, 500, 0), ms=480) == []
    assert world.send(world.single, ms=100) == [bytes((RUN_TIME_DONE, 1, Done.COMPLETED))]
    assert world.report(world.single, "motor")[0]["state"] == MotorState.READY


def test_long_time_ends(world: World) -> None:
    assert world.send(world.single, encode("run_for_time", 1, 60_000, 0), ms=59_900) == []
    assert world.send(world.single, ms=200) == [bytes((RUN_TIME_DONE, 1, Done.COMPLETED))]
    assert world.report(world.single, "motor")[0]["position"] == pytest.approx(30_000, abs=200)


def test_next_command_interrupts(world: World) -> None:
    world.send(world.single, encode("run_for_degrees", 1, 3600, 0), ms=200)
    assert world.send(world.single, encode("run", 1, 1)) == [
        bytes((RUN_DEGREES_DONE, 1, 1)),
        bytes((RUN_DONE, 1, 0)),
    ]
    world.send(world.single, ms=600)
    assert world.report(world.single, "motor")[0]["speed"] == pytest.approx(-50, abs=2)


def test_commands_of_both_motors_in_a_packet_start_together(world: World) -> None:
    answers = world.send(
        world.double,
        encode("set_speed", 1, 30),
        encode("run_for_degrees", 1, 90, 1),
        encode("run_for_degrees", 2, 180, 0),
        ms=2000,
    )
    assert answers[0] == bytes((141, 1, 0))
    assert sorted(answers[1:]) == [bytes((RUN_DEGREES_DONE, 1, 0)), bytes((RUN_DEGREES_DONE, 2, 0))]
    assert [motor["position"] for motor in world.report(world.double, "motor")] == pytest.approx(
        [-90, 180], abs=3
    )


@pytest.mark.parametrize(
    ("position", "direction", "turned_deg"),
    [(90, 0, 90), (90, 1, -270), (300, 2, -60), (300, 3, 300)],
)
def test_way_to_an_absolute_position(
    world: World, position: int, direction: int, turned_deg: int
) -> None:
    world.send(world.single, encode("run_to_absolute", 1, position, direction), ms=2000)
    motor = world.report(world.single, "motor")[0]
    assert motor["position"] == pytest.approx(turned_deg, abs=3)
    assert motor["absolute"] == pytest.approx(position, abs=3)


def test_new_speed_acts_on_an_endless_move(world: World) -> None:
    world.send(world.double, encode("move", 0), ms=800)
    world.send(world.double, encode("set_move_speed", 80), ms=800)
    assert [motor["speed"] for motor in world.report(world.double, "motor")] == pytest.approx(
        [-80, 80], abs=3
    )
    world.send(world.double, encode("stop_moving"), ms=500)
    assert [motor["speed"] for motor in world.report(world.double, "motor")] == [0, 0]


def test_tank_for_degrees_ends_with_the_faster_motor(world: World) -> None:
    assert world.send(world.double, encode("tank_for_degrees", 360, 20, 40), ms=3000) == [
        bytes((159, 0))
    ]
    left, right = (motor["position"] for motor in world.report(world.double, "motor"))
    assert (left, right) == (pytest.approx(-180, abs=4), pytest.approx(360, abs=4))


@pytest.mark.parametrize(
    ("degrees", "direction", "yaw"), [(90, 3, 90), (45, 2, -45), (-30, 3, -30)]
)
def test_turn_by_the_imu(world: World, degrees: int, direction: int, yaw: int) -> None:
    assert world.send(world.double, encode("turn_for_degrees", degrees, direction), ms=3000) == [
        bytes((TURN_DONE, 0))
    ]
    assert world.report(world.double, "imu")[0]["yaw"] == pytest.approx(yaw, abs=4)


def test_yaw_is_reset_and_wraps(world: World) -> None:
    world.send(world.double, encode("reset_yaw", 170))
    world.send(world.double, encode("turn_for_degrees", 30, 3), ms=2000)
    assert world.report(world.double, "imu")[0]["yaw"] == pytest.approx(-160, abs=4)


def test_steering_slows_the_inner_wheel(world: World) -> None:
    world.send(world.double, encode("set_steering", 50), encode("move_for_time", 1000, 3), ms=1500)
    left, right = (motor["position"] for motor in world.report(world.double, "motor"))
    assert left < -300
    assert abs(right) < 5


def test_move_against_a_stop_ends_as_interrupted() -> None:
    world = World(end_stops={"C": (-90.0, 90.0)})
    assert world.send(world.single, encode("run_for_degrees", 1, 720, 0), ms=3000) == [
        bytes((RUN_DEGREES_DONE, 1, 1))
    ]


def test_end_state_holds(world: World) -> None:
    world.send(
        world.single, encode("set_end_state", 1, 2), encode("run_for_degrees", 1, 90, 0), ms=1500
    )
    assert world.report(world.single, "motor")[0]["state"] == MotorState.HOLDING


def test_duty_cycle(world: World) -> None:
    world.send(world.single, encode("set_duty", 1, 5000), ms=500)
    motor = world.report(world.single, "motor")[0]
    assert (motor["state"], motor["power"]) == (MotorState.DUTY, pytest.approx(5000, abs=20))


def test_lost_device_forgets_its_moves(world: World) -> None:
    world.send(world.single, encode("run", 1, 0), ms=500)
    world.single.disconnect()
    world.machine.advance(3000)
    world.single.connect()
    assert world.report(world.single, "motor")[0]["speed"] == 0


def test_command_of_another_device_is_refused(world: World) -> None:
    assert world.send(world.color, encode("tank", 50, 50)) == [bytes((TANK_DONE, Done.REFUSED))]


@pytest.mark.parametrize(
    ("reading", "color"), [("red", 9), ("green", 6), ("blue", 3), ("white", 10), ("none", -1)]
)
def test_color_sensor(reading: str, color: int) -> None:
    world = World(f"D={reading}")
    assert world.report(world.color, "color")[0]["color"] == color


def test_color_sensor_that_is_off_sees_nothing() -> None:
    world = World("D=white")
    world.send(world.color, encode("set_color_mode", 0))
    seen = world.report(world.color, "color")[0]
    assert (seen["color"], seen["reflection"], seen["mode"]) == (-1, 0, 0)


def test_levers(world: World) -> None:
    assert isinstance(world.controller, Controller)
    world.controller.levers_pct = (100, -40)
    levers = world.report(world.controller, "controller")[0]
    assert levers == {"left_pct": 100, "right_pct": -40, "left_deg": 45, "right_deg": -18}


def test_notifications_come_at_their_period(world: World) -> None:
    world.double.receive(encode("notifications", 50))
    world.double.outbox.clear()
    for _ in range(100):
        world.machine.advance(5)
        world.double.update()
    assert len(world.double.outbox) == 10


def test_imu_at_rest(world: World) -> None:
    imu = world.report(world.double, "imu")[0]
    assert (imu["face"], imu["yaw"], imu["gz"]) == (0, 0, 0)
    assert math.hypot(imu["ax"], imu["ay"], imu["az"]) == pytest.approx(1000, abs=2)


def test_acceleration_is_that_of_the_message(world: World) -> None:
    """A tenth of the acceleration takes longer to the same angle; 0 is as little as there is."""
    angles = []
    for percent in (100, 10, 0):
        world.send(world.single, encode("set_acceleration", 1, percent, percent))
        world.send(world.single, encode("reset_position", 1, 0))
        world.send(world.single, encode("run", 1, 0), ms=300)
        angles.append(world.report(world.single, "motor")[0]["position"])
        world.send(world.single, encode("stop", 1), ms=1000)
    assert angles[0] > 2 * angles[1] > 4 * angles[2]


@pytest.mark.parametrize(
    ("reading", "brightest"),
    [
        ("0,100,40", ["red"]),
        ("120,100,40", ["green"]),
        ("240,100,40", ["blue"]),
        ("0,0,40", ["blue", "green", "red"]),
    ],
)
def test_raw_light_has_eight_bits(reading: str, brightest: list[str]) -> None:
    """Of something dark neither dark nor at its end, the color's own part most of all."""
    world = World(f"D={reading}")
    seen = world.report(world.color, "color")[0]
    raw = {name: seen[name] for name in ("red", "green", "blue")}
    most = max(raw.values())
    assert 60 < most < 200
    assert sorted(name for name, value in raw.items() if value > most / 2) == brightest
