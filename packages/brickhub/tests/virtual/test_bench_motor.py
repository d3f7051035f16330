"""Motor of the bench against the equations of a motor, which are solved here in tiny steps."""

from __future__ import annotations

from math import pi

import pytest

from brickhub.robot import MotorKind
from brickhub.virtual.bench_motor import CONSTANTS, BenchMotor, Constants, step_of

MDEG = 180_000.0 / pi
"""Of a radian."""


def integrated(
    constants: Constants, volt: float, torque_nm: float, start: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Angle (rad), speed (rad/s) and current (A) after a millisecond."""
    angle, speed, current = start
    dt = 1e-7
    for _ in range(10_000):
        voltage_left = volt - constants.resistance_ohm * current - constants.emf_v_s * speed
        torque_left = constants.torque_nm_a * current - torque_nm
        angle += dt * speed
        speed += dt * torque_left / constants.inertia_kg_m2
        current += dt * voltage_left / constants.inductance_h
    return angle, speed, current


@pytest.mark.parametrize("kind", CONSTANTS)
def test_a_step_is_the_solution_of_the_equations(kind: MotorKind) -> None:
    constants = CONSTANTS[kind]
    step = constants.step()
    volt, torque_nm, start = 7.0, 0.05, (0.0, 5.0, 0.3)
    inputs = (start[1] * MDEG, start[2] * 10_000, volt * 1000, torque_nm * 1e6)
    angle, speed, current = (
        sum(factor * value for factor, value in zip(row, inputs, strict=True))
        for row in (step.angle, step.speed, step.current)
    )
    wanted = integrated(constants, volt, torque_nm, start)
    assert angle == pytest.approx(wanted[0] * MDEG, rel=1e-3)
    assert speed == pytest.approx(wanted[1] * MDEG, rel=1e-3)
    assert current == pytest.approx(wanted[2] * 10_000, rel=1e-3)
    assert step.friction_unm == constants.friction_unm


def run(motor: BenchMotor, voltage_mv: float, time_ms: int, friction_scale: float = 1.0) -> None:
    motor.voltage = voltage_mv
    for _ in range(time_ms):
        motor.step(friction_scale)


@pytest.mark.parametrize("kind", CONSTANTS)
@pytest.mark.parametrize("volt", [7.0, -4.0])
@pytest.mark.parametrize("friction_scale", [1.0, 2.0, 0.0])
def test_a_free_motor_runs_as_fast_as_its_constants_say(
    kind: MotorKind, volt: float, friction_scale: float
) -> None:
    constants = CONSTANTS[kind]
    motor = BenchMotor(step_of(kind))
    run(motor, 1000 * volt, 2000, friction_scale)
    sign = 1 if volt > 0 else -1
    friction_nm = friction_scale * constants.friction_unm * 1e-6
    current_a = sign * friction_nm / constants.torque_nm_a
    speed_rad_s = (volt - constants.resistance_ohm * current_a) / constants.emf_v_s
    assert motor.current == pytest.approx(current_a * 10_000, rel=0.01, abs=1.0)
    assert motor.speed == pytest.approx(speed_rad_s * MDEG, rel=0.01)
    before = motor.angle
    run(motor, 1000 * volt, 1000, friction_scale)
    assert motor.angle - before == pytest.approx(motor.speed, rel=0.01)


def test_a_spike_motor_is_driven_alike_to_both_sides_and_stands_without_voltage() -> None:
    one, other = (BenchMotor(step_of(MotorKind.SPIKE_MEDIUM)) for _ in range(2))
    run(one, 5000.0, 300)
    run(other, -5000.0, 300)
    assert (one.angle, one.speed, one.current) == (-other.angle, -other.speed, -other.current)
    assert one.angle > 0
    run(one, 0.0, 2000)
    before = one.angle
    run(one, 0.0, 1000)
    # It trembles as that of the firmware does, by less than a step of its sensor.
    assert abs(one.angle - before) < 100.0 and abs(one.speed) < 5000.0


def test_an_end_stop_holds_a_motor_a_little_beyond_it() -> None:
    for volt, low, high in ((7.0, -900_000.0, 90_000.0), (-7.0, -90_000.0, 900_000.0)):
        motor = BenchMotor(step_of(MotorKind.SPIKE_MEDIUM), (low, high))
        run(motor, 1000 * volt, 1500)
        end = high if volt > 0 else low
        beyond = (motor.angle - end) * (1 if volt > 0 else -1)
        assert 0 < beyond < 5000 and abs(motor.speed) < 10_000
        # It is a spring, which pushes it back no farther than the stop.
        run(motor, 0.0, 1500)
        beyond = (motor.angle - end) * (1 if volt > 0 else -1)
        assert -5000 < beyond < 1000


def test_a_motor_starts_where_it_is_put_and_friction_grows_with_its_speed_at_first() -> None:
    motor = BenchMotor(step_of(MotorKind.SPIKE_MEDIUM), start_mdeg=45_000.0)
    run(motor, 0.0, 50)
    assert (motor.angle, motor.speed, motor.current) == (45_000.0, 0.0, 0.0)
    # Dry friction is in proportion to the speed below 2 degrees a second, and whole beyond.
    steps = step_of(MotorKind.SPIKE_MEDIUM)
    for speed, share in ((1000.0, 0.5), (-1000.0, -0.5), (1e5, 1.0), (-1e5, -1.0), (0.0, 0.0)):
        with_friction, without = (BenchMotor(steps) for _ in range(2))
        with_friction.speed = without.speed = speed
        with_friction.step(1.0)
        without.step(0.0)
        torque = (with_friction.speed - without.speed) / steps.speed[3]
        assert torque == pytest.approx(share * steps.friction_unm, abs=1e-6)
