"""Drive base on the bench (no load) against the firmware."""

from __future__ import annotations

import ast

import pytest
from hub_programs import Console, output

from brickhub.errors import TwinError
from brickhub.robot import BENCH, HubKind, Motor, Robot
from brickhub.virtual.bench_body import BenchBody, FittedBench
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules

HEAD = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port, Direction, Stop
from pybricks.robotics import DriveBase
from pybricks.tools import wait, StopWatch, multitask, run_task
watch = StopWatch()
left, right = Motor(Port.A), Motor(Port.B)
base = DriveBase(left, right, wheel_diameter=56, axle_track=130)
"""


@pytest.mark.parametrize(
    ("call", "time_ms", "value"),
    [("straight(100)", 805, 99), ("straight(-100)", 805, -98), ("straight(5)", 190, 5)],
)
def test_straight_duration_equals_hub(call: str, time_ms: int, value: int) -> None:
    time, distance = map(
        int, output(HEAD + f"base.{call}\nprint(watch.time(), base.distance())").split()
    )
    assert time == pytest.approx(time_ms, rel=0.05)
    assert distance == pytest.approx(value, abs=2)


@pytest.mark.parametrize(("angle", "time_ms"), [(90, 874), (-30, 454)])
def test_turn_duration_equals_hub(angle: int, time_ms: int) -> None:
    time, turned = output(HEAD + f"base.turn({angle})\nprint(watch.time(), base.angle())").split()
    assert int(time) == pytest.approx(time_ms, rel=0.05)
    assert float(turned) == pytest.approx(angle, abs=1.5)
    assert "." in turned


def test_methods_of_a_drive_base() -> None:
    source = (
        HEAD
        + """
print(base.settings())
base.settings(200, (600, 400), turn_rate=100)
print(base.settings())
base.curve(100, 90)
print(abs(base.distance() - 157) <= 2, abs(base.angle() - 90) < 2, base.done(), base.stalled())
base.reset()
print(base.distance(), round(base.angle()))
base.reset(10, 20)
print(base.distance(), round(base.angle()))
base.reset()
base.arc(-100, distance=50, then=Stop.BRAKE)
print(abs(base.distance() - 50) <= 2, base.angle() < -25)
base.drive(100, 0)
wait(1000)
print(90 <= base.state()[1] <= 110)
base.stop()
wait(1000)
print(base.state()[1])
base.straight(500, wait=False)
wait(100)
print(base.done())
base.brake()
base.use_gyro(True)
base.use_gyro(False)
print(base.distance_control.limits()[0] > 0, base.heading_control.pid()[0] > 0)
"""
    )
    assert output(source) == (
        "(195, 733, 143, 646)\n(200, (600, 400), 100, 646)\nTrue True True False\n0 0\n10 20\n"
        "True True\nTrue\n0\nFalse\n"
        "True True"
    )


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("base.straight()", "TypeError 'distance' argument required"),
        ("base.straight(100, 5)", "TypeError can't convert int to Stop"),
        ("base.arc(100)", "ValueError Please specify distance or angle but not both."),
        ("base.arc(0, distance=10)", "ValueError Invalid argument"),
        ("base.arc(9, angle=10)", "ValueError Invalid argument"),
        ("base.arc(-9, distance=10)", "ValueError Invalid argument"),
        ("base.arc(1, 2, 3)", "ValueError Please specify distance or angle but not both."),
        ("base.settings(straight_acceleration=(1, 2, 3))", "ValueError Invalid argument"),
        ("DriveBase(left, 5, 56, 130)", "TypeError can't convert int to Motor"),
        ("DriveBase(left, left, 56, 130)", "ValueError Invalid argument"),
        ("DriveBase(Motor(Port.C), Motor(Port.D), 0, 130)", "ValueError Invalid argument"),
    ],
)
def test_refusals(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    assert output(HEAD + f"try:\n    {call}\nexcept {kind} as e:\n    print(e)") == message


def test_absolute_headings_and_places() -> None:
    source = """
base.turn(50)
base.turn(90, absolute=True)
print(abs(base.angle() - 90) < 2)
base.turn(90, absolute=True)
print(abs(base.angle() - 90) < 2)
base.turn(300)
base.reset(0, 30)
base.move_by(0, 100)
print(abs(base.angle() + 90) < 2, abs(base.distance() - 100) <= 2)
async def main():
    await base.move_by(-50, 0)
    print(abs(base.distance() - 150) <= 3, round(abs(base.angle()) / 10))
run_task(main())
base.drive(100, 0)
wait(300)
base.hold()
wait(500)
print(base.state()[1], base.done())
try:
    base.move_by(32768, 0)
