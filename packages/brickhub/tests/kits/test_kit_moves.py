"""Moves of virtual devices of LEGO's kits: how far, how fast, which motors, and how they end."""

from __future__ import annotations

import pytest
from kit_world import World, encode

from brickhub.kits.kit_protocol import Done, MotorState

LEFT = 1
RIGHT = 2
BOTH = 3
COAST, BRAKE, HOLD, CONTINUE, COAST_SMART, BRAKE_SMART = range(6)


@pytest.fixture
def world() -> World:
    return World()


def motors_of(world: World, field: str) -> list[int]:
    """A field of the reports of the Double Motor's two motors, left and right."""
    return [motor[field] for motor in world.report(world.double, "motor")]


def single_of(world: World) -> dict[str, int]:
    """The report of the Single Motor."""
    (motor,) = world.report(world.single, "motor")
    return motor


@pytest.mark.parametrize(
    ("speed", "direction", "reported"), [(40, 0, 40), (40, 1, -40), (-40, 0, -40), (-40, 1, 40)]
)
def test_direction_turns_the_sign_of_the_speed(
    world: World, speed: int, direction: int, reported: int
) -> None:
    world.send(world.single, encode("set_speed", 1, speed), encode("run", 1, direction), ms=800)
    assert single_of(world)["speed"] == pytest.approx(reported, abs=1)


def test_a_motor_without_a_speed_runs_at_half_of_it(world: World) -> None:
    world.send(world.double, encode("run", BOTH, 0), ms=800)
    assert motors_of(world, "speed") == pytest.approx([50, 50], abs=1)


@pytest.mark.parametrize(
    ("bits", "moves"), [(1, [90, 0]), (2, [0, 90]), (3, [90, 90]), (0, [0, 0])]
)
def test_command_moves_the_motors_that_it_names(world: World, bits: int, moves: list[int]) -> None:
    world.send(world.double, encode("run_for_degrees", bits, 90, 0), ms=1500)
    assert motors_of(world, "position") == pytest.approx(moves, abs=3)


@pytest.mark.parametrize("speed", [30, -30])
@pytest.mark.parametrize(("start", "position"), [(0, 120), (0, -120), (200, 50)])
def test_position_is_reached_whatever_the_sign_of_the_speed(
    world: World, speed: int, start: int, position: int
) -> None:
    answers = world.send(
        world.single,
        encode("reset_position", 1, start),
        encode("set_speed", 1, speed),
        encode("run_to_relative", 1, position),
        ms=2500,
    )
    assert answers[-1] == bytes((131, 1, Done.COMPLETED))
    assert single_of(world)["position"] == pytest.approx(position, abs=3)


@pytest.mark.parametrize(
    ("position", "direction", "turned_deg"),
    [
        (180, 2, 180),
        (181, 2, -179),
        (179, 2, 179),
        (180, 3, 180),
        (179, 3, -181),
        (181, 3, 181),
        (0, 0, 0),
        (0, 1, -360),
        (0, 2, 0),
    ],
)
def test_shorter_and_longer_way_part_at_half_a_turn(
    world: World, position: int, direction: int, turned_deg: int
) -> None:
    world.send(world.single, encode("run_to_absolute", 1, position, direction), ms=2500)
    assert single_of(world)["position"] == pytest.approx(turned_deg, abs=1)


@pytest.mark.parametrize(
    ("end_state", "voltage_mv", "state"),
    [
        (COAST, None, MotorState.READY),
        (BRAKE, 0, MotorState.READY),
        (COAST_SMART, None, MotorState.READY),
        (BRAKE_SMART, 0, MotorState.READY),
        (-1, 0, MotorState.READY),
    ],
)
@pytest.mark.parametrize("way", ["ends", "is stopped"])
def test_end_state_is_what_a_move_ends_in(
    world: World, end_state: int, voltage_mv: int | None, state: int, way: str
) -> None:
    world.send(world.single, encode("set_end_state", 1, end_state))
    if way == "ends":
        world.send(world.single, encode("run_for_degrees", 1, 90, 0), ms=1500)
    else:
        world.send(world.single, encode("run", 1, 0), ms=500)
        world.send(world.single, encode("stop", 1), ms=1000)
    assert world.machine.servos["C"].voltage_mv == voltage_mv
    assert single_of(world)["state"] == state


