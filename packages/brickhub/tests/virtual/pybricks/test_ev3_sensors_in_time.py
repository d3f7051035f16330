"""Sensors of an EV3 over time: a gyroscope that is calibrated while it turns, the infrared remote
on its channels, a silent sonar, and the lamps."""

from __future__ import annotations

import colorsys
from typing import Any

import pytest
from hub_programs import Console

from brickhub.robot import HubKind, Sense
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel
from brickhub.virtual.pybricks import modules
from brickhub.virtual.run_log import RunLog
from brickhub.virtual.stimuli import Sensed

HEAD = """
from pybricks.hubs import EV3Brick
from pybricks.ev3devices import *
from pybricks.parameters import Button, Color, Direction, Port
from pybricks.tools import StopWatch, wait
watch = StopWatch()
def error(call, *values):
    try:
        return call(*values)
    except OSError as raised:
        return raised.errno
    except Exception as raised:
        return repr(raised)
"""


class Turning(FittedBench):
    """Whatever turns does so at this rate, from this angle on; sensors sense the rest."""

    def __init__(self, rate_deg_s: float = 0.0, start_deg: float = 0.0, **sensed: Any) -> None:
        super().__init__(HubKind.EV3)
        self.rate_deg_s = rate_deg_s
        self.start_deg = start_deg
        self.stimuli = sensed

    def sensed(self, port: str, sense: Sense) -> Sensed:
        if sense is Sense.ROTATION:
            return self.start_deg + self.rate_deg_s * self._time_ms / 1000, self.rate_deg_s
        if str(sense) in self.stimuli:
            return self.stimuli[str(sense)]  # type: ignore[no-any-return]
        return super().sensed(port, sense)

    def distance_mm(self, port: str) -> int:
        return int(self.stimuli.get("distance", 0.0)) + self._time_ms


def run(body: FittedBench, source: str, *held: str) -> tuple[list[str], Machine]:
    panel = Panel(HubKind.EV3)
    for button in held:
        panel.hold(f"infrared.{button}")
    machine = Machine(body, panel)
    machine.log = RunLog()
    console = Console(machine, {})
    execute(HEAD + source, "main.py", modules(machine, console), console)
    return console.written.decode().replace("\r\n", "\n").splitlines(), machine


def test_a_gyroscope_counts_from_the_begin_of_the_program() -> None:
    source = """
gyro = GyroSensor(Port.S2)
start = watch.time()
print(start, gyro.angle(), gyro.speed())
wait(1000 - start)
print(gyro.angle(), gyro.speed())
gyro.reset_angle(500)
print(gyro.angle())
wait(1000)
print(gyro.angle())
gyro.reset_angle(-20.9)
print(gyro.angle(), error(gyro.reset_angle, "a"))
"""
    printed, _ = run(Turning(rate_deg_s=50.0, start_deg=-70.0), source)
    start_ms, angle, speed = map(int, printed[0].split())
    assert 100 <= start_ms <= 110 and (angle, speed) == (0, 50)
    assert int(printed[1].split()[0]) == pytest.approx(50 - start_ms / 20, abs=1)
    assert printed[2] == "500"
    assert int(printed[3]) == pytest.approx(550, abs=1)
    assert printed[4] == '-20 TypeError("can\'t convert str to int",)'


def test_a_gyroscope_upside_down_counts_the_other_way() -> None:
    source = """
gyro = GyroSensor(Port.S2, Direction.COUNTERCLOCKWISE)
gyro.reset_angle(10)
wait(1000)
print(gyro.angle(), gyro.speed())
print(error(GyroSensor, Port.S2, 5))
"""
    printed, machine = run(Turning(rate_deg_s=50.0), source)
    angle, speed = map(int, printed[0].split())
    assert angle == pytest.approx(-40, abs=1) and speed == -50
    assert printed[1] == 'TypeError("can\'t convert int to Direction",)'
    assert machine.log is not None
    machine.log.sample(0, {})
    *_, row = machine.log.rows()
    assert (row["2_angle_deg"], row["2_rate_deg_s"]) == (angle, -50)


def test_a_gyroscope_that_turns_while_it_is_calibrated_takes_that_for_rest() -> None:
    """It is off for 300 ms and settles for 200 (``pb_type_ev3devices_gyrosensor.c``)."""
    source = """
gyro = GyroSensor(Port.S2)
wait(2000)
watch.reset()
gyro.calibrate()
print(watch.time(), gyro.angle(), gyro.speed())
wait(1000)
print(gyro.angle(), gyro.speed())
"""
    printed, _ = run(Turning(rate_deg_s=60.0), source)
    took_ms, angle, speed = map(int, printed[0].split())
    assert took_ms == pytest.approx(500, abs=2)
    assert speed == 0
    later_angle, later_speed = map(int, printed[1].split())
    assert later_angle == pytest.approx(angle, abs=1) and later_speed == 0
    at_rest, _ = run(Turning(), source)
    assert at_rest[1] == "0 0"


def test_nothing_is_read_while_a_gyroscope_is_calibrated() -> None:
    source = """
from pybricks.tools import multitask, run_task
gyro = GyroSensor(Port.S2)
async def calibrate():
    await gyro.calibrate()
    print("done", watch.time() > 500)
async def look():
    await wait(100)
    print(error(gyro.angle), error(gyro.speed), error(gyro.reset_angle, 0), error(gyro.calibrate))
run_task(multitask(calibrate(), look()))
print(gyro.angle())
"""
    printed, _ = run(Turning(), source)
    assert printed == ["11 11 11 11", "done True", "0"]