except ValueError as e:
    print(e)
"""
    expected = "True\nTrue\nTrue True\nTrue 18\n0 True\nInvalid argument"
    assert output(HEAD + source) == expected


class Steering(BenchBody):
    """Motor C is limited to -60..100 degrees."""

    def advance_to(self, time_ms: int) -> None:
        for moment_ms in range(self._time_ms + 1, time_ms + 1):
            super().advance_to(moment_ms)
            motor = self._motors["C"]
            if not -60_000 <= motor.angle <= 100_000:
                motor.angle, motor.speed = min(max(motor.angle, -60_000), 100_000), 0.0


CAR = """
from pybricks.pupdevices import Motor
from pybricks.parameters import Port
from pybricks.robotics import Car
from pybricks.tools import wait
steer, drive = Motor(Port.C), Motor(Port.D)
"""


def test_car_centres_steering() -> None:
    machine = Machine(Steering(BENCH))
    console = Console(machine, {})
    source = """
car = Car(steer, drive, torque_limit=50)
print(steer.angle())
car.drive_speed(400)
wait(800)
print(abs(drive.speed() - 400) < 20)
car.drive_power(50)
wait(500)
print(drive.speed() > 450)
car.drive_power(5)
wait(1000)
print(drive.speed())
"""
    execute(CAR + source, "main.py", modules(machine, console), console)
    assert console.written.decode().split() == ["80", "True", "True", "0"]


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("Car(steer, steer)", "ValueError drive_motors and steer_motor must be different"),
        ("Car(steer, [drive, drive])", "ValueError drive_motors must be unique"),
        ("Car(steer, [])", "ValueError drive_motors must be a list of 1 to 5 motors"),
        (
            "Car(steer, drive)",
            "RuntimeError The steering mechanism has no end stop. Did you build a car yet?",
        ),
    ],
)
def test_invalid_car(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    assert output(CAR + f"try:\n    {call}\nexcept {kind} as e:\n    print(e)") == message


def test_single_motor_command_ends_drive() -> None:
    source = (
        "base.drive(100, 0)\nwait(200)\nleft.run(-200)\nwait(500)\n"
        "print(left.speed() < -100, abs(right.speed()) < 20)"
    )
    assert output(HEAD + source) == "True True"


def test_drives_can_be_awaited() -> None:
    source = (
        HEAD
        + """
async def main():
    await base.straight(50)
    print(abs(base.distance() - 50) <= 2)
    await multitask(base.turn(90), wait(100), race=True)
    wait(100)
    print(base.angle() < 60)
run_task(main())
"""
    )
    assert output(source) == "True\nTrue"


def test_use_gyro_needs_imu() -> None:
    robot = Robot("city", HubKind.CITY, motors=(Motor("a", "A"), Motor("b", "B")))
    with pytest.raises(AttributeError, match="use_gyro"):
        output(HEAD + "base.use_gyro(True)", robot=robot)


def test_drive_base_counts_from_creation() -> None:
    turned = HEAD.replace("base =", "left.run_angle(500, 720)\nwait(200)\nbase =")
    source = turned + "distance, _, angle, _ = base.state()\nprint(distance, angle, base)"
    assert output(source) == "0 0 <DriveBase>"


def test_absolute_turn_is_at_most_half() -> None:
    source = """
base.turn(359)
watch.reset()
base.turn(0, absolute=True)
print(watch.time() < 200, round(base.angle()))
base.turn(-1000, absolute=True)
print(round(base.angle()))
"""
    assert output(HEAD + source) == "True 359\n439"


def test_zero_move_stops_drive() -> None:
    source = "base.drive(200, 0)\nwait(1000)\nbase.move_by(0, 0)\nwait(500)\n"
    source += "print(base.state()[1], base.done(), 0 < base.distance() < 260)"
    assert output(HEAD + source) == "0 True True"


def test_move_target_is_truncated() -> None:
    # 100 mm ahead and 99 mm to the right: -44.71 degrees and 140.7 mm.
    assert output(HEAD + "base.move_by(100, -99)\nprint(round(base.angle()), base.distance())") in (
        "44 140",
        "44 139",
    )


class Turning(BenchBody):
    """A slipping robot: the gyroscope measures 0.9 times the turn."""

    turns_with_its_wheels = True

    def heading_deg(self) -> float:
        return 0.9 * (self.angle_mdeg("A") - self.angle_mdeg("B")) / 2 * 56 / 130 / 1000 + 30.0


GYRO = HEAD.replace(
    "from pybricks.parameters", "from pybricks.hubs import PrimeHub\nfrom pybricks.parameters"
)
GYRO += "hub = PrimeHub()\ndef both():\n    return round(base.angle()), round(hub.imu.heading())\n"


def turning(source: str) -> str:
    return output(GYRO + source, body=Turning(BENCH))


def test_gyro_drive_base_has_imu_heading() -> None:
    source = """
