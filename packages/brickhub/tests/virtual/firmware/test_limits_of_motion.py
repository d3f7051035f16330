"""Moves by hand: angles, times and speeds of each phase, ways of a drive base, and what is just
accepted or refused."""

from __future__ import annotations

import math

import pytest

from brickhub.robot import BENCH, Direction, MotorKind
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware.angle import (
    Angle,
    difference,
    from_unit,
    mean,
    split,
    to_mdeg,
    to_unit,
    to_unit_float,
)
from brickhub.virtual.firmware.control import Logger, OnCompletion
from brickhub.virtual.firmware.drive_base import DriveBaseControl
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES, Observer
from brickhub.virtual.firmware.servo import Servo, servo_settings
from brickhub.virtual.firmware.trajectory import (
    Trajectory,
    TrajectoryCommand,
    for_time,
    to_angle,
    validate_acceleration,
    validate_speed,
)
from brickhub.virtual.machine import Machine

TURN = 360_000


def command(
    *,
    speed: float = 0,
    target: float = 100,
    up: float = 500,
    down: float = 1000,
    goes_on: bool = False,
    end: float = 0,
    duration_s: float = 0,
) -> TrajectoryCommand:
    """A command in degrees and seconds, at the time 1 s and the position 10 degrees."""
    return TrajectoryCommand(
        time=10_000,
        position=10_000,
        speed=round(1000 * speed),
        target_speed=round(1000 * target),
        max_speed=1_000_000,
        acceleration=round(1000 * up),
        deceleration=round(1000 * down),
        keep_running=goes_on,
        end=10_000 + round(1000 * end),
        duration=round(10_000 * duration_s),
    )


def phases(trajectory: Trajectory) -> list[tuple[float, float]]:
    """End of each phase: seconds and degrees since the start."""
    times = (trajectory.t1, trajectory.t2, trajectory.t3)
    angles = (trajectory.th1, trajectory.th2, trajectory.th3)
    return [(t / 10_000, th / 1000) for t, th in zip(times, angles, strict=True)]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"end": 90}, [(0.2, 10), (0.95, 85), (1.05, 90)]),
        ({"end": -90}, [(0.2, -10), (0.95, -85), (1.05, -90)]),
        ({"end": -90, "target": -100}, [(0.2, -10), (0.95, -85), (1.05, -90)]),
        ({"end": 90, "goes_on": True}, [(0.2, 10), (1.0, 90), (1.0, 90)]),
        ({"end": 90, "speed": 50}, [(0.1, 7.5), (0.875, 85), (0.975, 90)]),
        ({"end": 90, "speed": -50}, [(0.3, 7.5), (1.075, 85), (1.175, 90)]),
        ({"end": -90, "speed": 50}, [(0.3, -7.5), (1.075, -85), (1.175, -90)]),
        ({"end": 90, "speed": 150}, [(0.1, 12.5), (0.825, 85), (0.925, 90)]),
        # The ramps meet before the target speed.
        ({"end": 6}, [(0.1265, 4), (0.1265, 4), (0.1897, 6)]),
        ({"end": 15}, [(0.2, 10), (0.2, 10), (0.3, 15)]),
        # It goes on with the speed that it has reached.
        ({"end": 4, "goes_on": True}, [(0.1265, 4), (0.1265, 4), (0.1265, 4)]),
        # Faster than the motor can stop, the reference starts slower.
        ({"end": 2, "speed": 900, "target": 900}, [(0.0, 0), (0.0, 0), (0.0632, 2)]),
    ],
)
def test_phases_of_a_move_by_an_angle(
    given: dict[str, float], expected: list[tuple[float, float]]
) -> None:
    """With 500 and 1000 deg/s2 to and from 100 deg/s: 10 degrees in 0.2 s, and 5 in 0.1 s."""
    found = phases(to_angle(command(**given)))  # type: ignore[arg-type]
    for (time_s, angle), (expected_s, expected_angle) in zip(found, expected, strict=True):
        assert time_s == pytest.approx(expected_s, abs=2e-4)
        assert angle == pytest.approx(expected_angle, abs=0.02)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"duration_s": 1}, [(0.2, 10), (0.9, 80), (1.0, 85)]),
        ({"duration_s": 1, "target": -100}, [(0.2, -10), (0.9, -80), (1.0, -85)]),
        ({"duration_s": 1, "goes_on": True}, [(0.2, 10), (1.0, 90), (1.0, 90)]),
        ({"duration_s": 1, "speed": 50}, [(0.1, 7.5), (0.9, 87.5), (1.0, 92.5)]),
        ({"duration_s": 1, "speed": -50}, [(0.3, 7.5), (0.9, 67.5), (1.0, 72.5)]),
        ({"duration_s": 0.3}, [(0.2, 10), (0.2, 10), (0.3, 15)]),
        # The ramps meet before the target speed.
        ({"duration_s": 0.15}, [(0.1, 2.5), (0.1, 2.5), (0.15, 3.75)]),
        ({"duration_s": 0.15, "goes_on": True}, [(0.15, 5.625)] * 3),
        # The target is bounded so that it can stop.
        ({"duration_s": 0.05}, [(0.0333, 0.278), (0.0333, 0.278), (0.05, 0.417)]),
    ],
)
def test_phases_of_a_move_for_a_time(
    given: dict[str, float], expected: list[tuple[float, float]]
) -> None:
    found = phases(for_time(command(**given)))  # type: ignore[arg-type]
    for (time_s, angle), (expected_s, expected_angle) in zip(found, expected, strict=True):
        assert time_s == pytest.approx(expected_s, abs=2e-4)
        assert angle == pytest.approx(expected_angle, abs=0.02)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("time_s", "angle", "speed", "acceleration"),
    [
        (0.0, 0, 0, 500),
        (0.1, 2.5, 50, 500),
        (0.2, 10, 100, 0),
        (0.5, 40, 100, 0),
        (0.95, 85, 100, -1000),
        (1.0, 88.75, 50, -1000),
        (1.05, 90, 0, 0),
        (9.0, 90, 0, 0),
    ],
)
def test_reference_on_the_way(
    sign: int, time_s: float, angle: float, speed: float, acceleration: float
) -> None:
    trajectory = to_angle(command(end=sign * 90))
    reference = trajectory.reference(10_000 + round(10_000 * time_s))
    assert reference.time == 10_000 + round(10_000 * time_s)
    assert reference.position == pytest.approx(10_000 + sign * 1000 * angle, abs=10)
    assert reference.speed == pytest.approx(sign * 1000 * speed, abs=100)
    assert reference.acceleration == sign * 1000 * acceleration