@pytest.mark.parametrize(
    ("held", "buttons", "keypad"),
    [
        ("", "", ""),
        ("left_up", "LEFT_UP", "LEFT_UP"),
        ("left_down", "LEFT_DOWN", "LEFT_DOWN"),
        ("right_up", "RIGHT_UP", "RIGHT_UP"),
        ("right_down", "RIGHT_DOWN", "RIGHT_DOWN"),
        ("left_up right_up", "LEFT_UP RIGHT_UP", "LEFT_UP RIGHT_UP"),
        ("left_down right_up", "LEFT_DOWN RIGHT_UP", "LEFT_DOWN RIGHT_UP"),
        ("beacon", "BEACON", ""),
        ("left_up left_down", "LEFT_UP LEFT_DOWN", "LEFT_UP LEFT_DOWN"),
        ("left_up left_down right_up", "", "LEFT_UP LEFT_DOWN RIGHT_UP"),
    ],
)
def test_buttons_of_the_remote(held: str, buttons: str, keypad: str) -> None:
    """The sensor tells pairs on each channel, or all four buttons on the first."""
    source = """
eye = InfraredSensor(Port.S4)
print(*sorted(str(button) for button in eye.buttons(1)))
print([eye.buttons(channel) for channel in (2, 3, 4)])
print(*eye.keypad())
print(error(eye.buttons, 0), error(eye.buttons, 5), error(eye.beacon, 0), error(eye.beacon, 5))
"""
    printed, _ = run(Turning(), source, *held.split())
    assert printed[0] == " ".join(f"Button.{name}" for name in sorted(buttons.split()))
    assert printed[1] == "[set(), set(), set()]"
    assert printed[2] == " ".join(f"Button.{name}" for name in keypad.split())
    assert printed[3] == " ".join(["ValueError('Invalid argument',)"] * 4)


@pytest.mark.parametrize(
    ("beacon", "seen"),
    [
        ((), "(None, None)"),
        ((40.0, 0.0), "(40, 0)"),
        ((0.0, 30.0), "(0, 30)"),
        ((99.6, -31.0), "(100, -30)"),
        ((20.0, 90.0), "(20, 75)"),
    ],
)
def test_a_beacon_is_on_the_first_channel(beacon: tuple[float, ...], seen: str) -> None:
    source = "eye = InfraredSensor(Port.S4)\nprint(eye.beacon(1), eye.beacon(2), eye.beacon(4))"
    printed, _ = run(Turning(beacon=beacon), source)
    assert printed == [f"{seen} (None, None) (None, None)"]


def test_a_silent_sonar_measures_when_it_is_told_to() -> None:
    """The distance grows by a millimetre a millisecond here."""
    source = """
sonar = UltrasonicSensor(Port.S3)
wait(100)
print(sonar.distance(), watch.time())
wait(100)
first = sonar.distance(silent=True)
wait(100)
print(sonar.distance(silent=True) == first, sonar.distance(True) == first, sonar.presence())
wait(100)
print(sonar.distance() - watch.time() < 1010, sonar.distance(True) > first)
"""
    printed, _ = run(Turning(distance=1000.0), source)
    assert printed[0].split()[0] == str(1000 + int(printed[0].split()[1]))
    assert printed[1:] == ["True True False", "True True"]


@pytest.mark.parametrize(
    ("newtons", "pressed"), [(0.0, "False"), (0.49, "False"), (0.5, "True"), (3.0, "True")]
)
def test_a_button_is_pressed_by_half_a_newton(newtons: float, pressed: str) -> None:
    printed, _ = run(Turning(force=newtons), "print(TouchSensor(Port.S1).pressed())")
    assert printed == [pressed]


@pytest.mark.parametrize(
    ("surface", "color", "rgb", "reflected"),
    [
        ((0, 100, 100), "RED", "(100, 0, 0)", 100),
        ((0, 0, 100), "WHITE", "(100, 100, 100)", 100),
        ((240, 100, 100), "BLUE", "(0, 0, 100)", 0),
        ((30, 100, 50), "BROWN", "(50, 25, 0)", 50),
        ((0, 0, 0), "NONE", "(0, 0, 0)", 0),
    ],
)
def test_colors_of_a_surface(
    surface: tuple[int, int, int], color: str, rgb: str, reflected: int
) -> None:
    source = "eye = ColorSensor(Port.S1)\nprint(eye.color())\nprint(eye.rgb(), eye.reflection())"
    printed, machine = run(Turning(surface=surface), source)
    assert printed == [f"Color.{color}", f"{rgb} {reflected}"]
    assert machine.log is not None
    machine.log.sample(0, {})
    *_, row = machine.log.rows()
    assert row["1_color"] == f"Color.{color}"
    assert [row[f"1_{name}_pct"] for name in ("red", "green", "blue")] == [*map(float, eval(rgb))]  # noqa: S307


@pytest.mark.parametrize("hue", [0, 20, 60, 100, 120, 180, 240, 300, 330])
@pytest.mark.parametrize(("saturation", "value"), [(100, 100), (100, 40), (50, 80), (0, 60)])
def test_lamps_show_the_red_and_the_green_of_a_color(hue: int, saturation: int, value: int) -> None:
    red, green, _ = colorsys.hsv_to_rgb(hue / 360, saturation / 100, value / 100)
    source = f"EV3Brick().light.on(Color({hue}, {saturation}, {value}))"
    _, machine = run(Turning(), source)
    if not max(red, green):
        assert machine.panel.light is None
        return
    without_blue, full, brightness = colorsys.rgb_to_hsv(red, green, 0.0)
    assert machine.panel.light == (
        round(360 * without_blue),
        round(100 * full),
        round(100 * brightness),
    )


def test_a_brick_says_that_it_is_three_quarters_loud() -> None:
    source = """
speaker = EV3Brick().speaker
print(speaker.volume(), speaker.volume(30), speaker.volume())
"""
    assert run(Turning(), source)[0] == ["75 None 30"]
