"""Sensors and lights: results, errors, durations."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.errors import TwinError
from brickhub.hub.interface import PARTS, Interface, MotorAngle, RunAngle, SensorReading, Wait
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import HubKind, Motor, PoweredUpSensor, Robot, SensorKind, UltrasonicSensor
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

HEAD = """
from pybricks.pupdevices import *
from pybricks.parameters import *
from pybricks.tools import wait, StopWatch, multitask, run_task
watch = StopWatch()
"""


def one(kind: SensorKind) -> Robot:
    return Robot(
        "one", HubKind.PRIME, motors=(Motor("m", "A"),), sensors=(PoweredUpSensor("it", "B", kind),)
    )


def told(kind: SensorKind, source: str, **sensed: object) -> str:
    """Output of a program with a sensor on port B; ``it`` is its first stimulus."""
    robot = one(kind)
    readings = {
        ("it" if name == "it" else f"it.{name}"): (lambda angles, v=value: v)
        for name, value in sensed.items()
    }
    body = BenchBody(robot, readings)
    return output(HEAD + f"it = {kind.value}(Port.B)\n" + source, robot=robot, body=body)


def refusal(kind: SensorKind, call: str, **sensed: object) -> str:
    source = f"try:\n    {call}\nexcept Exception as e:\n    print(e)"
    return told(kind, source, **sensed)


# ---- the color sensor


def test_color_sensor_reads_surface() -> None:
    source = (
        "print(it.hsv(), it.color(), it.reflection(), it.hsv() == Color(130, 80, 40), it.hsv().h)"
    )
    assert (
        told(SensorKind.COLOR, source, it=(130, 80, 40))
        == "Color(h=130, s=80, v=39) Color.GREEN 19 False 130"
    )


def test_number_is_gray_brightness() -> None:
    source = "print(it.hsv(), it.color(), it.reflection(), it.color(surface=False), it.ambient())"
    assert (
        told(SensorKind.COLOR, source, it=62)
        == "Color(h=10, s=0, v=61) Color.WHITE 49 Color.NONE 0.0"
    )


@pytest.mark.parametrize(
    ("kind", "surface", "shown"),
    [
        (SensorKind.COLOR, 10, "Color(h=10, s=0, v=8) 6"),
        (SensorKind.COLOR, 25, "Color(h=10, s=0, v=24) 17"),
        (SensorKind.COLOR, 44, "Color(h=10, s=0, v=44) 32"),
        (SensorKind.COLOR, 80, "Color(h=10, s=0, v=80) 69"),
        (SensorKind.COLOR, (120, 50, 60), "Color(h=120, s=48, v=59) 38"),
        (SensorKind.COLOR_DISTANCE, 25, "Color(h=10, s=0, v=24) 14"),
        (SensorKind.COLOR_DISTANCE, 75, "Color(h=10, s=0, v=75) 55"),
        (SensorKind.COLOR_DISTANCE, 100, "Color(h=10, s=0, v=100) 110"),
    ],
)
def test_color_and_reflection_are_computed_from_raw_light(
    kind: SensorKind, surface: object, shown: str
) -> None:
    """As the firmware, built for a computer (v4.1.0b2), answers when its sensor sends the light of
    such a surface."""
    assert told(kind, "print(it.hsv(), it.reflection())", it=surface) == shown


@pytest.mark.parametrize(
    ("hue", "shown"), [(0, 10), (30, 40), (45, 52), (60, 60), (180, 180), (240, 240), (355, 2)]
)
def test_low_hues_are_shifted_as_in_the_firmware(hue: int, shown: int) -> None:
    assert told(SensorKind.COLOR, "print(it.hsv().h)", it=(hue, 100, 100)) == str(shown)


def test_ambient_light_is_a_hundredth_of_the_raw_value() -> None:
    assert (
        told(SensorKind.COLOR, "print(it.ambient(), it.hsv(False))", it=0, ambient=69)
        == "6.9 Color(h=0, s=0, v=69)"
    )


def test_color_sensor_ambient_mode() -> None:
    source = "print(it.hsv(surface=False), it.color(False), it.ambient(), it.color())"
    seen = told(SensorKind.COLOR, source, it=(0, 90, 80), ambient=(240, 95, 33))
    assert seen == "Color(h=240, s=95, v=33) Color.BLUE 3.3 Color.RED"


def test_detectable_colors_can_be_chosen() -> None:
    source = """