def test_a_move_that_goes_on_keeps_its_speed() -> None:
    trajectory = to_angle(command(end=90, goes_on=True))
    later = trajectory.reference(10_000 + 20_000)
    assert later.position == pytest.approx(10_000 + 190_000, abs=20)
    assert (later.speed, later.acceleration) == (100_000, 0)


@pytest.mark.parametrize(
    ("time_s", "start_s", "angle", "speed"),
    [
        (0.0, 0.0, 0, 0),
        (0.1, 0.0, 0, 0),
        (0.2, 0.2, 10, 100),
        (0.9, 0.2, 10, 100),
        (0.95, 0.95, 85, 100),
        (1.04, 0.95, 85, 100),
        (1.05, 1.05, 90, 0),
        (5.0, 1.05, 90, 0),
    ],
)
def test_begin_of_the_phase_at_a_time(
    time_s: float, start_s: float, angle: float, speed: float
) -> None:
    vertex = to_angle(command(end=90)).last_vertex(10_000 + round(10_000 * time_s))
    assert vertex.time == pytest.approx(10_000 + 10_000 * start_s, abs=1)
    assert vertex.position == pytest.approx(10_000 + 1000 * angle, abs=10)
    assert (vertex.speed, vertex.acceleration) == (1000 * speed, 0)


def test_a_stretched_move_covers_its_own_angle_in_the_phases_of_the_longer_one() -> None:
    leader = to_angle(command(end=90))
    follower = to_angle(command(end=45))
    follower.stretch(leader)
    # Its trapezoid has half the height.
    assert phases(follower) == pytest.approx(
        [pytest.approx((time_s, angle / 2), abs=0.02) for time_s, angle in phases(leader)]
    )
    middle = follower.reference(10_000 + 5_000)
    assert middle.speed == pytest.approx(50_000, abs=200)
    assert follower.a0 == pytest.approx(250, abs=2)
    assert follower.a2 == pytest.approx(-500, abs=4)
    still = to_angle(command(end=0))
    still.stretch(leader)
    assert (still.th3, still.w1, still.t3) == (0, 0, leader.t3)


