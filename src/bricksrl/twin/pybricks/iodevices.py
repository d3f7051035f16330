"""``pybricks.iodevices``: what is plugged in presents itself; nothing wireless is near."""

from __future__ import annotations

import errno
from types import ModuleType
from typing import Any

from bricksrl.hub.devices import MOTOR_IDS, ULTRASONIC_ID, device_id
from bricksrl.robots import PoweredUpSensor
from bricksrl.twin.machine import Machine
from bricksrl.twin.micropython.containers import HubDict
from bricksrl.twin.micropython.numbers import module
from bricksrl.twin.pybricks.context import Context, RunLoop, bound, charged, os_error
from bricksrl.twin.pybricks.parameters import Parameters
from bricksrl.twin.pybricks.wireless import LWP3Device, XboxController, wireless


class PUPDevice:
    """Any device on a port: it says what it is. Its modes are not simulated."""

    _loop: RunLoop
    _machine: Machine
    _parameters: Parameters

    def __init__(self, port: Any) -> None:
        self._loop.assert_blocking()
        found = _device_id(self._machine, self._parameters.port_letter(port))
        if found is None:
            raise os_error(errno.ENODEV)
        self._id = found

    @charged
    def info(self) -> dict[str, Any]:
        return HubDict(id=self._id)

    @charged
    def reset(self) -> None:
        """As if it had just been plugged in."""

    def read(self, mode: Any) -> Any:
        raise os_error(errno.EOPNOTSUPP)

    def write(self, mode: Any, data: Any) -> Any:
        raise os_error(errno.EOPNOTSUPP)


def _device_id(machine: Machine, port: str) -> int | None:
    body = machine.body
    if port in body.motors:
        return MOTOR_IDS[body.motors[port]]
    if port in body.distance_sensors:
        return ULTRASONIC_ID
    described = (sensor for sensor in machine.robot.sensors if isinstance(sensor, PoweredUpSensor))
    return next((device_id(sensor) for sensor in described if sensor.port == port), None)


class UARTDevice:
    """A device of one's own on a port: there is none."""

    _loop: RunLoop
    _parameters: Parameters

    def __init__(self, port: Any, *args: Any, **kwargs: Any) -> None:
        self._loop.assert_blocking()
        self._parameters.port_letter(port)
        raise os_error(errno.ENODEV)


def iodevices_module(context: Context, parameters: Parameters) -> ModuleType:
    names: dict[str, Any] = wireless((LWP3Device, XboxController), context)
    for kind in (PUPDevice, UARTDevice):
        own: Any = bound(kind, context)
        own._parameters = parameters
        names[kind.__name__] = own
    return module("pybricks.iodevices", names)
