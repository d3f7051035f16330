"""``pybricks.iodevices``: plugged-in devices; no wireless devices."""

from __future__ import annotations

import errno
from types import ModuleType
from typing import Any

from bricksrl.hub.diagnostics.devices import MOTOR_IDS, device_id
from bricksrl.robots import HubKind, PoweredUpSensor, SensorKind, UltrasonicSensor
from bricksrl.virtual_hub.body import FittingBody
from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.micropython.containers import HubDict
from bricksrl.virtual_hub.micropython.numbers import module
from bricksrl.virtual_hub.pybricks.context import Context, RunLoop, bound, charged, os_error
from bricksrl.virtual_hub.pybricks.parameters import Parameters
from bricksrl.virtual_hub.pybricks.wireless import LWP3Device, XboxController, wireless


class PUPDevice:
    """Any device on a port, with its identity; modes are not simulated."""

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
        """Reset to the state after plugging in."""

    def read(self, mode: Any) -> Any:
        raise os_error(errno.EOPNOTSUPP)

    def write(self, mode: Any, data: Any) -> Any:
        raise os_error(errno.EOPNOTSUPP)


def _device_id(machine: Machine, port: str) -> int | None:
    devices = (*machine.robot.motors, *machine.robot.sensors)
    described = next((device_id(device) for device in devices if device.port == port), None)
    if described is not None or not isinstance(machine.body, FittingBody):
        return described
    if port in machine.body.motors:
        return MOTOR_IDS[machine.body.motors[port]]
    plugged = machine.body.device(port)
    if plugged is None:
        return None
    is_ultrasonic = plugged == UltrasonicSensor.__name__
    return device_id(UltrasonicSensor("it", port) if is_ultrasonic else PoweredUpSensor("it", port, SensorKind(plugged)))


class UARTDevice:
    """A UART device on a port: there is none."""

    _loop: RunLoop
    _parameters: Parameters

    def __init__(self, port: Any, *args: Any, **kwargs: Any) -> None:
        self._loop.assert_blocking()
        self._parameters.port_letter(port)
        raise os_error(errno.ENODEV)


def iodevices_module(context: Context, parameters: Parameters) -> ModuleType:
    has_xbox = context.machine.robot.hub is not HubKind.CITY
    names: dict[str, Any] = wireless((LWP3Device, XboxController) if has_xbox else (LWP3Device,), context)
    for kind in (PUPDevice, UARTDevice):
        own: Any = bound(kind, context)
        own._parameters = parameters
        names[kind.__name__] = own
    return module("pybricks.iodevices", names)
