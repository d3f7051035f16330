"""``pybricks.iodevices``: plugged-in devices; no wireless devices. UART: ``pb_type_uart_device.c`` and the hub's driver, v4."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

from bricksrl.hub.diagnostics.devices import MOTOR_IDS, device_id
from bricksrl.robots import HubKind, PoweredUpSensor, SensorKind, UltrasonicSensor
from bricksrl.virtual_hub.body import FittingBody
from bricksrl.virtual_hub.console import Console
from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.micropython.containers import HubDict
from bricksrl.virtual_hub.micropython.numbers import module
from bricksrl.virtual_hub.pybricks.context import Context, Latest, RunLoop, bound, charged, get_int, get_text, os_error
from bricksrl.virtual_hub.pybricks.parameters import Parameters
from bricksrl.virtual_hub.pybricks.wireless import LWP3Device, XboxController, wireless

_BITS_PER_BYTE = 10  # with start and stop bit
_WARNING = b"Custom electronics may damage your LEGO hub. Proceed at your own risk.\r\nPress Y to proceed. Press N to cancel.\r\n"


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
    """UART on a port, with nothing at the other end.

    What is given up, such as a read that lost a race, keeps it busy until ``clear()``.
    """

    _context: Context
    _loop: RunLoop
    _parameters: Parameters

    def __init__(self, port: Any, baudrate: Any = 115200, timeout: Any = None, power_pin: Any = 0) -> None:
        self._machine = self._context.machine
        self._timeout_ms = None if timeout is None else get_int(timeout)
        if self._timeout_ms is not None and self._timeout_ms < 1:
            raise ValueError("Invalid argument")
        self._parameters.port_letter(port)
        self.set_baudrate(baudrate)
        _ask_for_power(get_int(power_pin), self._context.console)
        self._busy: set[str] = set()
        self._awaits_pattern = False
        self._reads, self._writes = Latest(self._loop), Latest(self._loop)

    @charged
    def set_baudrate(self, baudrate: Any) -> None:
        rate = get_int(baudrate)
        if rate < 1:
            raise ValueError("Invalid argument")
        self._bits_per_s = rate

    @charged
    def read(self, length: Any = 1) -> Any:
        takes_ms = math.inf if get_int(length) > 0 else 0.0
        return self._reads.finish(self._transfer("read", takes_ms), lambda: b"", grain_ms=1)

    @charged
    def read_all(self) -> bytes:
        return b""

    @charged
    def write(self, data: Any) -> Any:
        content = data.encode() if isinstance(data, str) else data
        if type(content) not in (bytes, bytearray):
            raise ValueError("Invalid argument")
        takes_ms = len(content) * _BITS_PER_BYTE * 1000 / self._bits_per_s
        return self._writes.finish(self._transfer("write", takes_ms), grain_ms=1)

    @charged
    def waiting(self) -> int:
        return 0

    @charged
    def wait_until(self, pattern: Any) -> Any:
        if self._awaits_pattern:
            raise os_error(errno.EBUSY)
        if not get_text(pattern):
            raise ValueError("Invalid argument")
        self._awaits_pattern = True
        return self._reads.finish(lambda: False, grain_ms=1)

    @charged
    def clear(self) -> None:
        self._busy.clear()

    def _transfer(self, way: str, takes_ms: float) -> Callable[[], bool]:
        """Whether a transfer is done, which begins when this is first asked. Raises OSError: EBUSY, ETIMEDOUT."""
        start_ms: int | None = None

        def is_done() -> bool:
            nonlocal start_ms
            if start_ms is None:
                if way in self._busy:
                    raise os_error(errno.EBUSY)
                self._busy.add(way)
                start_ms = self._machine.time_ms
            waited_ms = self._machine.time_ms - start_ms
            is_late = self._timeout_ms is not None and waited_ms >= self._timeout_ms
            if waited_ms < takes_ms and not is_late:
                return False
            self._busy.discard(way)
            if is_late:
                raise os_error(errno.ETIMEDOUT)
            return True

        return is_done


def _ask_for_power(pin: int, console: Console) -> None:
    """Ask a person for permission to put the battery's voltage on a pin, unless it is none (0)."""
    if not pin:
        return
    if pin not in (1, 2):
        raise ValueError("Invalid argument")
    console.write(_WARNING)
    answer = console.read(1)
    if answer not in b"yY":
        console.write(b"Cancelled. Power not enabled.\r\n")
        raise os_error(errno.EOPNOTSUPP)
    console.write(answer + b". Port power may be enabled.\r\n")


def iodevices_module(context: Context, parameters: Parameters) -> ModuleType:
    has_xbox = context.machine.robot.hub is not HubKind.CITY
    names: dict[str, Any] = wireless((LWP3Device, XboxController) if has_xbox else (LWP3Device,), context)
    for kind in (PUPDevice, UARTDevice):
        own: Any = bound(kind, context)
        own._parameters = parameters
        names[kind.__name__] = own
    return module("pybricks.iodevices", names)
