"""Motor motion against the firmware's recordings (data/firmware_motion.json)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from brickhub.robot import BENCH, Direction
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.drive_base import DriveBaseControl
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine

FIRMWARE = json.loads(
    (Path(__file__).parents[1] / "data" / "firmware_motion.json").read_text(encoding="utf-8")
)
# The program runs a moment after a control tick, as in the firmware where its answers were taken.
PHASE_MS = 100


def motor() -> tuple[Machine, Servo]:
    machine = Machine(BenchBody(BENCH))
    machine.advance(PHASE_MS)
    servo = machine.servos["A"]
    servo.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine, servo


def drive_base() -> tuple[Machine, DriveBaseControl]:
    machine = Machine(BenchBody(BENCH))
    machine.advance(PHASE_MS)
    left, right = machine.servos["A"], machine.servos["B"]
    left.setup(Direction.COUNTERCLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    right.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine, machine.new_drive_base(left, right, 56_000, 130_000)


def wait_ms(machine: Machine, mover: Servo | DriveBaseControl) -> int:
    start_ms = machine.time_ms
    while not mover.is_done():
        machine.advance(5 - machine.time_ms % 5)
        assert machine.time_ms < start_ms + 5000, "the move does not end"
    return machine.time_ms - start_ms


def test_limits_equal_firmware() -> None:
    _, servo = motor()
    limits = FIRMWARE["motor_limits"]
    assert servo.settings.limits() == (
        limits["speed"],
        limits["acceleration"],
        limits["acceleration"],
        limits["torque_mNm"],
    )
    _, base = drive_base()
    expected = FIRMWARE["drivebase_settings"]
    for settings, speed, acceleration in (
        (base.distance.settings, "straight_speed", "straight_acceleration"),
        (base.heading.settings, "turn_rate", "turn_acceleration"),
    ):
        assert settings.to_unit(settings.default_speed) == expected[speed]
        assert settings.to_unit(settings.acceleration) == expected[acceleration]


@pytest.mark.parametrize(
    "move", FIRMWARE["run_angle_blocking"], ids=lambda m: f"{m['angle']}@{m['speed']}"
)
def test_move_duration_equals_firmware(move: dict[str, int]) -> None:
    machine, servo = motor()
    servo.run_angle(move["speed"], move["angle"], OnCompletion.HOLD)
    assert wait_ms(machine, servo) == pytest.approx(move["time_ms"], rel=0.02)
    assert servo.angle_deg() == pytest.approx(move["angle_at_end"], abs=1)


def test_consecutive_moves_take_firmware_ticks() -> None:
    """In one program: each move starts where the previous one ended."""
    machine, servo = motor()
    moves = FIRMWARE["run_angle_blocking"]
    ticks = []
    for move in moves:
        servo.reset_angle(0)
        servo.run_angle(move["speed"], move["angle"], OnCompletion.HOLD)
        ticks.append(wait_ms(machine, servo) // CONTROL_LOOP_MS)
    assert ticks == [-(-move["time_ms"] // CONTROL_LOOP_MS) for move in moves]


# (duration, how long after a control tick it begins, how long it takes), ms: from programs on
# firmware v4.1.0b2.
TIMED = [
    (95, 0, 105), (95, 1, 104), (95, 4, 101), (100, 0, 110), (100, 1, 109), (93, 1, 99),
    (93, 2, 103), (97, 2, 103), (97, 3, 107),
    (99, 0, 105), (99, 1, 109), (101, 3, 107), (101, 4, 111),
]  # fmt: skip


@pytest.mark.parametrize(("duration_ms", "after_tick_ms", "takes_ms"), TIMED)
def test_timed_run_starts_after_seen_tick(
    duration_ms: int, after_tick_ms: int, takes_ms: int
) -> None:
    machine, servo = motor()
    machine.advance(after_tick_ms)
    servo.run_time(300, duration_ms, OnCompletion.HOLD)
    assert wait_ms(machine, servo) == takes_ms


def test_drive_distance_is_exact() -> None:
    """200 mm on wheels of 56 mm are 409 degrees on firmware v4.1.0b2
    (``distance_control.trajectory()``), at 2046 mdeg/mm."""
    _, base = drive_base()
    base.straight(200, OnCompletion.HOLD)
    assert base.distance.trajectory.th3 == 200 * 2046


@pytest.mark.parametrize(
    "moves", FIRMWARE["run_angle_repeated"], ids=lambda m: f"{m['angle']}@{m['speed']}"
)
def test_overlapping_moves_equal_firmware(moves: dict[str, list[int]]) -> None:
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


@pytest.mark.parametrize(
    "trace", FIRMWARE["trace_20ms"], ids=lambda m: f"{m['angle']}@{m['speed']}"
)
def test_move_path_equals_firmware(trace: dict[str, list[int]]) -> None:
    machine, servo = motor()
    servo.run_angle(trace["speed"], trace["angle"], OnCompletion.HOLD)
    angles = []
    for _ in trace["angles"]:
        machine.advance(20)
        angles.append(servo.angle_deg())
    assert angles == pytest.approx(trace["angles"], abs=1)


@pytest.mark.parametrize("move", FIRMWARE["straight"], ids=lambda m: f"{m['mm']}mm")
def test_straight_duration_equals_firmware(move: dict[str, float]) -> None:
    machine, base = drive_base()
    base.straight(int(move["mm"]), OnCompletion.HOLD)
    assert wait_ms(machine, base) == pytest.approx(move["time_ms"], rel=0.02)
    assert base.state()[0] == pytest.approx(move["distance_mm"], abs=1)


@pytest.mark.parametrize("move", FIRMWARE["turn"], ids=lambda m: f"{m['deg']}deg")
def test_turn_duration_equals_firmware(move: dict[str, float]) -> None:
    machine, base = drive_base()
    base.curve(0, int(move["deg"]), OnCompletion.HOLD)
    assert wait_ms(machine, base) == pytest.approx(move["time_ms"], rel=0.02)
    assert base.angle_deg() == pytest.approx(move["angle_deg"], abs=0.5)