print(it.detectable_colors())
mine = [Color.MAGENTA, Color(h=130, s=70, v=30), Color.NONE]
print(it.detectable_colors(mine), it.detectable_colors() == mine)
print(it.color(), it.color() is mine[1])
it.detectable_colors(())
print(it.color())
"""
    assert told(SensorKind.COLOR, source, it=(130, 80, 40)) == (
        "(Color.RED, Color.YELLOW, Color.GREEN, Color.BLUE, Color.WHITE, Color.NONE)\nNone True\n"
        "Color(h=130, s=70, v=30) True\nNone"
    )


def test_program_may_create_sensor() -> None:
    source = """
class Eye(ColorSensor):
    def is_dark(self):
        return self.reflection() < 20
print(Eye(Port.B).is_dark())
"""
    assert told(SensorKind.COLOR, source, it=10) == "True"


def test_sensor_lights_take_one_or_three_values() -> None:
    source = (
        "it.lights.on(100)\nit.lights.on([0, 100, 50.5])\nit.lights.off()\nprint(it.reflection())"
    )
    assert told(SensorKind.COLOR, source, it=10) == "6"


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("it.lights.on((1, 2, 3, 4))", "expected 1 number or tuple of 3 values"),
        ("it.lights.on(None)", "can't convert NoneType to int"),
        ("it.detectable_colors([Color.RED, 5])", "can't convert int to Color"),
        ("it.detectable_colors(Color.RED)", "object 'Color' isn't a tuple or list"),
        ("it.reflection(5)", "function takes 1 positional arguments but 2 were given"),
        ("it.hsv(light=True)", "extra keyword arguments given"),
        ("it.distance()", "'ColorSensor' object has no attribute 'distance'"),
        ("UltrasonicSensor(Port.B)", "[Errno 19] ENODEV"),
        ("ForceSensor(Port.B)", "[Errno 19] ENODEV"),
        ("ColorSensor('B')", "can't convert str to Port"),
    ],
)
def test_refusals_of_color_sensor(call: str, error: str) -> None:
    assert refusal(SensorKind.COLOR, call, it=0).startswith(error)


def test_mode_change_takes_time() -> None:
    source = """
def spent(measure):
    watch.reset()
    measure()
    return watch.time()
print(spent(it.hsv), spent(it.reflection), spent(it.ambient), spent(it.ambient), spent(it.color))
it.lights.on(50)
print(spent(it.hsv))
async def main():
    watch.reset()
    print(await multitask(it.ambient(), wait(10)))
    print(watch.time() >= 30)
run_task(main())
"""
    assert told(SensorKind.COLOR, source, it=0, ambient=5) == "0 0 31 0 31\n31\n(0.5, None)\nTrue"


BUSY = "[Errno 11] EAGAIN: Try again later"
TASKS = """
async def tried(name, method, *values, after=0):
    await wait(after)
    try:
        print(name, await method(*values))
    except OSError as e:
        print(name, e)
async def main(*tasks):
    await multitask(*tasks)
"""


@pytest.mark.parametrize(
    ("kind", "tasks", "shown"),
    [
        (SensorKind.COLOR, "tried(1, it.ambient), tried(2, it.reflection, after=10)",
         f"2 {BUSY}\n1 0.0"),
        (SensorKind.COLOR, "tried(1, it.hsv), tried(2, it.ambient, after=10)",
         "1 Color(h=10, s=0, v=100)\n2 0.0"),
        (SensorKind.COLOR, "tried(1, it.hsv), tried(2, it.reflection)",
         "1 Color(h=10, s=0, v=100)\n2 100"),
        (SensorKind.COLOR, "tried(1, it.ambient), tried(2, it.ambient, after=20)", "1 0.0\n2 0.0"),
        (SensorKind.COLOR, "tried(1, it.lights.on, 50), tried(2, it.hsv, after=5)",
         f"2 {BUSY}\n1 None"),
        (SensorKind.COLOR, "tried(1, it.lights.on, 50), tried(2, it.lights.off, after=5)",
         "1 None\n2 None"),
        (SensorKind.COLOR_DISTANCE, "tried(1, it.distance), tried(2, it.light.off, after=9)",
         f"2 {BUSY}\n1 100"),
    ],
)  # fmt: skip
def test_nobody_changes_the_mode_during_a_change(kind: SensorKind, tasks: str, shown: str) -> None:
    """As ``pbio_port_lump_set_mode`` refuses it (firmware built for a computer, v4.1.0b2)."""
    assert told(kind, f"{TASKS}run_task(main({tasks}))", it=100) == shown


def test_sensor_is_busy_after_a_race_that_it_lost() -> None:
    source = """
