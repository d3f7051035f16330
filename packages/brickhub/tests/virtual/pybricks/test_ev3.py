"""EV3 Brick: its ports, devices and hub, as firmware 4.1 has them (``bricks/ev3``,
``pybricks/ev3devices``, v4.1.0b2)."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.robot import HubKind, MotorKind, Sense
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.firmware.motor_model import MOTOR_TYPES, Observer
from brickhub.virtual.firmware.servo import servo_settings
from brickhub.virtual.stimuli import Sensed

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
