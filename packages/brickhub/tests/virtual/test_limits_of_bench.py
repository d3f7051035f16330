"""The bench, its clock and its log: exact values at rest, at limits, and at events."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

import pytest
from hub_programs import output

from brickhub.errors import SceneError, TwinError, UnknownNameError
from brickhub.robot import (
    BENCH,
    Direction,
    HubKind,
    Motor,
    MotorKind,
    PoweredUpSensor,
    Robot,
    Sense,
    SensorKind,
)
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.machine import Machine, Pace, firmware_version
from brickhub.virtual.panel import Panel, Press
from brickhub.virtual.pybricks.imu import _atan2_deg
from brickhub.virtual.run_log import RunLog


def robot_with(kind: SensorKind, *motors: Motor) -> Robot:
    hub = HubKind.EV3 if kind.value.startswith("Ev3") else HubKind.PRIME
    port = "2" if hub is HubKind.EV3 else "B"
    return Robot("one", hub, motors, (PoweredUpSensor("it", port, kind),))


# ---- the body


def test_a_bench_at_rest() -> None:
    body = BenchBody(BENCH)
    assert body.tilt_deg() == (0.0, 0.0)
    assert math.copysign(1, body.tilt_deg()[0]) == -1, "as the firmware tells of a level hub"
    assert body.angular_velocity_deg_s() == (0.0, 0.0, 0.0)
    assert body.acceleration_mm_s2() == (0.0, 0.0, 9810.0)
    assert body.heading_deg() == body.turn_rate_deg_s() == 0.0
    assert body.rotation_deg() == body.true_place() == (0.0, 0.0, 0.0)
    assert (body.battery_mv, body.motor_friction_scale) == (7200, 1.0)


@pytest.mark.parametrize(
    ("voltage_mv", "reached_mv"),
    [
        (None, 0),
        (0, 0),
        (7200, 7200),
        (9000, 7200),
        (-9000, -7200),
        (3600, 3600),
        (3603, 3600),
        (3608, 3607),
        (-3608, -3607),
        (7, 0),
        (8, 7),
    ],
)
def test_a_voltage_passes_through_a_thousand_steps(voltage_mv: int | None, reached_mv: int) -> None:
    """Of 7.2 mV each, towards 0."""
    body = BenchBody(BENCH)
    body.set_voltage("A", voltage_mv)
    assert body._motors["A"].voltage == reached_mv


@pytest.mark.parametrize(
    ("kind", "sensed", "distance_mm"),
    [
        (SensorKind.ULTRASONIC, 39.0, 40),
        (SensorKind.ULTRASONIC, 40.6, 41),
        (SensorKind.ULTRASONIC, 1999.4, 1999),
        (SensorKind.ULTRASONIC, 2500.0, 2000),
        (SensorKind.EV3_ULTRASONIC, 3.0, 30),
        (SensorKind.EV3_ULTRASONIC, 2600.0, 2550),
        (SensorKind.INFRARED, 12.0, 40),
        (SensorKind.INFRARED, 3000.0, 2000),
    ],
)
def test_distances_end_with_the_range_of_the_sensor(
    kind: SensorKind, sensed: float, distance_mm: int
) -> None:
    body = BenchBody(robot_with(kind), {"it": lambda angles: sensed})
    assert body.distance_mm(body.robot.sensors[0].port) == distance_mm


def test_an_ultrasonic_sensor_without_a_reading_sees_nothing() -> None:
    for kind, farthest_mm in ((SensorKind.ULTRASONIC, 2000), (SensorKind.EV3_ULTRASONIC, 2550)):
        body = BenchBody(robot_with(kind))
        port = body.robot.sensors[0].port
        assert body.sensed(port, Sense.DISTANCE) == farthest_mm
        assert body.distance_mm(port) == farthest_mm


def test_readings_see_the_outputs_of_the_motors() -> None:
    """Their angle is that of the shaft, through gears and direction."""
    motors = (
        Motor("plain", "A"),
        Motor("geared", "C", gears=(12, 36)),
        Motor("back", "D", direction=Direction.COUNTERCLOCKWISE),
    )
    seen: list[dict[str, float]] = []

    def read(angles: Any) -> float:
        seen.append(dict(angles))
        return 5.0

    body = BenchBody(robot_with(SensorKind.FORCE, *motors), {"it": read})
    for port in "ACD":
        body.set_voltage(port, 5000)
    body.advance_to(400)
    assert body.sensed("B", Sense.FORCE) == 5.0
    shaft_deg = body.angle_mdeg("A") / 1000
    assert shaft_deg > 50
    assert seen[0] == {
        "plain": shaft_deg,
        "geared": pytest.approx(shaft_deg / 3),
        "back": -shaft_deg,
    }


def test_a_reading_that_fails_is_told_with_its_place() -> None:
    def broken(angles: Any) -> float:
        raise ValueError("the lamp is broken")

    line = broken.__code__.co_firstlineno + 1
    body = BenchBody(robot_with(SensorKind.FORCE), {"it": broken})
    with pytest.raises(SceneError) as caught:
        body.sensed("B", Sense.FORCE)
    assert str(caught.value) == (
        "the scene's reading for port B of 'one' raised ValueError: the lamp is broken "
        f"(test_limits_of_bench.py, line {line}); correct it"
    )


@pytest.mark.parametrize(("low", "high", "fits"), [(0, 90, True), (-90, 0, True), (1, 90, False),
    (-90, -1, False)])  # fmt: skip
def test_described_end_stops_begin_around_zero(low: float, high: float, fits: bool) -> None:
    motor = Motor("arm", "A", end_stops_deg=(float(low), float(high)))
    robot = Robot("one", HubKind.PRIME, (motor,))
    if fits:
        assert BenchBody(robot)._motors["A"].stops == (1000.0 * low, 1000.0 * high)
        return
    with pytest.raises(
        TwinError, match=f"motor 'arm' of 'one' has end stops {low} and {high}, but"
    ):
        BenchBody(robot)


def test_given_end_stops_go_before_described_ones() -> None:
    motor = Motor("arm", "A", gears=(12, 36), direction=Direction.COUNTERCLOCKWISE,
                  end_stops_deg=(-10.0, 10.0))  # fmt: skip
    robot = Robot("one", HubKind.PRIME, (motor,))
    assert BenchBody(robot)._motors["A"].stops == (-30_000.0, 30_000.0)
    given = BenchBody(robot, end_stops={"arm": (-20.0, 5.0)})
    assert given._motors["A"].stops == (-15_000.0, 60_000.0)
    with pytest.raises(TwinError, match="no motor 'leg' for an end stop; it has arm"):
        BenchBody(robot, end_stops={"leg": (0.0, 1.0)})


# ---- the bench of a hub alone


def fitted(**options: Any) -> FittedBench:
    return FittedBench(HubKind.PRIME, **options)


def test_a_hub_on_wheels_turns_with_them() -> None:
    bench = fitted(devices={"A": MotorKind.SPIKE_MEDIUM, "B": MotorKind.SPIKE_MEDIUM})
    assert not bench.turns_with_its_wheels
    bench.put_on_wheels({"A": 0.001, "B": -0.0005})
    assert bench.turns_with_its_wheels
    bench.set_voltage("A", 5000)
    bench.set_voltage("B", -2500)
    bench.advance_to(500)
    a, b = bench._motors["A"], bench._motors["B"]
    assert bench.heading_deg() == pytest.approx(0.001 * a.angle - 0.0005 * b.angle)
    assert bench.turn_rate_deg_s() == pytest.approx(0.001 * a.speed - 0.0005 * b.speed)
    assert bench.turn_rate_deg_s() > 10
    assert bench.angular_velocity_deg_s() == (0.0, 0.0, -bench.turn_rate_deg_s())
    assert bench.rotation_deg() == (0.0, 0.0, -bench.heading_deg())
    assert bench.true_place() == (0.0, 0.0, bench.heading_deg())
    # Other wheels turn it from where it is.
    before = bench.heading_deg()
    bench.put_on_wheels({"A": -0.002})
    assert bench.heading_deg() == pytest.approx(before)
    angle = a.angle
    bench.advance_to(600)
    assert bench.heading_deg() - before == pytest.approx(-0.002 * (a.angle - angle))


@pytest.mark.parametrize(
    ("up", "tilt", "force"),
    [
        ((0.0, 0.0, 1.0), (0.0, 0.0), (0.0, 0.0, 9810.0)),
        ((1.0, 0.0, 0.0), (-90.0, 0.0), (9810.0, 0.0, 0.0)),
        ((-1.0, 0.0, -0.0), (90.0, 0.0), (-9810.0, 0.0, 0.0)),
        ((0.0, 1.0, 0.0), (0.0, 90.0), (0.0, 9810.0, 0.0)),
        ((0.0, -1.0, 0.0), (0.0, -90.0), (0.0, -9810.0, 0.0)),
        ((0.0, 0.0, -1.0), (0.0, 180.0), (0.0, 0.0, -9810.0)),
    ],
)
def test_a_mounted_hub(
    up: tuple[float, float, float],
    tilt: tuple[float, float],
    force: tuple[float, float, float],
) -> None:
    alone = fitted()
    alone.mount(up)
    assert alone.tilt_deg() == (0.0, 0.0)
    assert alone.acceleration_mm_s2() == (0.0, 0.0, 9810.0), "without motors it lies flat"
    bench = fitted(devices={"A": MotorKind.SPIKE_MEDIUM})
    bench.mount(up)
    assert bench.tilt_deg() == pytest.approx(tilt)
    assert bench.acceleration_mm_s2() == force
    bench.put_on_wheels({"A": 0.001})
    bench._motors["A"].angle = 30_000.0
    assert bench.rotation_deg() == tuple(-30.0 * part for part in up)


def test_what_is_in_the_way_of_a_motor_is_90_degrees_away() -> None:
    said: list[str] = []
    bench = fitted(devices={"A": MotorKind.SPIKE_MEDIUM, "B": MotorKind.SPIKE_MEDIUM},
                   end_stops={"B": (-10.0, 20.0)}, report=said.append)  # fmt: skip
    bench._motors["A"].angle = 5_000.0
    bench.block("A", 1)
    assert bench._motors["A"].stops == (-math.inf, 95_000.0)
    bench._motors["A"].angle = 90_000.0
    bench.block("A", 1)
    bench.block("A", -1)
    assert bench._motors["A"].stops == (0.0, 95_000.0)
    bench.block("A", -1)
    bench.block("B", 1)
    bench.block("B", -1)
    assert bench._motors["A"].stops == (0.0, 95_000.0)
    assert bench._motors["B"].stops == (-10_000.0, 20_000.0)
    (line,) = said
    assert line == (
        "The bench blocks the motor on port A after 90 degrees, as the program runs it until it "
        "stalls; --end-stop A=-90..120 gives it other ends."
    )


@pytest.mark.parametrize(
    ("start", "stops", "fits"),
    [(90.0, (0.0, 90.0), True), (-10.0, (-10.0, 0.0), True), (90.1, (0.0, 90.0), False),
     (-10.1, (-10.0, 0.0), False), (500.0, None, True)],
)  # fmt: skip
def test_starts_lie_between_the_end_stops(
    start: float, stops: tuple[float, float] | None, fits: bool
) -> None:
    end_stops = {"A": stops} if stops else {}
    if not fits:
        with pytest.raises(TwinError, match="beyond its end stops; give a start between them"):
            fitted(starts={"A": start}, end_stops=end_stops)
        return
    bench = fitted(starts={"A": start}, end_stops=end_stops, devices={"A": MotorKind.SPIKE_LARGE})
    assert bench.angle_mdeg("A") == 1000 * start


def test_plugging_in() -> None:
    bench = fitted(devices={"A": None, "B": SensorKind.COLOR, "C": MotorKind.SPIKE_LARGE})
    assert not bench.plug_in("A", "Motor"), "nothing is there"
    assert bench.plug_in("B", "ColorSensor") and not bench.plug_in("B", "Motor")
    assert bench.plug_in("C", "Motor") and not bench.plug_in("C", "DCMotor")
    assert bench.plug_in("D", "UltrasonicSensor") and bench.plug_in("D", "UltrasonicSensor")
    assert not bench.plug_in("D", "ColorSensor")
    assert [bench.device(port) for port in "ABCDE"] == [
        None,
        "ColorSensor",
        "Motor",
        "UltrasonicSensor",
        None,
    ]


# ---- the machine


class Real:
    """Real time, which passes in sleeps only."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []

    def clock_s(self) -> float:
        return self.now_s

    def sleep(self, time_s: float) -> None:
        self.slept_s.append(round(time_s, 6))
        self.now_s += time_s