LARGEST_TURNS = (2**31 - 1) // 2 // TURN - 1
LONGEST_TICKS = (2**31 - 1) // 2 // 2_000_000 * 10_000


def test_an_angle_has_half_of_32_bits() -> None:
    """Up to there, it is the time that is too long, even at the largest speed."""
    start = command(target=2500, up=20_000)._replace(position=0, max_speed=10_000_000)
    last = LARGEST_TURNS * TURN
    for sign in (1, -1):
        with pytest.raises(ValueError, match="the move would take too long"):
            to_angle(start._replace(end=sign * last))
        with pytest.raises(ValueError, match="the angle is too large for one move"):
            to_angle(start._replace(end=sign * (last + 1)))


def test_a_move_takes_no_longer_than_its_angle_could_be_at_full_speed() -> None:
    slow = command(target=1)
    assert for_time(slow._replace(duration=LONGEST_TICKS)).t3 == LONGEST_TICKS
    with pytest.raises(ValueError, match="the duration is too long for one move"):
        for_time(slow._replace(duration=LONGEST_TICKS + 1))
    longest_deg = LONGEST_TICKS / 10_000
    assert phases(to_angle(command(target=1, end=longest_deg)))[-1][1] == longest_deg
    with pytest.raises(ValueError, match="the move would take too long"):
        to_angle(command(target=1, end=longest_deg + 0.01))


def test_moves_of_no_length() -> None:
    for none in (to_angle(command(end=0)), to_angle(command(end=5, target=0)), for_time(command())):
        assert phases(none) == [(0, 0)] * 3
        assert (none.time, none.position, none.end.position) == (10_000, 10_000, 10_000)


def test_speeds_and_accelerations_are_bounded() -> None:
    """To the largest speed of the motor, and to 50 to 20000 deg/s2."""
    bounded = to_angle(command(target=5000, up=9, down=90_000, end=90_000))
    assert (bounded.w1, bounded.a0, bounded.a2) == (10_000, 50, -20_000)


@pytest.mark.parametrize(
    ("steps", "speed", "fits"),
    [
        (1000, 9, False),
        (1000, 10, True),
        (1000, 2000, True),
        (1000, 2001, False),
        (3000, 3, True),
        (3000, 2, False),
        (3000, 666, True),
        (3000, 667, False),
    ],
)
def test_limits_of_speeds(steps: int, speed: int, fits: bool) -> None:
    if fits:
        validate_speed(steps, speed)
        return
    with pytest.raises(ValueError, match="the speed limit is out of range"):
        validate_speed(steps, speed)


@pytest.mark.parametrize(
    ("steps", "acceleration", "fits"),
    [
        (1000, 49, False),
        (1000, 50, True),
        (1000, 20_000, True),
        (1000, 20_001, False),
        (2000, 24, False),
        (2000, 25, True),
        (2000, 10_000, True),
        (2000, 10_001, False),
    ],
)
def test_limits_of_accelerations(steps: int, acceleration: int, fits: bool) -> None:
    if fits:
        validate_acceleration(steps, acceleration)
        return
    with pytest.raises(ValueError, match="the acceleration limit is out of range"):
        validate_acceleration(steps, acceleration)


# ---- angles


@pytest.mark.parametrize(
    ("mdeg", "angle"),
    [
        (0, (0, 0)),
        (359_999, (0, 359_999)),
        (360_000, (1, 0)),
        (-1, (0, -1)),
        (-360_000, (-1, 0)),
        (-500_000, (-1, -140_000)),
        (1_000_000, (2, 280_000)),
    ],
)
def test_an_angle_has_turns_and_a_rest_of_the_same_sign(mdeg: int, angle: Angle) -> None:
    assert split(mdeg) == angle
    assert to_mdeg(angle) == mdeg


