"""The motors move as the firmware's: held to what the firmware itself answered (tests/data/firmware_motion.json)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bricksrl.robots import BENCH, Direction
from bricksrl.twin.bench import BenchBody
from bricksrl.twin.firmware.control import OnCompletion
from bricksrl.twin.firmware.drive_base import DriveBaseControl
from bricksrl.twin.firmware.servo import Servo
from bricksrl.twin.machine import CONTROL_LOOP_MS, Machine

FIRMWARE = json.loads((Path(__file__).parents[1] / "data" / "firmware_motion.json").read_text())
# The firmware's answers were taken one millisecond after a control tick.
PHASE_MS = 101


def motor() -> tuple[Machine, Servo]:
    machine = Machine(BENCH, BenchBody(BENCH))
    machine.advance(PHASE_MS)
    servo = machine.servos["A"]
    servo.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine, servo


def drive_base() -> tuple[Machine, DriveBaseControl]:
    machine = Machine(BENCH, BenchBody(BENCH))
    machine.advance(PHASE_MS)
    left, right = machine.servos["A"], machine.servos["B"]
    left.setup(Direction.COUNTERCLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    right.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine, DriveBaseControl(left, right, 56_000, 130_000, machine)


def wait_ms(machine: Machine, mover: Servo | DriveBaseControl) -> int:
    start_ms = machine.time_ms
    while not mover.is_done():
        machine.advance_to_control()
        assert machine.time_ms < start_ms + 5000, "the move does not end"
    return machine.time_ms - start_ms


def test_limits_are_the_firmwares() -> None:
    _, servo = motor()
    limits = FIRMWARE["motor_limits"]
    assert servo.settings.limits() == (limits["speed"], limits["acceleration"], limits["acceleration"], limits["torque_mNm"])
    _, base = drive_base()
    expected = FIRMWARE["drivebase_settings"]
    for settings, speed, acceleration in (
        (base.distance.settings, "straight_speed", "straight_acceleration"),
        (base.heading.settings, "turn_rate", "turn_acceleration"),
    ):
        assert settings.to_unit(settings.default_speed) == expected[speed]
        assert settings.to_unit(settings.acceleration) == expected[acceleration]


@pytest.mark.parametrize("move", FIRMWARE["run_angle_blocking"], ids=lambda m: f"{m['angle']}@{m['speed']}")
def test_one_move_takes_the_firmwares_time(move: dict[str, int]) -> None:
    machine, servo = motor()
    servo.run_angle(move["speed"], move["angle"], OnCompletion.HOLD)
    assert wait_ms(machine, servo) == pytest.approx(move["time_ms"], rel=0.02)
    assert servo.angle_deg() == pytest.approx(move["angle_at_end"], abs=1)


@pytest.mark.parametrize("move", FIRMWARE["run_angle_blocking"], ids=lambda m: f"{m['angle']}@{m['speed']}")
def test_one_move_takes_the_firmwares_number_of_control_ticks(move: dict[str, int]) -> None:
    """The firmware was asked from a program, whose own steps took it two milliseconds after the tick before."""
    machine, servo = motor()
    machine.advance(1)
    servo.run_angle(move["speed"], move["angle"], OnCompletion.HOLD)
    since_tick_ms = machine.time_ms % CONTROL_LOOP_MS
    assert since_tick_ms == 2
    assert (wait_ms(machine, servo) + since_tick_ms) // CONTROL_LOOP_MS == -(-move["time_ms"] // CONTROL_LOOP_MS)


@pytest.mark.parametrize("moves", FIRMWARE["run_angle_repeated"], ids=lambda m: f"{m['angle']}@{m['speed']}")
def test_overlapping_moves_add_up_as_the_firmwares(moves: dict[str, list[int]]) -> None:
    machine, servo = motor()
    *expected, at_rest = moves["angles_after_each_then_at_rest"]
    angles = []
    for _ in expected:
        servo.run_angle(moves["speed"], moves["angle"], OnCompletion.HOLD)
        machine.advance(moves["every_ms"])
        angles.append(servo.angle_deg())
    machine.advance(2000)
    assert angles == pytest.approx(expected, abs=1)
    assert servo.angle_deg() == pytest.approx(at_rest, abs=1)


@pytest.mark.parametrize("trace", FIRMWARE["trace_20ms"], ids=lambda m: f"{m['angle']}@{m['speed']}")
def test_the_way_of_a_move_is_the_firmwares(trace: dict[str, list[int]]) -> None:
    machine, servo = motor()
    servo.run_angle(trace["speed"], trace["angle"], OnCompletion.HOLD)
    angles = []
    for _ in trace["angles"]:
        machine.advance(20)
        angles.append(servo.angle_deg())
    assert angles == pytest.approx(trace["angles"], abs=1)


@pytest.mark.parametrize("move", FIRMWARE["straight"], ids=lambda m: f"{m['mm']}mm")
def test_straight_takes_the_firmwares_time(move: dict[str, float]) -> None:
    machine, base = drive_base()
    base.straight(int(move["mm"]), OnCompletion.HOLD)
    assert wait_ms(machine, base) == pytest.approx(move["time_ms"], rel=0.02)
    assert base.state()[0] == pytest.approx(move["distance_mm"], abs=1)


@pytest.mark.parametrize("move", FIRMWARE["turn"], ids=lambda m: f"{m['deg']}deg")
def test_turn_takes_the_firmwares_time(move: dict[str, float]) -> None:
    machine, base = drive_base()
    base.curve(0, int(move["deg"]), OnCompletion.HOLD)
    assert wait_ms(machine, base) == pytest.approx(move["time_ms"], rel=0.02)
    assert base.angle_deg() == pytest.approx(move["angle_deg"], abs=0.5)