def test_a_pace_waits_only_when_simulated_time_is_ahead() -> None:
    real = Real()
    pace = Pace(real.clock_s, real.sleep)
    assert pace.wall_ms() == 0.0
    pace.keep(20)
    assert real.slept_s == [0.02] and pace.wall_ms() == pytest.approx(20.0)
    real.now_s += 0.5
    pace.keep(519)
    pace.keep(30)
    assert len(real.slept_s) == 1
    pace.keep(521)
    assert real.slept_s == [0.02, 0.001]


def test_a_machine_keeps_its_pace_at_each_control_loop() -> None:
    real = Real()
    machine = Machine(BenchBody(BENCH))
    machine.pace = Pace(real.clock_s, real.sleep)
    machine.advance(12)
    assert real.slept_s == [0.005, 0.005]


def test_calls_are_free_until_there_are_many() -> None:
    """Of those beyond the first two hundred, each hundred takes a millisecond."""
    machine = Machine(BenchBody(BENCH))
    times = {}
    for call in range(1, 601):
        machine.charge_call()
        times[call] = machine.time_ms
    assert times[200] == times[299] == 0
    assert (times[300], times[399], times[400], times[600]) == (1, 1, 2, 4)
    machine.advance(1)
    for _ in range(299):
        machine.charge_call()
    assert machine.time_ms == 5, "after a wait they are counted anew"


