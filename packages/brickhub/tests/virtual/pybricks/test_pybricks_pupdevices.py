"""Motors and sensors: results, errors, awaiting."""

from __future__ import annotations

import pytest
from described import TWO_WHEELER
from hub_programs import output

from brickhub.robot import BENCH, HubKind, Motor, MotorKind, Robot, UltrasonicSensor
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.firmware import InfeasibleMoveError
from brickhub.virtual.pybricks.context import firmware_errors

HEAD = """
from pybricks.pupdevices import *
from pybricks.parameters import *
from pybricks.tools import wait, StopWatch, multitask, run_task
watch = StopWatch()
"""
MOTOR = HEAD + "motor = Motor(Port.A)\n"


def within(measured: float, true: float) -> bool:
    return abs(measured - true) <= max(0.05 * abs(true), 5)


@pytest.mark.parametrize(
    ("speed", "angle", "time_ms", "end"),
    [
        (600, -100, 484, -99),
        (400, 100, 490, 99),
        (400, 10, 180, 9),
        (250, 60, 405, 59),
        (1000, 360, 885, 359),
    ],
)
def test_run_angle_duration_equals_hub(speed: int, angle: int, time_ms: int, end: int) -> None:
    measured = output(
        MOTOR + f"motor.run_angle({speed}, {angle})\nprint(watch.time(), motor.angle())"
    ).split()
    assert within(int(measured[0]), time_ms)
    assert abs(int(measured[1]) - end) <= 1


def test_commands_replace_each_other() -> None:
    source = MOTOR + (
        "for i in range(8):\n    motor.run_angle(600, -100, wait=False)\n    wait(250)\n"
        "    print(motor.angle())\n"
    )
    angles = [int(line) for line in output(source).split()]
    true = [-60, -154, -236, -326, -412, -500, -587, -675]
    assert all(within(a, b) for a, b in zip(angles, true, strict=True))


def test_methods_of_a_motor() -> None:
    source = (
        MOTOR
        + """
motor.run(500)
wait(500)
print(450 < motor.speed() < 550, 450 < motor.speed(window=50) < 550, motor.stalled())
motor.stop()
wait(1000)
print(motor.speed(), motor.load())
motor.reset_angle(45)
motor.run_target(500, 90, then=Stop.BRAKE)
print(abs(motor.angle() - 90) <= 2, motor.done())
motor.track_target(0)
wait(1000)
print(abs(motor.angle()) <= 1)
motor.dc(50)
wait(300)
print(motor.speed() > 300)
motor.brake()
start = watch.time()
print(motor.run_time(300, 500), watch.time() - start >= 500)
motor.hold()
print(motor.settings(), motor.settings(max_voltage=5000), motor.settings())
"""
    )
    assert (
        output(source)
        == "True True False\n0 0\nTrue True\nTrue\nTrue\nNone True\n(9000,) None (5000,)"
    )


def test_run_until_stalled_returns_the_angle() -> None:
    source = MOTOR + (
        "motor.settings(max_voltage=300)\nx = motor.run_until_stalled(200, duty_limit=1)\n"
        "print(x == motor.angle())"
    )
    assert output(source) == "True"


def test_settings_of_the_controller() -> None:
    source = (
        MOTOR
        + """
print(motor.control.limits(), motor.control.target_tolerances(), motor.control.stall_tolerances())
print(motor.control.limits(acceleration=(1500, 1000)), motor.control.limits())
motor.control.limits(500, 1000, 100)
motor.control.pid(kp=10000, integral_rate=20)
motor.control.stall_tolerances(time=300)
motor.control.target_tolerances(position=5)
print(motor.control.limits(), motor.control.pid()[0], motor.control.pid()[4])
print(motor.control.target_tolerances(), motor.control.stall_tolerances())
"""
    )
    assert output(source) == (
        "(1000, 2000, 199) (50, 11) (20, 200)\nNone (1000, (1500, 1000), 199)\n"
        "(500, 1000, 100) 10000 20\n(50, 5) (20, 300)"
    )


