"""Names of the firmware's classes, as a program prints them; a few have none."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.robot import HubKind
from brickhub.virtual.bench_body import FittedBench

PRIME = """
from pybricks.hubs import PrimeHub
from pybricks.iodevices import *
from pybricks.messaging import *
from pybricks.parameters import *
from pybricks.pupdevices import *
from pybricks.robotics import *
from pybricks.tools import *
from uselect import poll
import uio, uerrno
hub = PrimeHub()
motor, other = Motor(Port.A), Motor(Port.B)
eye = ColorSensor(Port.C)
sonar = UltrasonicSensor(Port.D)
"""
EV3 = """
from pybricks.hubs import EV3Brick
from pybricks.iodevices import *
from pybricks.parameters import *
brick = EV3Brick()
"""


@pytest.mark.parametrize(
    ("expression", "name"),
    [
        ("hub", "PrimeHub"),
        ("hub.light", ""),
        ("hub.buttons", ""),
        ("hub.display", "LightMatrix"),
        ("hub.speaker", "Speaker"),
        ("hub.imu", "IMU"),
        ("motor", "Motor"),
        ("motor.control", "Control"),
        ("motor.log", "Logger"),
        ("motor.model", "MotorModel"),
        ("eye", "ColorSensor"),
        ("eye.lights", ""),
        ("sonar.lights", ""),
        ("DriveBase(motor, other, 56, 112)", "DriveBase"),
        ("StopWatch()", "StopWatch"),
        ("poll()", "poll"),
        ("uio.StringIO()", "StringIO"),
        ("uio.BytesIO()", "BytesIO"),
        ("UARTDevice(Port.E)", "UARTDevice"),
        ("BLERadio()", "BLERadio"),
        ("Remote(connect=False)", "Remote"),
        ("Color.RED", "Color"),
        ("Color", "Color"),
        ("Button", "Button"),
        ("Port.A", "Port"),
        ("Stop.HOLD", "Stop"),
        ("Icon.HEART", "Matrix"),
        ("{}", "dict"),
        ("uerrno.errorcode", "dict"),
        ("set()", "set"),
        ("{}.keys()", "dict_view"),
        ("iter({})", "iterator"),
        ("bytearray()", "bytearray"),
        ("OSError()", "OSError"),
        ("slice", "type"),
    ],
)
def test_classes_of_objects(expression: str, name: str) -> None:
    printed = output(f"{PRIME}print(type({expression}))", body=FittedBench(HubKind.PRIME))
    assert printed == f"<class '{name}'>"


@pytest.mark.parametrize(
    ("expression", "name"),
    [
        ("brick", "EV3Brick"),
        ("brick.light", ""),
        ("brick.buttons", ""),
        ("brick.speaker", "Speaker"),
        ("brick.screen", "Image"),
        ("Image.empty()", "Image"),
        ("Font.DEFAULT", "Font"),
        ("DCMotor(Port.A)", "DCMotor"),
        ("LUMPDevice(Port.A)", "PUPDevice"),
        ("I2CDevice(Port.S1, 1, custom=True)", "I2CDevice"),
    ],
)
def test_classes_of_objects_of_an_ev3(expression: str, name: str) -> None:
    printed = output(f"{EV3}print(type({expression}))", body=FittedBench(HubKind.EV3))
    assert printed == f"<class '{name}'>"


@pytest.mark.parametrize(
    ("expression", "shown"),
    [
        ("hub.light", "<>"),
        ("hub.speaker", "<Speaker>"),
        ("motor.log", "<Logger>"),
        ("motor.control", "<Control>"),
        ("poll()", "<poll>"),
        ("Icon", "<Icon>"),
        ("Button", "Button"),
    ],
)
def test_objects_are_shown_by_their_class(expression: str, shown: str) -> None:
    assert output(f"{PRIME}print({expression})", body=FittedBench(HubKind.PRIME)) == shown


@pytest.mark.parametrize(
    ("call", "says"),
    [
        ("hub.light.nothing", "'' object has no attribute 'nothing'"),
        ("motor.log.nothing", "'Logger' object has no attribute 'nothing'"),
        ("eye.lights.nothing", "'' object has no attribute 'nothing'"),
        ("poll().nothing", "'poll' object has no attribute 'nothing'"),
        ("super(object, 5).nothing", "'super' object has no attribute 'nothing'"),
        ("OSError().nothing", "'OSError' object has no attribute 'nothing'"),
        ("{1: 2}.nothing", "'dict' object has no attribute 'nothing'"),
        ("{1}.nothing", "'set' object has no attribute 'nothing'"),
    ],
)
def test_refusals_name_the_class(call: str, says: str) -> None:
    source = f"{PRIME}try:\n    {call}\nexcept Exception as error:\n    print(error)"
    assert output(source, body=FittedBench(HubKind.PRIME)) == says