def test_drawings_take_a_millisecond_by_threes() -> None:
    machine = Machine(FittedBench(HubKind.EV3))
    times = []
    for _ in range(7):
        machine.charge_drawing()
        times.append(machine.time_ms)
    assert times == [0, 0, 1, 1, 1, 2, 2]


def test_time_of_the_motor_control_is_a_millisecond_ahead() -> None:
    """In ticks of 0.1 ms: the firmware sleeps after its control loop."""
    machine = Machine(BenchBody(BENCH))
    assert machine.time_ticks == 10
    machine.advance(5)
    assert (machine.time_ms, machine.time_ticks) == (5, 60)
    machine.advance(2)
    assert (machine.time_ms, machine.time_ticks) == (7, 80)


def test_the_body_may_be_a_millisecond_ahead_of_the_program() -> None:
    machine = Machine(BenchBody(BENCH))
    assert machine.body_ms == 0
    assert machine.branch("value") == "value"
    assert (machine.time_ms, machine.body_ms) == (0, 1)
    machine.branch(None)
    assert (machine.time_ms, machine.body_ms) == (0, 1)
    machine.advance(1)
    assert (machine.time_ms, machine.body_ms) == (1, 1)
    assert machine.turn(5) == 5
    assert (machine.time_ms, machine.body_ms) == (1, 2)
    machine.advance(3)
    assert (machine.time_ms, machine.body_ms) == (4, 4)
    with machine.stopping():
        machine.branch(None)
        machine.turn(None)
        assert machine.body_ms == 4, "no time passes"
    machine.branch(None)
    assert machine.body_ms == 5