async def main():
    await multitask(it.presence(), wait(20), race=True)
run_task(main())
try:
    it.distance()
except OSError as e:
    print(e)
wait(40)
print(it.distance())
"""
    robot = Robot(
        "look", HubKind.PRIME, motors=(Motor("m", "A"),), sensors=(UltrasonicSensor("eyes", "C"),)
    )
    assert output(HEAD + "it = UltrasonicSensor(Port.C)\n" + source, robot=robot) == f"{BUSY}\n2000"


def test_some_sensors_are_read_when_they_are_taken_into_use() -> None:
    times = "print(watch.time())\nit.{}\nprint(watch.time())\nit.{}\nprint(watch.time())"
    assert told(SensorKind.COLOR, times.format("hsv()", "lights.on(50)"), it=100) == "32\n32\n43"
    assert told(SensorKind.COLOR, times.format("ambient()", "hsv()"), it=100) == "32\n63\n94"
    assert (
        told(SensorKind.COLOR_DISTANCE, times.format("light.on(Color.RED)", "distance()"), it=100)
        == "0\n32\n63"
    )
    assert (
        told(SensorKind.FORCE, "it.force()\nwait(10)\nit.force()\nprint(watch.time())", it=1)
        == "13"
    )


# ---- the others


def test_color_distance_sensor() -> None:
    source = """