def test_motor_model_follows_motor() -> None:
    source = (
        HEAD
        + """
motor = Motor(Port.A, gears=[12, 36])
motor.run(100)
wait(1000)
angle, speed, current, stalled = motor.model.state()
print(abs(angle - 3 * motor.angle()) < 10, 270 < speed < 330, 0 < current < 300, stalled, type(angle) is float)
motor.stop()
wait(1000)
_, speed, current, stalled = motor.model.state()
print(abs(speed) < 30, abs(current) < 20, stalled)
"""  # noqa: E501
    )
    assert output(source) == "True True True False True\nTrue True False"


class Blocked(BenchBody):
    def angle_mdeg(self, port: str) -> int:
        return 0


def test_motor_model_of_blocked_motor_stalls() -> None:
    source = MOTOR + (
        "motor.dc(100)\nwait(150)\nprint(motor.model.state()[3], motor.stalled())\nwait(200)\n"
        "print(motor.stalled())"
    )
    assert output(source, body=Blocked(BENCH)) == "True False\nTrue"


STALL = "m = motor.model\n{}\nmotor.dc(100)\nwait({})\nprint(m.state()[3], motor.stalled())"


@pytest.mark.parametrize(
    ("change", "time_ms", "seen"),
    [
        ("", 900, "True True"),
        ("s[1] = 20000", 900, "True False"),  # later
        ("s[2] = 8000", 900, "False False"),  # such a voltage is nothing yet
        ("s[3] = 110", 900, "False False"),  # of such a voltage the feedback is not enough
        ("s[0] = -5000000", 900, "False False"),  # nothing is slow
    ],
)
def test_model_settings_define_stall(change: str, time_ms: int, seen: str) -> None:
    change = f"s = list(m.settings())\n{change}\nm.settings(s)"
    assert output(MOTOR + STALL.format(change, time_ms), body=Blocked(BENCH)) == seen


@pytest.mark.parametrize(("setting", "value"), [(4, 10), (5, 2000), (6, 1000)])
def test_model_gains_correct_angle(setting: int, value: int) -> None:
    ends = []
    for change in ("", f"s[{setting}] = {value}\nmotor.model.settings(tuple(s))\n"):
        source = (
            f"s = list(motor.model.settings())\n{change}motor.dc(100)\nwait(1000)\n"
            "print(motor.model.state()[0])"
        )
        ends.append(float(output(MOTOR + source, body=Blocked(BENCH))))
    usual, tuned = ends
    assert usual > 1
    assert (tuned > usual + 1) if value == 10 else (tuned < usual - 1)


def test_model_friction_fades_below_cutoff() -> None:
    source = (
        "s = list(motor.model.settings())\ns[7] = {}\nmotor.model.settings(s)\n"
        "motor.dc(50)\nwait(1000)\n"
    )
    source += "print(motor.model.state()[0] - motor.angle())"
    usual, without = (float(output(MOTOR + source.format(cutoff))) for cutoff in (500, 5_000_000))
    assert without > usual + 5, "without friction the model runs ahead of the motor"


def test_model_settings_are_eight_integers() -> None:
    source = (
        MOTOR
        + """
m = motor.model
print(m.settings())
for bad in ((1, 2), 5, ['a'] * 8):
    try:
        m.settings(bad)
    except (TypeError, ValueError) as e:
        print(e)
m.settings((1, 2, 3, 4, 5, 6, 7, 0))
print(m.settings())
motor.run(100)
wait(100)
"""
    )
    assert output(source).splitlines() == [
        "(20000, 2000, 2412, 75, 45, 315, 20000, 500)",
        "Invalid argument",
        "object 'int' isn't a tuple or list",
        "can't convert str to int",
        "(1, 2, 3, 4, 5, 6, 7, 0)",
    ]