@pytest.mark.parametrize(
    ("a", "b", "angle"),
    [
        ((1, 100), (0, 0), (1, 100)),
        ((1, 200_000), (0, -200_000), (2, 40_000)),
        ((0, 180_000), (0, -180_000), (0, 360_000)),
        ((0, 180_001), (0, -180_000), (1, 1)),
        ((0, -180_000), (0, 180_000), (0, -360_000)),
        ((0, -180_001), (0, 180_000), (-1, -1)),
        ((2, 5), (3, 10), (-1, -5)),
    ],
)
def test_differences_of_angles(a: Angle, b: Angle, angle: Angle) -> None:
    """A whole turn stays in the millidegrees, more does not (``pbio_angle_flush``)."""
    assert difference(a, b) == angle


@pytest.mark.parametrize(
    ("a", "b", "angle"),
    [
        ((0, 100), (0, 201), (0, 150)),
        ((0, -100), (0, -201), (0, -150)),
        ((1, 0), (0, 0), (0, 180_000)),
        ((3, 0), (0, 0), (1, 180_000)),
        ((-1, 0), (0, 0), (0, -180_000)),
        ((-3, 0), (0, 0), (-1, -180_000)),
        ((0, 300_000), (0, 200_000), (0, 250_000)),
        ((2, 10), (4, 20), (3, 15)),
    ],
)
def test_the_angle_half_way(a: Angle, b: Angle, angle: Angle) -> None:
    assert to_mdeg(mean(a, b)) == to_mdeg(angle)


@pytest.mark.parametrize(
    ("value", "steps", "mdeg"),
    [
        (0, 1000, 0),
        (90, 1000, 90_000),
        (-725, 1000, -725_000),
        (7, 2046, 14_322),
        (2, 400_000, 800_000),
    ],
)
def test_units_become_angles_and_back(value: int, steps: int, mdeg: int) -> None:
    angle = from_unit(value, steps)
    assert to_mdeg(angle) == mdeg
    assert to_unit(angle, steps) == value
    assert to_unit_float(angle, steps) == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize(
    ("angle", "steps", "value"),
    [
        ((0, 499), 1000, 0),
        ((0, 500), 1000, 1),
        ((0, -499), 1000, 0),
        ((0, -500), 1000, -1),
        ((1, 499), 1000, 360),
        ((-1, -500), 1000, -361),
        ((1, 0), 7000, 51),
        ((-1, 0), 7000, -51),
    ],
)
def test_turns_are_truncated_and_the_rest_is_rounded(angle: Angle, steps: int, value: int) -> None:
    assert to_unit(angle, steps) == value


# ---- the observer and logs


def observer() -> Observer:
    kind = BENCH.motors[0].kind
    return Observer(MOTOR_TYPES[kind], servo_settings(MOTOR_TYPES[kind], 1000, 0))


@pytest.mark.parametrize(
    ("error_mdeg", "feedback_mv"),
    [
        (0, 0),
        (1000, 45),
        (20_000, 900),
        (20_001, 900),
        (30_000, 4050),
        (50_000, 10_350),
        (55_238, 11_999),
        (55_240, 12_000),
        (90_000, 12_000),
    ],
)
def test_feedback_is_seven_times_as_strong_beyond_20_degrees(
    error_mdeg: int, feedback_mv: int
) -> None:
    """45 mV a degree, and 12 V at most."""
    model = observer()
    model.reset(5000)
    assert model.feedback_mv(5000 + error_mdeg) == feedback_mv
    assert model.feedback_mv(5000 - error_mdeg) == -feedback_mv


def test_measured_speed_is_the_mean_over_100_ms() -> None:
    model = observer()
    for step in range(1, 41):
        model.update(50 * step, 1000 * step, 0)
        assert model.measured_speed == 10_000 * min(step, 20)
    assert len(model.history) == 61
    model.reset(7)
    assert (model.angle, model.speed, model.current, model.stalled_since) == (7, 0, 0, None)
    assert set(model.history) == {7} and model.measured_speed == 200_000


def test_a_log_takes_one_of_several_rows_up_to_its_capacity() -> None:
    log = Logger()
    assert not log.is_active and log.rows == []
    log.start(1000, 3, 2)
    for step in range(12):
        log.add(1000 + 5 * step, step)
    assert log.rows == [(5, 1), (15, 3), (25, 5)]
    assert not log.is_active
    log.start(2000, 1, 1)
    log.add(2005, 9)
    assert (log.rows, log.is_active) == ([(5, 9)], True)


