"""Firmware motor control on the bench: stops, stalls, directions, gears, settings."""

from __future__ import annotations

import pytest

from brickhub.robot import BENCH, Direction
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.drive_base import DriveBaseControl
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine


class Blocked(BenchBody):
    """All motors are blocked at 30 degrees."""

    def angle_mdeg(self, port: str) -> int:
        return min(super().angle_mdeg(port), 30_000)


def servo(
    body: type[BenchBody] = BenchBody, direction: Direction = Direction.CLOCKWISE, gear: int = 1000
) -> Servo:
    machine = Machine(body(BENCH))
    servo = machine.servos["A"]
    servo.setup(direction, gear, reset_angle=True, profile_deg=0)
    return servo


def run(servo: Servo, time_ms: int) -> None:
    servo.clock.advance(time_ms)


def test_direction_reverses_shaft() -> None:
    motor = servo(direction=Direction.COUNTERCLOCKWISE)
    motor.run_angle(500, 90, OnCompletion.HOLD)
    run(motor, 1000)
    assert motor.angle_deg() == pytest.approx(90, abs=2)
    assert motor.body.angle_mdeg("A") == pytest.approx(-90_000, abs=2000)


def test_gears_scale_the_angle() -> None:
    motor = servo(gear=3000)
    motor.run_angle(200, 50, OnCompletion.HOLD)
    run(motor, 2000)
    assert motor.angle_deg() == pytest.approx(50, abs=1)
    assert motor.body.angle_mdeg("A") == pytest.approx(150_000, abs=2000)


def test_run_reaches_speed_and_continues() -> None:
    motor = servo()
    motor.run(500)
    run(motor, 1000)
    assert motor.speed_deg_s() == pytest.approx(500, rel=0.03)
    assert motor.is_done(), "running for ever is nothing to wait for"
    run(motor, 70_000)
    assert motor.speed_deg_s() == pytest.approx(500, rel=0.03)


@pytest.mark.parametrize(
    "then",
    [OnCompletion.COAST, OnCompletion.BRAKE, OnCompletion.COAST_SMART, OnCompletion.BRAKE_SMART],
)
def test_passive_stop_ends_control(then: OnCompletion) -> None:
    motor = servo()
    motor.run_angle(500, 100, then)
    run(motor, 1500)
    assert motor.is_done() and not motor.control.is_active


def test_smart_stops_do_not_accumulate_errors() -> None:
    motor = servo()
    for _ in range(10):
        motor.run_angle(500, 90, OnCompletion.COAST_SMART)
        run(motor, 1500)
    assert motor.angle_deg() == pytest.approx(900, abs=15)


def test_run_time_then_holds() -> None:
    motor = servo()
    motor.run_time(400, 500, OnCompletion.HOLD)
    run(motor, 495)
    assert not motor.is_done()
    # As on the hub, the hold that follows is only done when the measured speed has come down.
    run(motor, 20 * CONTROL_LOOP_MS)
    assert motor.is_done()
    angle = motor.angle_deg()
    run(motor, 1000)
    assert motor.angle_deg() == pytest.approx(angle, abs=8)


def test_blocked_motor_stalls_without_end() -> None:
    motor = servo(Blocked)
    motor.run_angle(500, 360, OnCompletion.HOLD)
    run(motor, 150)
    assert not motor.is_stalled()
    run(motor, 1500)
    assert motor.is_stalled()
    assert not motor.is_done()


def test_run_until_stalled_ends_at_block() -> None:
    motor = servo(Blocked)
    motor.run_until_stalled(300, OnCompletion.COAST, duty_limit_pct=50)
    run(motor, 100)
    assert not motor.is_done()
    run(motor, 1500)
    assert motor.is_done() and motor.angle_deg() == 30


def test_dc_voltage_speed_follows_motor_curve() -> None:
    motor = servo()
    motor.dc(100)
    run(motor, 1000)
    # facts/twin.md: a medium motor makes 951 deg/s without load at 7.2 V
    assert motor.speed_deg_s() == pytest.approx(951, rel=0.02)
    motor.brake()
    run(motor, 300)
    assert motor.speed_deg_s() == 0


def test_reset_angle_stops_move() -> None:
    motor = servo()
    motor.run(300)
    run(motor, 700)
    motor.reset_angle(1000)
    assert motor.angle_deg() == 1000
    run(motor, 1000)
    assert motor.speed_deg_s() == 0
    motor.reset_angle(None)
    assert -180 <= motor.angle_deg() <= 180


def test_motor_setup_is_once() -> None:
    motor = servo()
    with pytest.raises(OSError, match="in use"):
        motor.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    motor.close()
    motor.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)


def test_invalid_settings_change_nothing() -> None:
    motor = servo()
    before = motor.settings.limits()
    with pytest.raises(ValueError, match="out of range"):
        motor.settings.set_limits(500, 1, 2000, 199)
    assert motor.settings.limits() == before
    motor.settings.set_limits(500, 1000, 900, 100)
    assert motor.settings.limits() == (500, 1000, 900, 100)