def test_memory_is_looked_at_after_as_many_branches_as_the_last_look_said() -> None:
    machine = Machine(BenchBody(BENCH))
    looks_ms: list[int] = []

    def look() -> int:
        looks_ms.append(machine.time_ms)
        return 3

    machine.check_memory = look
    for _ in range(9):
        machine.turn(None)
        machine.advance(1)
    # A turn of a loop counts twice here: it is also the first branch in its millisecond.
    assert looks_ms == [0, 2, 4, 6, 8]


@pytest.mark.parametrize(("press_s", "ends_ms"), [(0.222, 249), (0.25, 299), (0.3, 349)])
def test_a_program_ends_before_the_millisecond_of_the_poll(press_s: float, ends_ms: int) -> None:
    machine = Machine(BenchBody(BENCH), Panel(BENCH.hub, [Press("center", press_s, 0.1)]))
    machine.runs_program = True
    with pytest.raises(SystemExit):
        machine.advance(1000)
    assert (machine.time_ms, machine.time_ticks) == (ends_ms, 10 * (ends_ms + 1))
    assert machine.body_ms == ends_ms + 1


def test_without_a_program_a_press_ends_nothing() -> None:
    machine = Machine(BenchBody(BENCH), Panel(BENCH.hub, [Press("center", 0.2, 0.1)]))
    machine.advance(1000)
    assert machine.time_ms == 1000