@pytest.mark.parametrize(
    ("ratio", "profile", "fits"), [(1, 5, True), (0, 5, False), (1000, 4, False), (1000, 0, True)]
)
def test_gears_and_profile_of_a_motor(ratio: int, profile: int, fits: bool) -> None:
    motor = MOTOR_TYPES[BENCH.motors[0].kind]
    if fits:
        assert servo_settings(motor, ratio, profile).steps_per_unit == ratio
        return
    with pytest.raises(ValueError, match="the gear ratio or the profile is out of range"):
        servo_settings(motor, ratio, profile)


def test_a_profile_is_the_tolerance_and_softens_the_gains() -> None:
    motor = MOTOR_TYPES[BENCH.motors[0].kind]
    usual, wide = servo_settings(motor, 1000, 0), servo_settings(motor, 1000, 22)
    assert (usual.position_tolerance, wide.position_tolerance) == (11_000, 22_000)
    assert wide.kp == pytest.approx(usual.kp / 2, abs=1)
    assert wide.ki == pytest.approx(usual.ki / 2, abs=1)
    assert wide.kd == usual.kd


# ---- the motor


def servo() -> Servo:
    found = Machine(BenchBody(BENCH)).servos["A"]
    found.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return found


@pytest.mark.parametrize(
    ("duty", "voltage"),
    [(0, 0), (1, 72), (33, 2376), (-33, -2376), (100, 7200), (101, 7200), (-900, -7200)],
)
def test_a_duty_is_a_share_of_the_battery(duty: int, voltage: int) -> None:
    motor = servo()
    motor.dc(duty)
    assert motor.voltage_mv == voltage
    motor.body.battery_mv = 8200
    motor.dc(50)
    assert motor.voltage_mv == 4100


@pytest.mark.parametrize(("limit", "fits"), [(0, True), (9000, True), (-1, False), (9001, False)])
def test_limit_of_the_voltage(limit: int, fits: bool) -> None:
    motor = servo()
    if not fits:
        with pytest.raises(ValueError, match="the voltage limit is out of range"):
            motor.set_max_voltage(limit)
        return
    motor.set_max_voltage(limit)
    for voltage in (-12_000, 12_000):
        motor.set_voltage(voltage)
        assert motor.voltage_mv == math.copysign(limit, voltage)


@pytest.mark.parametrize(
    ("shaft_mdeg", "absolute"),
    [(0, 0), (170_000, 170), (179_999, 180), (180_000, -180), (190_000, -170), (-190_000, 170)],
)
def test_absolute_angles_are_within_half_a_turn(shaft_mdeg: int, absolute: int) -> None:
    motor = servo()
    motor.body._motors["A"].angle = float(shaft_mdeg)  # type: ignore[attr-defined]
    motor.reset_angle(None)
    assert motor.angle_deg() == absolute
    motor.reset_angle(33)
    assert motor.angle_deg() == 33


# ---- the drive base