def test_move_that_goes_on_is_done_and_runs_until_it_is_stopped(world: World) -> None:
    world.send(world.single, encode("set_end_state", 1, CONTINUE))
    answers = world.send(world.single, encode("run_for_degrees", 1, 90, 0), ms=1500)
    assert answers == [bytes((125, 1, Done.COMPLETED))]
    motor = single_of(world)
    assert motor["speed"] == pytest.approx(50, abs=2)
    assert motor["state"] == MotorState.RUNNING
    # There is nothing that a stop could go on with.
    world.send(world.single, encode("stop", 1), ms=500)
    assert world.machine.servos["C"].voltage_mv is None
    assert single_of(world)["speed"] == 0


def test_end_state_of_the_pair_is_not_that_of_its_motors(world: World) -> None:
    world.send(world.double, encode("set_move_end_state", HOLD))
    world.send(world.double, encode("run_for_degrees", BOTH, 90, 0), ms=1500)
    assert motors_of(world, "state") == [MotorState.READY, MotorState.READY]
    world.send(world.double, encode("move_for_degrees", 90, 0), ms=1500)
    assert motors_of(world, "state") == [MotorState.HOLDING, MotorState.HOLDING]


def test_acceleration_is_a_hundred_degrees_for_each_percent(world: World) -> None:
    servo = world.machine.servos["C"]
    speed, _, _, torque = servo.settings.limits()
    answers = world.send(world.single, encode("set_acceleration", 1, 50, 20))
    assert answers == [bytes((145, 1, 0))]
    assert servo.settings.limits() == (speed, 5000, 2000, torque)
    world.send(world.single, encode("set_acceleration", 1, 0, 0))
    assert servo.settings.limits() == (speed, 100, 100, torque)


def test_acceleration_of_the_pair_is_that_of_both_motors(world: World) -> None:
    world.send(world.double, encode("set_move_acceleration", 10, 30))
    limits = [world.machine.servos[port].settings.limits() for port in "AB"]
    assert [(up, down) for _, up, down, _ in limits] == [(1000, 3000), (1000, 3000)]
    world.send(world.double, encode("set_acceleration", RIGHT, 40, 60))
    limits = [world.machine.servos[port].settings.limits() for port in "AB"]
    assert [(up, down) for _, up, down, _ in limits] == [(1000, 3000), (4000, 6000)]


def test_other_motor_of_a_pair_is_not_interrupted(world: World) -> None:
    world.send(world.double, encode("run_for_degrees", LEFT, 720, 0), ms=200)
    assert world.send(world.double, encode("run", RIGHT, 0)) == [bytes((123, RIGHT, 0))]
    answers = world.send(world.double, encode("stop", LEFT))
    assert answers == [bytes((125, LEFT, Done.INTERRUPTED)), bytes((139, LEFT, 0))]
    world.send(world.double, ms=600)
    assert motors_of(world, "speed") == pytest.approx([0, 50], abs=1)


@pytest.mark.parametrize(
    "command",
    [
        encode("stop", RIGHT),
        encode("run_for_time", RIGHT, 100, 0),
        encode("reset_position", RIGHT, 0),
        encode("set_duty", RIGHT, 0),
    ],
)
def test_command_of_one_motor_interrupts_a_move_of_both(world: World, command: bytes) -> None:
    world.send(world.double, encode("move_for_degrees", 720, 0), ms=200)
    answers = world.send(world.double, command)
    assert answers[0] == bytes((155, Done.INTERRUPTED))