def test_motors_have_a_voltage_or_coast() -> None:
    machine = Machine(BenchBody(BENCH))
    assert not machine.is_driven
    machine.servos["A"].set_voltage(0)
    assert machine.is_driven, "a motor that brakes"
    machine.stop_motors()
    assert not machine.is_driven and not machine.runs_program


def test_versions_of_the_firmware() -> None:
    newest, older = firmware_version("4.1"), firmware_version("4.0")
    assert (newest.version, newest.takes_packets, newest.has_hub_network) == ("4.1.0", True, True)
    assert (older.version, older.takes_packets, older.has_hub_network) == ("4.0.1", False, False)
    with pytest.raises(UnknownNameError, match=r"plays no firmware '3.6'.*choose 4.1, 4.0"):
        firmware_version("3.6")


# ---- the log of a run


def test_rows_of_a_log() -> None:
    log = RunLog()
    log.sample(0, {})
    log.read(["B_reflection_pct"], 7)
    log.sample(10, {})
    log.read(["heading_deg"], -0.0)
    log.read(["B_color"], "Color(h=1, s=2, v=3)")
    log.read(["x", "y"], (True, 12345678.9))
    log.sample(20, {})
    log.sample(20, {})
    log.read(["B_reflection_pct"], None)
    log.sample(1234, {})
    assert log.csv().splitlines() == [
        "time_s,B_reflection_pct,heading_deg,B_color,x,y",
        "0.000,,,,,",
        "0.010,7,,,,",
        '0.020,7,0,"Color(h=1, s=2, v=3)",1,1.234568e+07',
        '1.234,,0,"Color(h=1, s=2, v=3)",1,1.234568e+07',
    ]
    rows = list(log.rows())
    assert rows[0] == dict.fromkeys(rows[0]) | {"time_s": 0.0}
    assert rows[2] == {
        "time_s": 0.02,
        "B_reflection_pct": 7.0,
        "heading_deg": 0.0,
        "B_color": "Color(h=1, s=2, v=3)",
        "x": 1.0,
        "y": 12345680.0,
    }
    assert log.csv().endswith("\n") and len(list(csv.reader(io.StringIO(log.csv())))) == 5


# ---- the Move hub's accelerometer


class Tilted(BenchBody):
    """A hub that measures this acceleration (mm/s2)."""

    force = (0.0, 0.0, 9806.65)

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return self.force


def move_hub(force: tuple[float, float, float], source: str, mounting: str = "") -> list[str]:
    body = Tilted(Robot("small", HubKind.MOVE))
    body.force = force
    head = f"from pybricks.hubs import MoveHub\nhub = MoveHub({mounting})\nimu = hub.imu\n"
    return output(head + source, robot=body.robot, body=body).splitlines()


G = 9806.65


