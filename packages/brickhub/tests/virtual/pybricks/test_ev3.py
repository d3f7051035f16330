"""EV3 Brick: its ports, devices and hub, as firmware 4.1 has them (``bricks/ev3``,
``pybricks/ev3devices``, v4.1.0b2)."""

from __future__ import annotations

import pytest
from hub_programs import Console, output

from brickhub.robot import HubKind, MotorKind, Sense, SensorKind
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES, Observer
from brickhub.virtual.firmware.servo import servo_settings
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.panel import Panel, parse_press
from brickhub.virtual.pybricks import modules
from brickhub.virtual.stimuli import Sensed

EV3_SENSORS = (
    SensorKind.EV3_ULTRASONIC,
    SensorKind.EV3_GYRO,
    SensorKind.EV3_COLOR,
    SensorKind.EV3_INFRARED,
)
HEAD = """
from pybricks.hubs import EV3Brick
from pybricks.ev3devices import *
from pybricks.parameters import Button, Color, Direction, Port
from pybricks.robotics import DriveBase
from pybricks.tools import wait
def error(call, *values):
    try:
        return call(*values)
    except Exception as raised:
        return type(raised), raised.args[0]
"""


def on_brick(source: str, **stimuli: Sensed) -> str:
    """What a program prints on a bench with these stimuli, such as ``S1_force``."""
    bench = FittedBench(HubKind.EV3)
    for name, stimulus in stimuli.items():
        port, sense = name.removeprefix("S").split("_")
        bench.set_reading(port, Sense(sense), stimulus)
    return output(HEAD + source, body=bench)


def test_names_of_the_brick() -> None:
    source = """
import pybricks, usys
from pybricks.nxtdevices import Motor as NxtMotor, LightSensor
from pybricks.pupdevices import Motor as OtherMotor
from pybricks.hubs import PrimeHub, ThisHub
print(pybricks.version[0], usys.implementation[2], OtherMotor is Motor is NxtMotor)
print(EV3Brick is PrimeHub, ForceSensor is TouchSensor, Port.E is Port.S1, Port.F is Port.S2)
brick = EV3Brick(Color.RED, top_side=3)
print([name for name in dir(brick) if name[0] != "_"])
"""
    assert on_brick(source).splitlines() == [
        "ev3 MINDSTORMS EV3 Brick with TI Sitara AM1808 True",
        "True True True True",
        "['battery', 'buttons', 'light', 'screen', 'speaker', 'system']",
    ]


def test_devices_fit_their_ports_only() -> None:
    source = """
print(error(Motor, Port.S2), error(TouchSensor, Port.A), error(ColorSensor, Port.B))
motor = Motor(Port.A)
print(motor, error(motor.reset_angle))
"""
    assert on_brick(source).splitlines() == [
        "(<class 'OSError'>, 19) (<class 'OSError'>, 95) (<class 'OSError'>, 95)",
        "Motor(Port.A, Direction.CLOCKWISE) (<class 'OSError'>, 95)",
    ]


def test_readings_of_the_sensors() -> None:
    source = """
touch, color, sonar, gyro = TouchSensor(Port.S1), ColorSensor(Port.S2), UltrasonicSensor(Port.S3), GyroSensor(Port.S4)
print(touch.pressed(), color.reflection(), color.color(), color.rgb(), color.ambient())
print(sonar.distance(), sonar.distance(True), sonar.presence())
print(gyro.angle(), gyro.speed(), gyro.reset_angle(-5), gyro.angle(), error(gyro.reset_angle))
print(gyro.calibrate(), gyro.angle())
back = GyroSensor(Port.S4, Direction.COUNTERCLOCKWISE)
print(back.angle(), back.speed())
"""  # noqa: E501
    printed = on_brick(
        source,
        S1_force=3.0,
        S2_surface=(120, 100, 80),
        S2_ambient=7.0,
        S3_distance=1234.0,
        S4_rotation=(30.0, 12.0),
    )
    assert printed.splitlines() == [
        "True 0 Color.GREEN (0, 80, 0) 7",
        "1234 1234 False",
        "0 12 None -5 (<class 'TypeError'>, \"'angle' argument required\")",
        "None -35",
        "0 -12",
    ]


def test_settings_of_the_motors_to_the_digit() -> None:
    """``servo_settings.c`` with the override of kp, ki and kd."""
    for kind, gains, limits, tuned in (
        (MotorKind.EV3_LARGE, (24944, 12472, 779), (800, 2000, 2000, 449), (825, 30, 210)),
        (MotorKind.EV3_MEDIUM, (5731, 4298, 214), (1200, 2000, 2000, 206), (2680, 45, 315)),
    ):
        settings = servo_settings(MOTOR_TYPES[kind], 1000, 0)
        assert settings.group("pid")[:3] == gains
        assert settings.limits() == limits
        observer = Observer(MOTOR_TYPES[kind], settings).settings
        assert (observer.negligible_mv, observer.gain_low, observer.gain_high) == tuned
    assert MOTOR_TYPES[MotorKind.NXT] == MOTOR_TYPES[MotorKind.EV3_LARGE]