print(it.hsv(), it.color(), it.reflection(), it.ambient(), it.distance())
it.detectable_colors([Color.CYAN, Color.RED])
print(it.color())
it.light.on(Color.GREEN)
it.light.off()
"""
    seen = told(SensorKind.COLOR_DISTANCE, source, it=(200, 80, 50), ambient=12.4, distance=36)
    assert seen == "Color(h=200, s=79, v=49) Color.BLUE 20 12 40\nColor.CYAN"
    assert told(SensorKind.COLOR_DISTANCE, "print(it.ambient(), it.distance())", it=0) == "0 100"


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("it.remote(1)", "'ColorDistanceSensor' object has no attribute 'remote'"),
        ("it.hsv(True)", "function takes 1 positional arguments but 2 were given"),
        ("it.light.on(5)", "can't convert int to Color"),
        ("PFMotor(Port.B, 1, Color.RED)", "can't convert Port to ColorDistanceSensor"),
        ("PFMotor(it, 5, Color.RED)", "Invalid argument"),
        ("PFMotor(it, 1, Color.GREEN)", "Invalid argument"),
        ("PFMotor(it, 1, Color.RED, 1)", "can't convert int to Direction"),
    ],
)
def test_refusals_of_color_distance_sensor(call: str, error: str) -> None:
    assert refusal(SensorKind.COLOR_DISTANCE, call, it=0) == error


def test_pf_motor_takes_time() -> None:
    source = (
        "motor = PFMotor(it, 2, Color.BLUE)\nwatch.reset()\nmotor.dc(50)\nmotor.brake()\n"
        "motor.stop()\nprint(watch.time())"
    )
    assert told(SensorKind.COLOR_DISTANCE, source, it=0) == "754"


@pytest.mark.parametrize(
    ("newtons", "seen"),
    [
        (0, "0.0 0.0 False False False"),
        (0.1, "0.1 0.066 False False False"),
        (2.5, "2.5 1.667 False True True"),
        (3, "3.0 2.001 True True True"),
        (40, "10.0 6.67 True True True"),
    ],
)
def test_force_sensor(newtons: float, seen: str) -> None:
    source = "print(it.force(), it.distance(), it.pressed(), it.touched(), it.pressed(force=0.2))"
    assert told(SensorKind.FORCE, source, it=newtons) == seen
    assert (
        refusal(SensorKind.FORCE, "it.pressed('hard')", it=newtons) == "can't convert str to float"
    )


@pytest.mark.parametrize(
    ("distance_pct", "seen"), [(100, "0.2 100 0"), (10, "20.0 10 0"), (0, "100.0 2 0")]
)
def test_infrared_sensor(distance_pct: float, seen: str) -> None:
    source = "print(it.reflection(), it.distance(), it.count())"
    assert told(SensorKind.INFRARED, source, it=distance_pct, count=7) == seen, (
        "it counts from when the program starts"
    )


def test_infrared_sensor_counts() -> None:
    robot = one(SensorKind.INFRARED)
    body = BenchBody(robot, {"it": lambda angles: 50, "it.count": lambda angles: angles["m"] // 90})
    source = (
        HEAD + "it = InfraredSensor(Port.B)\nMotor(Port.A).run_angle(500, 280)\nprint(it.count())"
    )
    assert output(source, robot=robot, body=body) == "3"


def test_tilt_sensor() -> None:
    assert told(SensorKind.TILT, "print(it.tilt())", it=(12.6, -70)) == "(13, -45)"
    assert (
        told(
            SensorKind.TILT,
            "async def main():\n    print(await it.tilt())\nrun_task(main())",
            it=(1, 2),
        )
        == "(1, 2)"
    )


def test_lights_need_no_readings() -> None:
    assert told(SensorKind.LIGHT, "it.on()\nit.on(50)\nit.off()\nprint(1)") == "1"
    assert refusal(SensorKind.LIGHT, "it.on('dim')") == "can't convert str to int"
    assert (
        told(
            SensorKind.COLOR_LIGHT_MATRIX,
            "it.on(Color.RED)\nit.on([Color.RED] * 9)\nit.off()\nprint(1)",
        )
        == "1"
    )
    assert refusal(SensorKind.COLOR_LIGHT_MATRIX, "it.on(5)") == "'int' object isn't iterable"
    assert refusal(SensorKind.COLOR_LIGHT_MATRIX, "it.on([5] * 9)") == "can't convert int to Color"


def test_ultrasonic_sensor_waits_after_lights() -> None:
    robot = Robot(
        "look", HubKind.PRIME, motors=(Motor("m", "A"),), sensors=(UltrasonicSensor("eyes", "C"),)
    )
    source = HEAD + (
        "eyes = UltrasonicSensor(Port.C)\neyes.distance()\neyes.lights.on(9)\neyes.distance()\n"
        "print(watch.time())"
    )
    assert output(source, robot=robot) == "63", "12 ms to write, 51 ms of stale values"


# ---- described, and observed


@pytest.mark.parametrize(
    ("kind", "method", "sensed", "says"),
    [
        (SensorKind.FORCE, "force", (1, 2, 3), "give a number"),
        (SensorKind.COLOR, "hsv", (1, 2), "give a brightness or"),
        (SensorKind.TILT, "tilt", 5, "give .pitch, roll."),
    ],
)
def test_wrong_stimulus_raises(kind: SensorKind, method: str, sensed: object, says: str) -> None:
    with pytest.raises(TwinError, match=says):
        told(kind, f"it.{method}()", it=sensed)


def test_unknown_stimulus_raises() -> None:
    robot = one(SensorKind.COLOR)
    with pytest.raises(TwinError, match=r"no sensor 'it.force'; it senses it, it.ambient"):
        BenchBody(robot, {"it": lambda angles: 0, "it.force": lambda angles: 1})


def channels(kind: SensorKind, method: str) -> tuple[SensorReading, ...]:
    return tuple(SensorReading("it", method, -360, 360, part=part) for part in PARTS[method])


@pytest.mark.parametrize(
    ("kind", "method", "sensed", "seen"),
    [
        (SensorKind.COLOR, "hsv", (300, 70, 40), [300, 69, 39]),
        (SensorKind.TILT, "tilt", (20, -30), [20, -30]),
    ],
)
def test_parts_share_one_measurement(kind, method, sensed, seen) -> None:
    interface = Interface(
        (RunAngle("m", -90, 90, 500),), (MotorAngle("m"), *channels(kind, method)), Wait(300)
    )
    transport = VirtualHub(BenchBody(one(kind), {"it": lambda angles: sensed}))
    with HubLink(transport, one(kind), interface) as link:
        assert link.program.source.count(f"sensor_it.{method}()") == 1
        assert link.act([10.0]).values[1:] == tuple(seen)