def test_speed_limit_is_kept() -> None:
    motor = servo()
    motor.settings.set_limits(200, 2000, 2000, 199)
    motor.run(900)
    run(motor, 1000)
    assert motor.speed_deg_s() == pytest.approx(200, rel=0.05)


def test_speed_window_is_bounded() -> None:
    motor = servo()
    for window_ms in (0, 305, -5):
        with pytest.raises(ValueError, match="window"):
            motor.speed_deg_s(window_ms)


def base() -> DriveBaseControl:
    machine = Machine(BenchBody(BENCH))
    left, right = machine.servos["A"], machine.servos["B"]
    left.setup(Direction.COUNTERCLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    right.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine.new_drive_base(left, right, 56_000, 130_000)


def test_drive_keeps_speeds() -> None:
    drive = base()
    drive.drive(150, 60)
    drive.left.clock.advance(1500)
    _, speed, _, rate = drive.state()
    assert speed == pytest.approx(150, rel=0.03)
    assert rate == pytest.approx(60, rel=0.05)


def test_motor_command_ends_drive() -> None:
    drive = base()
    drive.drive(150, 0)
    drive.left.clock.advance(500)
    drive.left.run(100)
    drive.left.clock.advance(1500)
    assert drive.left.speed_deg_s() == pytest.approx(100, rel=0.1)
    assert drive.right.speed_deg_s() == pytest.approx(0, abs=5)


def test_reset_counts_from_zero() -> None:
    drive = base()
    drive.straight(50, OnCompletion.HOLD)
    drive.left.clock.advance(1500)
    drive.reset(0, 0)
    assert drive.state()[0] == 0
    drive.straight(100, OnCompletion.HOLD)
    drive.left.clock.advance(2000)
    assert drive.state()[0] == pytest.approx(100, abs=2)


def test_curve_turns_both_wheels() -> None:
    drive = base()
    drive.curve(200, 90, OnCompletion.HOLD)
    drive.left.clock.advance(5000)
    distance, _, angle, _ = drive.state()
    assert distance == pytest.approx(200 * 3.1416 / 2, rel=0.02)
    assert angle == pytest.approx(90, abs=2)


def test_drive_base_needs_two_free_equal_motors() -> None:
    drive = base()
    machine = drive.left.clock
    with pytest.raises(OSError, match="another drive base"):
        machine.new_drive_base(drive.left, drive.right, 56_000, 130_000)
    with pytest.raises(ValueError, match="two motors"):
        machine.new_drive_base(drive.left, drive.left, 56_000, 130_000)
    for port in "CD":
        machine.servos[port].setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    with pytest.raises(ValueError, match="wheel diameter"):
        machine.new_drive_base(machine.servos["C"], machine.servos["D"], 10, 130_000)


COMMANDS = {
    "run": lambda motor: motor.run(100),
    "run_time": lambda motor: motor.run_time(100, 5000, OnCompletion.HOLD),
    "run_until_stalled": lambda motor: motor.run_until_stalled(100, OnCompletion.COAST, None),
    "run_angle": lambda motor: motor.run_angle(100, 360, OnCompletion.HOLD),
    "run_target": lambda motor: motor.run_target(100, 3600, OnCompletion.HOLD),
    "track_target": lambda motor: motor.track_target(3600),
    "dc": lambda motor: motor.dc(20),
    "hold": lambda motor: motor.stop(OnCompletion.HOLD),
    "brake": lambda motor: motor.brake(),
    "coast": lambda motor: motor.stop(OnCompletion.COAST),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_command_of_a_motor_ends_its_drive_base(command: str) -> None:
    drive = base()
    drive.drive(150, 0)
    drive.left.clock.advance(1000)
    assert drive.right.speed_deg_s() > 200
    COMMANDS[command](drive.left)
    drive.left.clock.advance(2000)
    assert drive.right.speed_deg_s() == pytest.approx(0, abs=5), "the other wheel stops"


@pytest.mark.parametrize("command", sorted(COMMANDS.keys() - {"dc", "brake"}))
def test_closed_motor_takes_no_command(command: str) -> None:
    motor = servo()
    motor.close()
    with pytest.raises(OSError, match="the motor is not in use"):
        COMMANDS[command](motor)


@pytest.mark.parametrize(
    ("radius_mm", "angle_deg", "distance_mm", "turn_deg"),
    [
        (200, 90, 314, 90),
        (200, -90, 314, -90),
        (-200, 90, -314, -90),
        (-200, -90, -314, 90),
        (0, 90, 0, 90),
        (0, -90, 0, -90),
    ],
)
def test_signs_of_a_curve(
    radius_mm: int, angle_deg: int, distance_mm: float, turn_deg: float
) -> None:
    """The radius says whether it drives forward, the angle to which side it turns of its way."""
    drive = base()
    drive.curve(radius_mm, angle_deg, OnCompletion.HOLD)
    drive.left.clock.advance(5000)
    distance, _, angle, _ = drive.state()
    assert distance == pytest.approx(distance_mm, abs=6)
    assert angle == pytest.approx(turn_deg, abs=2)