@pytest.mark.parametrize("kind", [MotorKind.EV3_LARGE, MotorKind.EV3_MEDIUM])
def test_estimated_speed_is_half_the_true_one(kind: MotorKind) -> None:
    """The observer's model is discretised for 10 ms and runs every 5 ms; the motor's is not."""
    bench = FittedBench(HubKind.EV3, devices={"A": kind})
    source = "m = Motor(Port.A)\nm.run(500)\nwait(2000)\nprint(m.speed(), m.model.state()[1])"
    true_deg_s, estimate_deg_s = map(float, output(HEAD + source, body=bench).split())
    assert true_deg_s == pytest.approx(500, abs=15)
    assert estimate_deg_s == pytest.approx(true_deg_s / 2, rel=0.06)


def pressing(source: str, *presses: str, **stimuli: Sensed) -> tuple[str, Panel]:
    """What a program prints while somebody presses buttons."""
    bench = FittedBench(HubKind.EV3)
    for name, stimulus in stimuli.items():
        port, sense = name.removeprefix("S").split("_")
        bench.set_reading(port, Sense(sense), stimulus)
    machine = Machine(bench, Panel(HubKind.EV3, map(parse_press, presses)))
    console = Console(machine, {})
    try:
        execute(HEAD + source, "main.py", modules(machine, console), console)
    except SystemExit:
        console.write(b"stopped")
    return console.written.decode().replace("\r\n", "\n"), machine.panel


def test_infrared_beacon_and_remote() -> None:
    source = """
eye = InfraredSensor(Port.S4)
print(eye.distance(), eye.beacon(1), eye.beacon(2), error(eye.beacon, 5))
wait(2000)
print(eye.buttons(1) == {Button.LEFT_UP, Button.RIGHT_DOWN}, eye.buttons(3))
print(eye.keypad())
wait(6000)
print(eye.keypad(), eye.buttons(1))
"""
    printed, _ = pressing(
        source,
        "infrared.left_up@1s+8s",
        "infrared.right_down@1s+8s",
        S4_distance=35.0,
        S4_beacon=(40.0, -30.0),
    )
    assert printed.splitlines() == [
        "35 (40, -30) (None, None) (<class 'ValueError'>, 'Invalid argument')",
        "True set()",
        "[Button.LEFT_UP, Button.RIGHT_DOWN]",
        "[] set()",
    ]


def test_a_change_of_mode_takes_its_time() -> None:
    source = """
from pybricks.tools import StopWatch
watch = StopWatch()
color, eye = ColorSensor(Port.S1), InfraredSensor(Port.S2)
for read in (color.ambient, color.ambient, color.rgb, eye.distance, eye.keypad):
    start = watch.time()
    read()
    print(watch.time() - start, end=" ")
"""
    times_ms = [int(word) for word in on_brick(source).split()]
    assert times_ms == pytest.approx([31, 0, 31, 0, 1101], abs=2)


def test_buttons_and_the_one_that_stops() -> None:
    source = """
buttons = EV3Brick().buttons
wait(500)
print(sorted(map(str, buttons.pressed())))
while True:
    wait(10)
"""
    printed, panel = pressing(source, "up@0.4s", "down@0.4s", "center@0.4s", "left_up@1s")
    assert printed == "['Button.CENTER', 'Button.DOWN', 'Button.UP']\nstopped"
    assert panel.now_s == pytest.approx(1.05, abs=0.05)


def test_light_is_red_and_green_without_blue() -> None:
    source = "light = EV3Brick().light\nlight.on({color})"
    for color, light in (
        ("Color.RED", (0, 100, 100)),
        ("Color.GREEN", (120, 100, 100)),
        ("Color.YELLOW", (60, 100, 100)),
        ("Color.WHITE", (60, 100, 100)),
        ("Color.BLUE", None),
    ):
        _, panel = pressing(source.replace("{color}", color))
        assert panel.light == light, color


def test_a_color_is_shown_once_as_the_lamps_have_it() -> None:
    shown: list[object] = []
    machine = Machine(FittedBench(HubKind.EV3), Panel(HubKind.EV3))
    machine.panel.on_change = lambda panel: shown.append(panel.light)
    console = Console(machine, {})
    source = HEAD + "light = EV3Brick().light\nlight.on(Color.MAGENTA)\nlight.on(Color.BLUE)"
    execute(source, "main.py", modules(machine, console), console)
    assert shown == [(0, 100, 100), None]