def test_move_hub_has_no_motor_model() -> None:
    robot = Robot("small", HubKind.MOVE, motors=(Motor("m", "A"),))
    source = MOTOR + "try:\n    motor.model\nexcept AttributeError as e:\n    print(e)"
    assert output(source, robot=robot) == "'Motor' object has no attribute 'model'"


def test_direction_gears_and_text() -> None:
    source = (
        HEAD
        + """
a = Motor(Port.A, Direction.COUNTERCLOCKWISE, gears=[])
b = Motor(Port.B, gears=[12, 36])
c = Motor(Port.C, gears=[[12, 24], [10, 30]], reset_angle=False, profile=10)
print(a, b)
for m in (a, b, c):
    m.run_angle(200, 90)
    print(abs(m.angle() - 90) <= 2)
"""
    )
    assert output(source) == (
        "Motor(Port.A, Direction.COUNTERCLOCKWISE) Motor(Port.B, Direction.CLOCKWISE)\nTrue\n"
        "True\nTrue"
    )


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("motor.run()", "TypeError 'speed' argument required"),
        ("motor.run_angle(100)", "TypeError 'rotation_angle' argument required"),
        ("motor.run_angle(100, 10, 5)", "TypeError can't convert int to Stop"),
        (
            "motor.run_angle(100, 10, Stop.HOLD, True, 1)",
            "TypeError extra positional arguments given",
        ),
        ("motor.run_angle(100, 10, when=1)", "TypeError extra keyword arguments given"),
        ("motor.run('fast')", "TypeError can't convert str to int"),
        ("motor.run(None)", "TypeError can't convert NoneType to int"),
        ("motor.angle(5)", "TypeError function takes 1 positional arguments but 2 were given"),
        ("motor.control.limits(speed=100000000)", "ValueError Invalid argument"),
        ("motor.control.limits(acceleration=(1, 2, 3))", "ValueError Invalid argument"),
        ("motor.settings(20000)", "ValueError Invalid argument"),
        ("motor.run_time(100, 10000000)", "ValueError Invalid argument"),
        ("motor.run_angle(100, 2000000)", "ValueError Invalid argument"),
        ("motor.turn(5)", "AttributeError 'Motor' object has no attribute 'turn'"),
        ("Motor('A')", "TypeError can't convert str to Port"),
        ("Motor(Port.B, gears=5)", "TypeError object 'int' isn't a tuple or list"),
        ("Motor(Port.B, gears=[0, 5])", "ZeroDivisionError Gears must be positive integers."),
        ("Motor(Port.B, Port.C)", "TypeError can't convert Port to Direction"),
        ("Motor(Port.A)", "OSError [Errno 16] EBUSY: Device or resource busy"),
        ("Port()", "TypeError can't create 'Port' instances"),
        ("Port.G", "AttributeError type object 'Port' has no attribute 'G'"),
    ],
)
def test_refusals(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    source = f"try:\n    {call}\nexcept {kind} as e:\n    print(e)"
    assert output(MOTOR + source) == message


def test_move_without_trajectory_raises() -> None:
    with pytest.raises(RuntimeError, match="^Unknown error$"), firmware_errors():
        raise InfeasibleMoveError


def test_floats_are_truncated() -> None:
    assert (
        output(MOTOR + "motor.run_target(500.9, 90.7)\nprint(abs(motor.angle() - 90) <= 2)")
        == "True"
    )


@pytest.mark.parametrize(
    "device",
    ["Motor", "UltrasonicSensor", "ColorSensor", "ForceSensor", "TiltSensor", "DCMotor", "Light"],
)
def test_empty_port_raises(device: str) -> None:
    source = (
        HEAD + f"try:\n    {device}(Port.B)\nexcept OSError as e:\n    print(e.errno, str(e)[:18])"
    )
    assert output(source, robot=TWO_WHEELER) == "19 [Errno 19] ENODEV:"


def test_closed_motor_can_only_be_reopened() -> None:
    source = (
        MOTOR
        + """
motor.close()
try:
    motor.run(100)
except OSError as e:
    print(e.errno)
motor.stop()
motor.close()
Motor(Port.A, gears=[1, 2])
print(motor)
"""
    )
    assert output(source) == "19\nMotor(Port.A, Direction.CLOCKWISE)"


def test_second_motor_object_ends_control() -> None:
    source = (
        MOTOR
        + """
def number(call, *args):
    try:
        call(*args)
        return 0
    except OSError as e:
        return e.errno
motor.run(300)
wait(500)
print(number(Motor, Port.A), number(motor.angle), number(motor.run, 100), number(motor.hold), number(motor.stop), motor.done())
print(number(Motor, Port.A), number(motor.close), number(Motor, Port.A), number(motor.angle))
"""  # noqa: E501
    )
    assert output(source) == "16 19 19 19 0 True\n16 0 0 0"


# What the firmware's code answers on a computer (v4.1.0b2, its own motor simulation: a motor
# without load).
@pytest.mark.parametrize(
    ("call", "angle", "time_ms"),
    [
        ("motor.run_until_stalled(600, duty_limit=10)", 0, 235),
        ("motor.control.limits(torque=50)\nmotor.run_time(-480, 1203)", -225, 1285),
    ],
)
def test_torque_limit_includes_feedforward(call: str, angle: int, time_ms: int) -> None:
    measured = output(MOTOR + f"{call}\nprint(motor.angle(), watch.time())").split()
    assert abs(int(measured[0]) - angle) <= 1 and abs(int(measured[1]) - time_ms) <= 5


def test_motor_stalls_at_end_stop() -> None:
    robot = Robot("arm", HubKind.PRIME, (Motor("arm", "A", MotorKind.SPIKE_LARGE),))
    body = BenchBody(robot, end_stops={"arm": (-142.0, 142.0)})
    source = MOTOR + "print(motor.run_until_stalled(300, duty_limit=25), watch.time())\n"
    source += "wait(500)\nwatch.reset()\nmotor.run_until_stalled(-300, Stop.HOLD, 60)\n"
    source += "print(watch.time(), motor.angle(), motor.load())\n"
    source += "wait(300)\nprint(motor.angle(), motor.load())"
    first, second, third = (
        line.split() for line in output(source, robot=robot, body=body).splitlines()
    )
    assert first[0] == "142" and abs(int(first[1]) - 1265) <= 5
    assert (
        abs(int(second[0]) - 1260) <= 5 and second[1] == "-142" and abs(int(second[2]) - 221) <= 2
    )
    assert third[0] == "-142" and abs(int(third[1]) - 111) <= 1


def test_stalled_motor_stays_stalled() -> None:
    source = MOTOR + (
        "try:\n    motor.run_until_stalled(100, then=Stop.NONE)\nexcept ValueError as e:\n"
        "    print(e, motor.done())"
    )
    assert output(source) == "Invalid argument True"


def test_angle_zero_survives_direction_change() -> None:
    source = (
        MOTOR
        + """
motor.run_target(500, 90)
motor.reset_angle(40)
motor.close()
motor = Motor(Port.A, Direction.COUNTERCLOCKWISE, reset_angle=False)
print(motor.angle())
motor.reset_angle()
print(motor.angle())
"""
    )
    assert output(source) in ("-40\n-89", "-40\n-90")


def test_moves_can_be_awaited_together() -> None:
    source = (
        HEAD
        + """
a, b = Motor(Port.A), Motor(Port.B)
async def main():
    print(await multitask(a.run_angle(500, 180), b.run_angle(250, 180)))
    print(watch.time() < 1100, a.angle(), b.angle())
    await a.run_target(500, 0)
    print(abs(a.angle()) <= 2)
run_task(main())
"""
    )
    first, second, third = output(source).splitlines()
    assert (first, second.split()[0], third) == ("(None, None)", "True", "True")


def test_cancelled_move_coasts_replaced_move_ends() -> None:
    source = (
        MOTOR
        + """
async def turn():
    await motor.run_angle(500, 5000)
    print('over', watch.time() < 300)
async def main():
    await multitask(turn(), wait(200), race=True)
    print(motor.done(), motor.angle() < 200)
    async def replace():
        await wait(100)
        motor.run(100)
    watch.reset()
    await multitask(turn(), replace())
run_task(main())
"""
    )
    assert output(source) == "True True\nover True"


def test_ultrasonic_sensor() -> None:
    robot = Robot(
        "look", HubKind.PRIME, motors=(Motor("m", "A"),), sensors=(UltrasonicSensor("eyes", "C"),)
    )
    source = (
        HEAD
        + """
eyes = UltrasonicSensor(Port.C)
print(eyes.distance(), eyes.presence())
eyes.lights.on(100)
eyes.lights.on([0, 100, 50.5, 20])
eyes.lights.off()
try:
    eyes.lights.on([1, 2])
except ValueError as e:
    print(e)
async def main():
    await eyes.lights.on(50)
    print(await eyes.distance())
run_task(main())
"""
    )
    assert output(source, robot=robot) == "2000 False\nexpected 1 number or tuple of 4 values\n2000"


def test_controller_scale_and_old_methods() -> None:
    source = (
        MOTOR
        + """
print(motor.control.scale, Motor(Port.B, gears=[12, 36]).control.scale)
print(motor.control.trajectory(), motor.control.done(), motor.control.load(), motor.control.stalled())
motor.run_angle(500, 90, wait=False)
wait(100)
print(motor.control.trajectory(), motor.control.done())
motor.control.limits(acceleration=(500, 400))
try:
    motor.control.limits(acceleration=-500)
except ValueError as e:
    print(e, motor.control.limits())
try:
    motor.control.limits(speed=300, torque=0)
except ValueError as e:
    print(e, motor.control.limits())
"""  # noqa: E501
    )
    assert output(source).splitlines() == [
        "1000 3000",
        "None True 0 False",
        "(0, 212, 212, 424, 0, 45, 45, 90, 0, 424, 0, 2000, -2000) False",
        "Invalid argument (1000, (500, 400), 199)",
        "Invalid argument (300, (500, 400), 199)",
    ]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        ("motor.run(500, foo=1)", "extra keyword arguments given"),
        ("motor.run(foo=1)", "'speed' argument required"),
        ("motor.run_angle(100, 50, wait=False, speed=3)", "extra keyword arguments given"),
        ("motor.run_angle(100, foo=50)", "'rotation_angle' argument required"),
        ("wait(1, 2)", "extra positional arguments given"),
        ("sorted([1], foo=1)", "extra keyword arguments given"),
    ],
)
def test_wrong_arguments(call: str, says: str) -> None:
    assert output(MOTOR + f"try:\n    {call}\nexcept TypeError as e:\n    print(e)") == says


def test_infinite_arguments_are_clamped_and_nan_is_zero() -> None:
    """As a hub's processor converts floats; the firmware refuses none of these."""
    source = """
huge, nothing = float('inf'), float('nan')
m = Motor(Port.A)
for value in (huge, -huge, 1e12, nothing):
    for command in (m.run, m.dc, m.track_target, m.reset_angle, wait if value != 1e12 else m.run):
        command(value)
    m.reset_angle(0)
    m.run_angle(value, 0)
    m.run(value)
    wait(1000)
    print(m.speed() > 800, m.speed() < -800)
    m.stop()
    wait(500)
"""
    assert output(HEAD + source) == "True False\nFalse True\nTrue False\nFalse False"


def test_controller_that_begins_with_an_infinite_error_arrives() -> None:
    source = """
base = DriveBase(Motor(Port.A, Direction.COUNTERCLOCKWISE), Motor(Port.B), 56, 112)
before = float('inf')
while base.distance() < 100:
    error = -base.angle()
    base.drive(150, 2 * error + (error - before))
    before = error
    wait(10)
print(base.distance() >= 100)
"""
    assert output(HEAD + "from pybricks.robotics import DriveBase\n" + source) == "True"