def test_new_speed_does_not_start_what_was_stopped(world: World) -> None:
    world.send(world.double, encode("move", 0), ms=300)
    world.send(world.double, encode("stop_moving"), ms=500)
    world.send(world.double, encode("set_move_speed", 80), ms=500)
    assert motors_of(world, "speed") == [0, 0]


def test_new_speed_keeps_the_direction_of_an_endless_move(world: World) -> None:
    world.send(world.single, encode("run", 1, 1), ms=500)
    world.send(world.single, encode("set_speed", 1, 20), ms=500)
    assert single_of(world)["speed"] == pytest.approx(-20, abs=1)
    world.send(world.single, encode("run_for_time", 1, 1500, 0), ms=500)
    world.send(world.single, encode("set_speed", 1, 90), ms=500)
    assert single_of(world)["speed"] == pytest.approx(20, abs=1)


@pytest.mark.parametrize(
    ("steering", "direction", "speeds"),
    [
        # Forward is clockwise for the right motor; the left one is mounted the other way round.
        (100, 0, [-50, 50]),
        (100, 1, [50, -50]),
        (100, 2, [50, 50]),
        (100, 3, [-50, -50]),
        (50, 2, [0, 50]),
        (50, 3, [-50, 0]),
        (0, 2, [-50, 50]),
        (0, 3, [-50, 50]),
        (25, 2, [-25, 50]),
        (25, 3, [-50, 25]),
    ],
)
def test_wheels_of_a_direction(
    world: World, steering: int, direction: int, speeds: list[int]
) -> None:
    world.send(world.double, encode("set_steering", steering), encode("move", direction), ms=800)
    assert motors_of(world, "speed") == pytest.approx(speeds, abs=1)


def test_steering_slows_a_move_for_degrees_and_not_its_way(world: World) -> None:
    world.send(
        world.double, encode("set_steering", 25), encode("move_for_degrees", 180, 3), ms=3000
    )
    assert motors_of(world, "position") == pytest.approx([-180, 180], abs=3)


def test_turn_is_on_the_spot_and_leaves_the_steering(world: World) -> None:
    world.send(world.double, encode("set_steering", 25))
    assert world.send(world.double, encode("turn_for_degrees", 90, 3), ms=2500) == [
        bytes((161, Done.COMPLETED))
    ]
    left, right = motors_of(world, "position")
    assert left < -90
    assert right == pytest.approx(left, abs=4)
    world.send(world.double, encode("move", 3), ms=800)
    assert motors_of(world, "speed") == pytest.approx([-50, 25], abs=1)


@pytest.mark.parametrize(
    ("degrees", "direction", "yaw"), [(90, 2, -90), (-90, 2, 90), (90, 3, 90), (-90, 3, -90)]
)
def test_turn_by_a_negative_angle_is_the_other_way(
    world: World, degrees: int, direction: int, yaw: int
) -> None:
    world.send(world.double, encode("turn_for_degrees", degrees, direction), ms=2500)
    assert world.report(world.double, "imu")[0]["yaw"] == pytest.approx(yaw, abs=2)


@pytest.mark.parametrize("speed", [10, 30, 100])
def test_turn_slows_down_in_time_at_any_speed(world: World, speed: int) -> None:
    world.send(world.double, encode("set_move_speed", speed))
    answers = world.send(world.double, encode("turn_for_degrees", 180, 3), ms=12_000)
    assert answers == [bytes((161, Done.COMPLETED))]
    yaw = world.report(world.double, "imu")[0]["yaw"]
    # Half a turn is where the yaw wraps.
    assert yaw % 360 == pytest.approx(180, abs=4)


@pytest.mark.parametrize(
    ("left", "right", "speeds"),
    [(20, 40, [-20, 40]), (-20, 40, [20, 40]), (0, -30, [0, -30]), (80, 60, [-80, 60])],
)
def test_speeds_of_a_tank_are_shares_of_the_full_one(
    world: World, left: int, right: int, speeds: list[int]
) -> None:
    world.send(world.double, encode("set_move_speed", 10))
    answers = world.send(world.double, encode("tank", left, right), ms=1000)
    assert answers == [bytes((157, Done.COMPLETED))]
    assert motors_of(world, "speed") == pytest.approx(speeds, abs=1)