@pytest.mark.parametrize(
    ("force", "shown"),
    [
        ((0.0, 0.0, G), "(0, 0, 10112) (0, 0) Side.TOP"),
        ((G, 0.0, 0.0), "(10112, 0, 0) (-90, -180) Side.FRONT"),
        ((-G, 0.0, 0.0), "(-10112, 0, 0) (90, -180) Side.BACK"),
        ((0.0, G, 0.0), "(0, 10112, 0) (0, 90) Side.LEFT"),
        ((0.0, -G, 0.0), "(0, -10112, 0) (0, -90) Side.RIGHT"),
        ((0.0, 0.0, -G), "(0, 0, -10112) (0, -180) Side.BOTTOM"),
        ((0.0, 0.0, 3 * G), "(0, 0, 20066) (0, 0) Side.TOP"),
        ((0.0, 0.0, -3 * G), "(0, 0, -20224) (0, -180) Side.BOTTOM"),
        ((0.0, -1.0, G), "(0, -158, 10112) (0, 0) Side.TOP"),
    ],
)
def test_counts_of_the_move_hub(force: tuple[float, float, float], shown: str) -> None:
    """64 counts to g, rounded down, of 8 bits; 158 mm/s2 each. Where there is no direction, the
    angle is -180 (``pbio_int_math_atan2``)."""
    source = "print(imu.acceleration(), imu.tilt(), imu.up())"
    assert move_hub(force, source) == [shown]


@pytest.mark.parametrize("quadrant", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("angle_deg", [5, 10, 20, 30, 40, 45, 50, 60, 70, 80, 85])
def test_roll_of_the_move_hub_is_nearly_the_angle(
    quadrant: tuple[int, int], angle_deg: int
) -> None:
    """The firmware interpolates an arc tangent of counts; it is right to some 3 degrees."""
    sign_z, sign_y = quadrant
    z = sign_z * 1.9 * G * math.cos(math.radians(angle_deg))
    y = sign_y * 1.9 * G * math.sin(math.radians(angle_deg))
    (roll,) = move_hub((0.0, y, z), "print(imu.tilt()[1])")
    true_deg = math.degrees(math.atan2(y, z))
    assert int(roll) == pytest.approx(true_deg, abs=3.5)


@pytest.mark.parametrize(
    ("ratio", "degrees"),
    [
        (1, 0),
        (18, 0),
        (19, 1),
        (200, 10),
        (409, 22),
        (700, 33),
        (972, 43),
        (1024, 44),
        (1300, 51),
        (1638, 59),
        (2000, 62),
        (2560, 68),
        (3000, 70),
        (3891, 75),
        (4500, 77),
        (5120, 79),
        (6000, 80),
        (7168, 82),
        (10000, 83),
        (15360, 86),
        (20000, 87),
        (25600, 88),
        (99999, 88),
    ],
)
def test_arc_tangent_of_the_move_hub(ratio: int, degrees: int) -> None:
    """By hand, between the points of ``pbio_int_math_atan2``, in eighths of a degree."""
    assert _atan2_deg(ratio, 1024) == degrees
    assert _atan2_deg(-ratio, 1024) == -degrees
    # Behind the hub, 0 counts as a negative angle.
    assert _atan2_deg(ratio, -1024) == 180 - degrees
    assert _atan2_deg(-ratio, -1024) == (degrees - 180 if degrees else 180)


@pytest.mark.parametrize(
    ("mounting", "shown"),
    [
        ("", "(1, 2, 3)"),
        ("top_side=3, front_side=1", "(1, 2, 3)"),
        ("top_side=3, front_side=-1", "(-1, -2, 3)"),
        ("top_side=-3, front_side=1", "(1, -2, -3)"),
        ("top_side=1, front_side=-3", "(3, 2, -1)"),
        ("top_side=1, front_side=2", "(3, 1, 2)"),
        ("top_side=2, front_side=1", "(1, 3, -2)"),
        ("top_side=2, front_side=3", "(2, 3, 1)"),
    ],
)
def test_mountings_of_the_move_hub(mounting: str, shown: str) -> None:
    """By the right-hand rule: the hub's left is its top times its front. In units of eight
    counts."""
    eighth = G / 8
    force = (1.05 * eighth, 2.05 * eighth, 3.05 * eighth)
    source = "print(tuple(round(part / 1264) for part in imu.acceleration()))"
    assert move_hub(force, source, mounting) == [shown]


@pytest.mark.parametrize("mounting", ["3, 3", "3, -3", "0, 1", "3, 4", "4, 1", "3, 0"])
def test_axes_of_the_move_hub_are_at_right_angles(mounting: str) -> None:
    with pytest.raises(ValueError, match="Invalid argument"):
        move_hub((0.0, 0.0, G), "", mounting)
