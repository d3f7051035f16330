"""A car: how it finds the middle of its steering, and what power and steering mean for motors."""

from __future__ import annotations

import pytest
from hub_programs import Console

from brickhub.robot import BENCH
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules

HEAD = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Direction, Port
from pybricks.robotics import Car
from pybricks.tools import StopWatch, wait
steer, drive, other = Motor(Port.C), Motor(Port.D), Motor(Port.E)
watch = StopWatch()
def error(call, *values):
    try:
        return call(*values)
    except Exception as raised:
        return repr(raised)
"""
STEER, DRIVE, OTHER = "CDE"
LEFT_END_DEG, RIGHT_END_DEG = -60, 100
HALF_WAY_DEG = (RIGHT_END_DEG - LEFT_END_DEG) // 2


def car(source: str, *, has_end_stops: bool = True) -> tuple[Machine, list[str]]:
    """The machine after a program with a car whose steering is blocked at both ends, and what the
    program printed."""
    stops = {"motor_c": (float(LEFT_END_DEG), float(RIGHT_END_DEG))} if has_end_stops else {}
    body = BenchBody(BENCH, end_stops=stops)
    machine = Machine(body)
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    return machine, console.written.decode().replace("\r\n", "\n").splitlines()


def held_at(machine: Machine, port: str) -> float:
    """Angle (deg) at which a motor is held."""
    servo = machine.servos[port]
    return servo.control.trajectory.end.position / servo.settings.steps_per_unit


@pytest.mark.parametrize(
    ("percent", "angle_deg"),
    [
        (0, 0),
        (1, 0),
        (33, 23),
        (50, 35),
        (-50, -35),
        (99, 69),
        (100, 70),
        (-100, -70),
        (101, 70),
        (-300, -70),
        (50.9, 35),
    ],
)
def test_steering_stays_ten_degrees_before_the_end_stops(percent: float, angle_deg: int) -> None:
    """Half the way between the end stops is 80 degrees; the middle is 0."""
    machine, printed = car(f"car = Car(steer, drive)\nprint(steer.angle())\ncar.steer({percent})")
    assert int(printed[0]) == HALF_WAY_DEG
    assert held_at(machine, STEER) == angle_deg


def test_a_new_car_steers_to_the_middle() -> None:
    machine, printed = car("car = Car(steer, drive)\nwait(2000)\nprint(steer.angle())")
    assert held_at(machine, STEER) == 0
    assert int(printed[0]) == pytest.approx(0, abs=2)
    middle_deg = (LEFT_END_DEG + RIGHT_END_DEG) / 2
    assert machine.body.angle_mdeg(STEER) / 1000 == pytest.approx(middle_deg, abs=2)


@pytest.mark.parametrize(
    ("power", "duty"),
    [
        (10, 28),
        (11, 28),
        (15, 32),
        (19, 35),
        (50, 60),
        (99, 99),
        (100, 100),
        (150, 100),
        (-10, -28),
        (-55, -64),
        (-100, -100),
        (-1000, -100),
    ],
)
def test_power_of_10_to_100_is_a_duty_of_28_to_100(power: int, duty: int) -> None:
    source = f"car = Car(steer, [drive, other])\ncar.drive_power({power})\n"
    machine, _ = car(source)
    plain, _ = car(f"drive.dc({duty})\n")
    volts = plain.servos[DRIVE].voltage_mv
    assert volts is not None
    assert machine.servos[DRIVE].voltage_mv == machine.servos[OTHER].voltage_mv == volts


@pytest.mark.parametrize("power", [0, 1, 9, -1, -9, 9.9])
def test_below_10_percent_the_motors_coast(power: float) -> None:
    source = f"car = Car(steer, [drive, other])\ncar.drive_power(50)\ncar.drive_power({power})\n"
    machine, _ = car(source)
    assert machine.servos[DRIVE].voltage_mv is None
    assert machine.servos[OTHER].voltage_mv is None


def test_all_motors_drive_at_the_speed() -> None:
    source = """
car = Car(steer, [drive, other])
car.drive_speed(300)
wait(1500)
print(drive.speed(), other.speed())
car.drive_speed(-200.9)
wait(1500)
print(drive.speed(), other.speed())
"""
    _, printed = car(source)
    forward, backward = ([int(word) for word in line.split()] for line in printed)
    assert forward == pytest.approx([300, 300], abs=10)
    assert backward == pytest.approx([-200, -200], abs=10)


@pytest.mark.parametrize(("limit", "percent"), [("", 100), (", 50", 50), (", 33", 33), (", 0", 0)])
def test_the_steering_is_searched_left_then_right_with_the_torque_limit(
    limit: str, percent: int
) -> None:
    machine = Machine(BenchBody(BENCH, end_stops={"motor_c": (-60.0, 100.0)}))
    console = Console(machine, {})
    servo = machine.servos[STEER]
    usual = servo.run_until_stalled
    calls = []

    def noted(
        speed: int, then: OnCompletion, duty_limit_pct: int | None, limit_unm: int | None = None
    ) -> None:
        calls.append((speed, then, duty_limit_pct, limit_unm))
        # With its full torque the search always ends.
        usual(speed, then, duty_limit_pct, None)

    servo.run_until_stalled = noted  # type: ignore[method-assign]
    source = f"{HEAD}Car(steer, drive{limit})\n"
    execute(source, "main.py", modules(machine, console), console)
    limit_unm = servo.settings.max_torque * percent // 100
    assert calls == [
        (-300, OnCompletion.COAST, None, limit_unm),
        (300, OnCompletion.COAST, None, limit_unm),
    ]


def test_a_steering_without_end_stops_is_given_up_after_ten_seconds() -> None:
    source = "print(error(Car, steer, drive), watch.time())"
    _, printed = car(source, has_end_stops=False)
    says, _, time_ms = printed[0].rpartition(" ")
    assert says.startswith("RuntimeError('The steering mechanism has no end stop.")
    assert int(time_ms) == pytest.approx(10_010, abs=10)


def test_motors_of_a_car() -> None:
    source = """
print(error(Car, 5, drive))
print(error(Car, steer, 5))
print(error(Car, steer, [drive, 5]))
print(error(Car, steer, []))
print(error(Car, steer, [drive] * 6))
print(error(Car, steer, [drive, drive]))
print(error(Car, steer, [drive, steer]))
print(error(Car, steer, (drive, other)) is not None)
car = Car(steer, drive)
print(error(car.steer, "a"), error(car.drive_power, "a"), error(car.drive_speed, "a"))
"""
    _, printed = car(source)
    not_a_motor = 'TypeError("can\'t convert int to Motor",)'
    count = "ValueError('drive_motors must be a list of 1 to 5 motors',)"
    not_a_number = 'TypeError("can\'t convert str to int",)'
    assert printed == [
        not_a_motor,
        not_a_motor,
        not_a_motor,
        count,
        count,
        "ValueError('drive_motors must be unique',)",
        "ValueError('drive_motors and steer_motor must be different',)",
        "True",
        " ".join([not_a_number] * 3),
    ]


def test_five_motors_may_drive() -> None:
    source = """
motors = [Motor(port) for port in (Port.A, Port.B, Port.F)] + [drive, other]
print(type(error(Car, steer, motors)))
"""
    _, printed = car(source)
    assert printed == ["<class 'Car'>"]