def test_what_the_brick_has_not() -> None:
    source = """
brick = EV3Brick()
print([name for name in ("imu", "display", "charger", "ble", "button") if hasattr(brick, name)])
print(error(brick.battery.temperature)[1], brick.battery.type(), brick.system.info()["host_connected_ble"])
base = DriveBase(Motor(Port.A), Motor(Port.B), 56, 114)
print(hasattr(base, "use_gyro"), hasattr(Motor, "hsv"), hasattr(ColorSensor, "hsv"))
"""  # noqa: E501
    assert on_brick(source).splitlines() == ["[]", "95 Alkaline False", "False False False"]


def test_plain_devices() -> None:
    source = """
from pybricks.iodevices import AnalogSensor, DCMotor, I2CDevice, LUMPDevice, PUPDevice
from pybricks.messaging import bluetooth_scan
from pybricks.nxtdevices import LightSensor
print(LUMPDevice is PUPDevice, PUPDevice(Port.A).info(), bluetooth_scan(100))
motor = DCMotor(Port.A)
motor.dc(60)
print(motor, error(AnalogSensor, Port.S1), AnalogSensor(Port.S1, custom=True).voltage())
print(error(I2CDevice, Port.A, 1), error(I2CDevice(Port.S1, 1, custom=True).read, 0, 1)[0])
ColorSensor(Port.S3)
print(PUPDevice(Port.S3).info()["id"], error(PUPDevice, Port.S2), error(LightSensor, Port.S1))
"""
    assert on_brick(source).splitlines() == [
        "True {'id': 93} []",
        "DCMotor(Port.A, Direction.CLOCKWISE) (<class 'OSError'>, 19) 4972",
        "(<class 'OSError'>, 95) <class 'OSError'>",
        "29 (<class 'OSError'>, 19) (<class 'OSError'>, 19)",
    ]


def test_sensors_in_their_own_modes() -> None:
    """By the modes that ev3dev's ``ev3_uart_sensor_defs.c`` describes: a gyroscope counts up to
    32767 degrees and 440 degrees a second, a sonar tells mm or tenths of inches."""
    source = """
from pybricks.iodevices import PUPDevice
sonar, gyro, color, infrared = (PUPDevice(port) for port in (Port.S1, Port.S2, Port.S3, Port.S4))
print([sonar.read(mode) for mode in range(7)])
print([gyro.read(mode) for mode in range(5)])
print([color.read(mode) for mode in range(3)], len(color.read(4)), len(color.read(5)))
print(infrared.read(0), infrared.read(1), infrared.read(2), infrared.read(3))
"""
    sensed = {
        "S1_distance": 254.0,
        "S2_rotation": (-40_000.0, 441.0),
        "S3_surface": (0, 100, 100),
        "S3_ambient": 6.6,
        "S4_distance": 101.0,
        "S4_beacon": (20.4, 31.0),
    }
    modes = FittedBench(HubKind.EV3, devices=dict(zip("1234", EV3_SENSORS, strict=True)))
    for name, stimulus in sensed.items():
        port, sense = name.removeprefix("S").split("_")
        modes.set_reading(port, Sense(sense), stimulus)
    printed = output(HEAD + source, body=modes).splitlines()
    assert printed[0] == "[(254,), (100,), (0,), (254,), (100,), (254,), (100,)]"
    assert printed[1] == "[(-32767,), (440,), (0,), (-32767, 440), (0, 0, 0, 0)]"
    assert printed[2] == "[(100,), (7,), (5,)] 3 4"
    assert printed[3].startswith("(100,) (10, 20, ")
    assert printed[3].endswith(" (0, 0, 0, 0) (384,)")


def test_a_sensor_says_nothing_for_some_time_after_another_mode() -> None:
    """30 ms of a color sensor, 1100 ms of an infrared one (``lego/device.h``)."""
    source = """
from pybricks.tools import StopWatch
infrared, color = InfraredSensor(Port.S4), ColorSensor(Port.S2)
watch = StopWatch()
def took(call, *values):
    watch.reset()
    call(*values)
    return watch.time()
print(took(infrared.distance), took(infrared.beacon, 1), took(infrared.beacon, 1))
print(took(color.reflection), took(color.ambient), took(color.ambient), took(color.rgb))
"""
    seen, lit = (list(map(int, line.split())) for line in on_brick(source).splitlines())
    assert seen == [0, pytest.approx(1101, abs=2), 0]
    assert lit == [0, pytest.approx(31, abs=2), 0, pytest.approx(31, abs=2)]


def test_what_is_open_or_at_rest() -> None:
    source = """
brick = EV3Brick()
print(brick.battery.type(), brick.battery.current() > 0)
print(brick.system.storage(0, write=b"abc"), brick.system.storage(1, read=2))
print(brick.system.reset_storage(), brick.system.storage(0, read=3))
"""
    assert on_brick(source).splitlines() == [
        "Alkaline True",
        "None b'bc'",
        "None b'\\x00\\x00\\x00'",
    ]
