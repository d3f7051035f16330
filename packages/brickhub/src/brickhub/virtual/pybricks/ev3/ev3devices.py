"""``pybricks.ev3devices`` and ``pybricks.nxtdevices``."""

from types import ModuleType
from typing import Any

from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.pybricks.arguments import os_error
from brickhub.virtual.pybricks.context import Context, Native, bind, classes
from brickhub.virtual.pybricks.ev3.ev3sensors import EV3_SENSORS
from brickhub.virtual.pybricks.pupdevices import Motor

_NXT_SENSORS = (
    "TouchSensor",
    "LightSensor",
    "ColorSensor",
    "UltrasonicSensor",
    "TemperatureSensor",
    "SoundSensor",
    "EnergyMeter",
    "VernierAdapter",
)


class NxtSensor(Native):
    """A sensor of NXT, of which none is ever plugged in."""

    def __init__(self, port: Any, *_: Any) -> None:
        self._context.port_letter(port)
        raise os_error(error_numbers.ENODEV)


def ev3devices_modules(context: Context) -> list[ModuleType]:
    """The modules of an EV3's motors and sensors; the first one is ``pupdevices`` there, too."""
    motor = bind(context, Motor)
    names: dict[str, Any] = {"Motor": motor}
    names |= classes(context, EV3_SENSORS)
    # A program that was written for a force sensor finds a touch sensor.
    names["ForceSensor"] = names["TouchSensor"]
    nxt: dict[str, Any] = {"Motor": motor}
    for name in _NXT_SENSORS:
        nxt[name] = bind(context, type(name, (NxtSensor,), {"__module__": __name__}))
    return [module("ev3devices", names), module("nxtdevices", nxt)]