@pytest.mark.parametrize(
    ("left", "right", "positions"),
    [
        (40, 20, [-360, 180]),
        (40, -40, [-360, -360]),
        (-10, 40, [90, 360]),
        (0, 50, [0, 360]),
        (0, 0, [0, 0]),
    ],
)
def test_faster_motor_of_a_tank_turns_by_the_degrees(
    world: World, left: int, right: int, positions: list[int]
) -> None:
    answers = world.send(world.double, encode("tank_for_degrees", 360, left, right), ms=3000)
    assert answers == [bytes((159, Done.COMPLETED))]
    assert motors_of(world, "position") == pytest.approx(positions, abs=4)


@pytest.mark.parametrize("time_ms", [20_000, 20_005])
def test_longest_move_for_a_time_ends_like_any_other(world: World, time_ms: int) -> None:
    world.send(world.single, encode("set_end_state", 1, HOLD))
    assert world.send(world.single, encode("run_for_time", 1, time_ms, 0), ms=19_990) == []
    assert world.send(world.single, ms=300) == [bytes((127, 1, Done.COMPLETED))]
    assert single_of(world)["state"] == MotorState.HOLDING


def test_new_link_stops_the_motors_of_the_one_before(world: World) -> None:
    world.send(world.single, encode("run", 1, 0), ms=500)
    world.single.connect()
    world.send(world.single, ms=500)
    assert single_of(world)["speed"] == 0
    # What ran endlessly is forgotten, so a new speed starts nothing.
    world.send(world.single, encode("set_speed", 1, 80), ms=300)
    assert single_of(world)["speed"] == 0


def test_new_link_keeps_the_position(world: World) -> None:
    world.send(world.single, encode("run_for_degrees", 1, 90, 0), ms=1000)
    world.single.disconnect()
    world.single.connect()
    assert single_of(world)["position"] == pytest.approx(90, abs=3)


def test_move_of_a_lost_link_has_no_answer_on_the_next_one(world: World) -> None:
    world.send(world.single, encode("run_for_degrees", 1, 90, 0), ms=100)
    world.single.disconnect()
    world.single.connect()
    assert world.send(world.single, ms=1500) == []


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (encode("light", 9, 0, 100), bytes((111, 0))),
        (encode("beep", 0, 440, 1), bytes((113, 0))),
        (encode("stop_sound"), bytes((115, 0))),
        (encode("program_flow", 1), bytes((33, 0))),
    ],
)
def test_what_can_only_be_seen_or_heard_is_accepted(
    world: World, command: bytes, answer: bytes
) -> None:
    assert world.send(world.controller, command) == [answer]


def test_device_goes_on_after_a_command_that_it_refuses(world: World) -> None:
    answers = world.send(
        world.single,
        encode("set_yaw_face", 0),
        encode("set_speed", 1, 20),
    )
    assert answers == [bytes((191, Done.REFUSED)), bytes((141, 1, Done.COMPLETED))]


@pytest.mark.parametrize(
    ("position", "direction", "turned_deg"),
    [(90, 2, -10), (90, 0, 350), (130, 0, 30), (70, 1, -30)],
)
def test_way_to_a_position_begins_where_the_motor_is(
    world: World, position: int, direction: int, turned_deg: int
) -> None:
    world.send(world.single, encode("run_for_degrees", 1, 100, 0), ms=1500)
    # Its own count is another thing.
    world.send(world.single, encode("reset_position", 1, 0))
    world.send(world.single, encode("run_to_absolute", 1, position, direction), ms=2500)
    assert single_of(world)["position"] == pytest.approx(turned_deg, abs=3)
    assert single_of(world)["absolute"] == pytest.approx(position, abs=2)