def base() -> DriveBaseControl:
    machine = Machine(BenchBody(BENCH))
    left, right = machine.servos["A"], machine.servos["B"]
    left.setup(Direction.COUNTERCLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    right.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    return machine.new_drive_base(left, right, 56_000, 130_000)


def goal(drive: DriveBaseControl) -> tuple[float, float]:
    """Distance (mm) and heading (deg) at which the move ends."""
    distance, heading = drive.distance, drive.heading
    return (
        distance.trajectory.end.position / distance.settings.steps_per_unit,
        heading.trajectory.end.position / heading.settings.steps_per_unit,
    )


@pytest.mark.parametrize(
    ("heading", "angle", "end"),
    [
        (0, 0, 0),
        (0, 180, 180),
        (0, 181, -179),
        (0, -180, -180),
        (0, -181, 179),
        (0, 360, 0),
        (0, 540, 180),
        (0, 541, -179),
        (0, -540, -180),
        (0, -541, 179),
        (350, 0, 360),
        (350, 10, 370),
        (350, 170, 170),
        (350, 169, 529),
        (-720, 90, -630),
    ],
)
def test_a_turn_to_a_heading_goes_the_shorter_way(heading: int, angle: int, end: int) -> None:
    """Exactly half a turn keeps its direction."""
    drive = base()
    drive.reset(0, heading)
    drive.turn_to(angle, OnCompletion.HOLD)
    assert goal(drive)[1] == end


@pytest.mark.parametrize(
    ("radius", "angle", "distance", "turn"),
    [
        (100, 90, 157, 90),
        (100, -90, 157, -90),
        (-100, 90, -157, -90),
        (-100, -90, -157, 90),
        (0, 45, 0, 45),
    ],
)
def test_curves(radius: int, angle: int, distance: int, turn: int) -> None:
    drive = base()
    drive.curve(radius, angle, OnCompletion.HOLD)
    assert goal(drive) == (distance, turn)


@pytest.mark.parametrize(
    ("radius", "distance", "angle", "ends"),
    [
        (100, None, 90, (157, 90)),
        (-100, None, 90, (157, -90)),
        (100, None, -90, (-157, -90)),
        (-100, None, -90, (-157, 90)),
        (100, 157, 0, (157, 89)),
        (-100, 157, 0, (157, -89)),
        (100, -157, 0, (-157, -89)),
        (-100, -157, 0, (-157, 89)),
        (10, 10, 0, (10, 57)),
        (-10, 10, 0, (10, -57)),
    ],
)
def test_arcs(radius: int, distance: int | None, angle: int, ends: tuple[int, int]) -> None:
    drive = base()
    drive.arc(radius, distance, angle, OnCompletion.HOLD)
    assert goal(drive) == ends


@pytest.mark.parametrize("radius", [9, -9, 0])
def test_arcs_have_a_radius_of_a_centimetre(radius: int) -> None:
    with pytest.raises(ValueError, match="the radius of an arc is too small"):
        base().arc(radius, 100, 0, OnCompletion.HOLD)


@pytest.mark.parametrize(
    ("diameter", "track", "fits"),
    [(1000, 1000, True), (999, 130_000, False), (56_000, 999, False), (56_000, 130_000, True)],
)
def test_geometry_of_a_drive_base(diameter: int, track: int, fits: bool) -> None:
    machine = Machine(BenchBody(BENCH))
    left, right = machine.servos["A"], machine.servos["B"]
    for motor in (left, right):
        motor.setup(Direction.CLOCKWISE, 1000, reset_angle=True, profile_deg=0)
    if not fits:
        with pytest.raises(ValueError, match="wheel diameter or the axle track is out of range"):
            machine.new_drive_base(left, right, diameter, track)
        return
    drive = machine.new_drive_base(left, right, diameter, track)
    # A millimetre is 360 / (pi * diameter) degrees, and a degree of heading track / diameter.
    mm = 1000 * 360_000 / math.pi / diameter
    assert drive.distance.settings.steps_per_unit == pytest.approx(mm, rel=1e-3)
    assert drive.heading.settings.steps_per_unit == 1000 * track // diameter


def test_settings_of_a_drive_base_are_checked_before_any_is_set() -> None:
    drive = base()
    distance, heading = drive.distance.settings, drive.heading.settings

    def now() -> list[int]:
        return [
            getattr(settings, name)
            for settings in (distance, heading)
            for name in ("default_speed", "acceleration", "deceleration")
        ]

    before = now()
    good = (100, (300, 400), 90, (200, 250))
    for wrong in (
        (10**6, *good[1:]),
        (good[0], (1, 400), *good[2:]),
        (good[0], (300, 1), *good[2:]),
        (*good[:2], 10**6, good[3]),
        (*good[:3], (1, 250)),
        (*good[:3], (200, 1)),
    ):
        with pytest.raises(ValueError, match="limit is out of range"):
            drive.set_settings(*wrong)
        assert now() == before
    drive.set_settings(*good)
    mm, deg = distance.steps_per_unit, heading.steps_per_unit
    assert now() == [100 * mm, 300 * mm, 400 * mm, 90 * deg, 200 * deg, 250 * deg]
    drive.set_settings(900, (300, 400), 800, (200, 250))
    assert now()[0] == distance.max_speed and now()[3] == heading.max_speed


# ---- the motor model


@pytest.mark.parametrize("kind", sorted(MOTOR_TYPES, key=lambda kind: kind.value))
def test_a_motor_model_takes_no_more_than_its_integers_hold(kind: MotorKind) -> None:
    """2500 deg/s, 25000 deg/s2, 12 V and 1 Nm."""
    model = MOTOR_TYPES[kind].model
    for sign in (1, -1):
        fastest = model.feedforward_unm(sign * 2_500_000, 0)
        assert model.feedforward_unm(sign * 2_500_001, 0) == fastest
        assert model.feedforward_unm(sign * 9_000_000, 0) == fastest
        steepest = model.feedforward_unm(0, sign * 25_000_000)
        assert model.feedforward_unm(0, sign * 26_000_000) == steepest
        assert abs(model.feedforward_unm(sign * 9_000_000, sign * 90_000_000)) <= 1_000_000
        assert model.torque_unm(sign * 12_001) == model.torque_unm(sign * 12_000)
        assert model.voltage_mv(sign * 1_000_001) == model.voltage_mv(sign * 1_000_000)


@pytest.mark.parametrize("kind", sorted(MOTOR_TYPES, key=lambda kind: kind.value))
def test_feedforward_is_half_the_friction_and_grows_in_proportion(kind: MotorKind) -> None:
    model = MOTOR_TYPES[kind].model
    half_friction = model.friction_unm // 2
    assert model.feedforward_unm(0, 0) == 0
    assert model.feedforward_unm(1, 0) == half_friction
    assert model.feedforward_unm(-1, 0) == -half_friction
    by_speed = model.feedforward_unm(200_000, 0) - half_friction
    assert by_speed > 0
    assert model.feedforward_unm(400_000, 0) - half_friction == pytest.approx(2 * by_speed, abs=1)
    assert model.feedforward_unm(-200_000, 0) == -model.feedforward_unm(200_000, 0)
    by_acceleration = model.feedforward_unm(0, 1_000_000)
    assert by_acceleration > 0
    assert model.feedforward_unm(200_000, 1_000_000) == by_speed + half_friction + by_acceleration


@pytest.mark.parametrize("kind", sorted(MOTOR_TYPES, key=lambda kind: kind.value))
def test_torque_and_voltage_at_rest_are_each_others_inverse(kind: MotorKind) -> None:
    model = MOTOR_TYPES[kind].model
    for voltage_mv in (-9000, -700, 1000, 7200):
        torque_unm = model.torque_unm(voltage_mv)
        assert model.voltage_mv(torque_unm) == pytest.approx(voltage_mv, abs=2)
        assert model.drive_mv(torque_unm, 0, 0) == model.voltage_mv(torque_unm)
    # The sum of a torque and the feedforward is limited.
    limit_unm = model.torque_unm(1000)
    for torque_unm in (10 * limit_unm, limit_unm + 1, limit_unm):
        assert model.drive_mv(torque_unm, 0, 0, limit_unm) == model.voltage_mv(limit_unm)
        assert model.drive_mv(-torque_unm, 0, 0, limit_unm) == -model.voltage_mv(limit_unm)
    assert model.drive_mv(limit_unm, 500_000, 0, limit_unm) == model.voltage_mv(limit_unm)
    both = limit_unm // 2 + model.feedforward_unm(1000, 0)
    assert model.drive_mv(limit_unm // 2, 1000, 0) == model.voltage_mv(both)


def test_an_observer_keeps_within_its_integers_too() -> None:
    model = observer()
    for step in range(400):
        model.update(50 * step, 30_000 * step, 12_000)
        assert abs(model.speed) <= 2_500_000
        assert abs(model.current) <= 30_000


def test_a_motor_that_stalls_is_noticed_at_once_and_forgotten_at_once() -> None:
    model = observer()
    for step in range(60):
        model.update(50 * step, 0, 7000)
    since = model.stalled_since
    assert since is not None and 0 < since < 50 * 60
    model.update(50 * 60, 0, 7000)
    assert model.stalled_since == since, "it is the first of the steps that counts"
    model.update(50 * 61, 0, -7000)
    assert model.stalled_since is None
    for step in range(62, 162):
        model.update(50 * step, 0, 1500)
    assert model.stalled_since is None, "of so little voltage it is no sign"