print(both())
hub.imu.reset_heading(50)
print(both())
base.use_gyro(True)
print(both())
base.reset(0, -20)
print(both())
hub.imu.reset_heading(70)
print(both())
base.turn(90)
wait(1000)
print(both())
base.use_gyro(False)
print(both())
"""
    # The wheels have turned by 90 / 0.9 degrees since the reset, which set their zero too.
    *at_rest, turned, by_wheels = map(ast.literal_eval, turning(source).splitlines())
    assert at_rest == [(0, 0), (0, 50), (50, 50), (-20, -20), (70, 70)]
    assert turned == (pytest.approx(160, abs=1),) * 2
    assert by_wheels == (pytest.approx(80, abs=1), pytest.approx(160, abs=1))


def test_heading_reset_needs_passive_drive_base() -> None:
    source = """
def reset():
    try:
        hub.imu.reset_heading(0)
        print("reset")
    except OSError as e:
        print(e)
base.drive(100, 0)
reset()
base.use_gyro(True)
reset()
base.straight(100)
reset()
base.stop()
reset()
base.drive(100, 0)
reset()
"""
    refused = "Can't reset heading while gyro in use. Stop driving first."
    assert turning(source) == f"reset\nreset\n{refused}\nreset\n{refused}"


def test_new_hub_object_resets_heading() -> None:
    assert (
        turning("base.use_gyro(True)\nbase.turn(90)\nbase.stop()\nhub = PrimeHub()\nprint(both())")
        == "(0, 0)"
    )


def test_heading_correction_affects_drive_base() -> None:
    source = (
        "base.use_gyro(True)\nhub.imu.settings(heading_correction=350)\n"
        "hub.imu.reset_heading(0)\nbase.turn(90)\nwait(1000)\n"
    )
    source += "base.stop()\nbase.use_gyro(False)\nprint(both())"
    # 90 degrees by a gyroscope that counts 350 to a turn are 87.5, which the wheels turn by 87.5 /
    # 0.9.
    assert ast.literal_eval(turning(source)) == (pytest.approx(97, abs=1), pytest.approx(90, abs=1))


def test_refused_drive_base_keeps_motors() -> None:
    source = HEAD.replace(
        "base =",
        "try:\n    DriveBase(left, right, 0, 130)\nexcept ValueError as e:\n    print(e)\nbase =",
    )
    with pytest.raises(OSError, match="busy"):
        output(source)


def test_drive_base_with_closed_motor_only_reports() -> None:
    source = (
        HEAD
        + """
left.close()
for method in (base.hold, base.stop, base.reset, base.stalled):
    try:
        method()
    except OSError as e:
        print(e.errno)
try:
    base.straight(10)
except OSError as e:
    print(e.errno)
print(base.distance(), base.done(), base.settings()[0])
"""
    )
    assert output(source) == "19\n19\n19\n19\n19\n0 True 195"


@pytest.mark.parametrize(
    "mount", ["", "top_side=-Axis.X, front_side=Axis.Z", "top_side=Axis.Y, front_side=-Axis.X"]
)
def test_fitted_bench_turns_with_its_wheels(mount: str) -> None:
    source = f"""
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Port, Direction
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
from pybricks.tools import wait
hub = PrimeHub({mount})
left, right = Motor(Port.C, Direction.COUNTERCLOCKWISE, gears=[12, 20]), Motor(Port.F, gears=[12, 20])
base = DriveBase(left, right, 60, 120)
base.use_gyro(True)
base.turn(90)
wait(500)
print(round(base.angle()), round(hub.imu.heading()), round(hub.imu.rotation(Axis.Z)))
base.use_gyro(False)
print(round(base.angle()))
base.stop()
left.run(360)
right.run(-360)
wait(500)
print(*(round(rate, -1) + 0 for rate in hub.imu.angular_velocity()), *(round(angle) for angle in hub.imu.tilt()))
"""  # noqa: E501
    assert output(source, body=FittedBench(HubKind.PRIME)) == "90 90 -90\n90\n0.0 0.0 -180.0 0 0"


def test_gyro_turn_on_bench_raises() -> None:
    with pytest.raises(TwinError, match="lies still"):
        output(GYRO + "base.use_gyro(True)\nbase.straight(50)\nbase.turn(90)")
