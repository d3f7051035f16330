"""``pybricks.iodevices``: plugged-in devices. UART: ``pb_type_uart_device.c`` and the hub's driver,
v4."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

from brickhub.robot import SensorKind
from brickhub.virtual import error_numbers
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.containers import HubDict
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.streams import HubBytearray
from brickhub.virtual.own_devices import OwnDevice, OwnI2c, OwnMode, OwnUart
from brickhub.virtual.pybricks.arguments import (
    expect,
    get_array,
    get_exact_int,
    get_int,
    get_text,
    os_error,
)
from brickhub.virtual.pybricks.context import Awaited, Context, Native, bind, classes
from brickhub.virtual.pybricks.device_modes import MODES, reports_angle
from brickhub.virtual.pybricks.plug import DataType, DeviceMode, DeviceModes, Plug
from brickhub.virtual.pybricks.pupdevices import DCMotor
from brickhub.virtual.pybricks.pupsensors import Device
from brickhub.virtual.pybricks.wireless import LWP3Device, XboxController

_BITS_PER_BYTE = 10
"""Bits of a byte with its start and stop bit."""
_WARNING = (
    b"Custom electronics may damage your LEGO hub. Proceed at your own risk.\r\n"
    b"Press Y to proceed. Press N to cancel.\r\n"
)


_OWN_BITS = (8, 16, 32)
_I2C_BITS_PER_S = 9600
"""Clock of the I2C bus of LEGO's sensor ports (hardware developer kit of the NXT)."""
_I2C_BITS_PER_BYTE = 9
"""Eight bits, and one that acknowledges them."""
_MAX_I2C_BYTES = 32
"""Most bytes of a transfer; ASSUMED, those of a message of another device."""
_LAST_REGISTER = 255
_ANY_PLAIN_MOTOR = 93
"""``LEGO_DEVICE_TYPE_ID_ANY_DC_MOTOR``."""
_OPEN_MV = 4972
_OPEN_OHM = 2**30 - 1
"""What the firmware computes for an open end: the largest small integer."""


class PUPDevice(Device):
    """Any device on a port, in its own modes (``pb_type_iodevices_pupdevice.c``, v4)."""

    _own_modes: tuple[OwnMode, ...] = ()

    def _is_plugged_in(self) -> bool:
        own = self._machine.own_devices.get(self._letter)
        if isinstance(own, OwnDevice):
            self._id = own.id
            self._own_modes = own.modes
            self._device_modes = DeviceModes(*map(self._own_mode, own.modes))
            self._modes = self._device_modes.modes
            return True
        model = self._machine.robot.hub.model
        device = _device_id(self._machine, self._letter)
        # A motor's port of a brick looks at nothing, and passes for one with a plain motor.
        if model.sensor_ports and self._letter in model.motor_ports:
            device = _ANY_PLAIN_MOTOR
        # A button of a brick sends nothing by which it would be found.
        elif device == SensorKind.EV3_TOUCH.model.device_id:
            device = None
        self._id = device or 0
        self._device_modes = MODES.get(self._id, DeviceModes())
        self._modes = self._device_modes.modes
        return device is not None

    def _own_mode(self, mode: OwnMode) -> DeviceMode:
        """A mode of a device of the user's own."""

        def read(plug: Plug) -> tuple[int, ...]:
            return mode.values(plug.machine.time_ms / 1000)

        return DeviceMode(
            mode.name,
            mode.count,
            DataType(_OWN_BITS.index(mode.bits)),
            read,
            is_writable=mode.write is not None,
        )

    def info(self) -> dict[str, Any]:
        if not self._modes:
            return HubDict(id=self._id)
        modes = []
        for mode in self._modes:
            modes.append((mode.name, mode.count, int(mode.data_type)))
        return HubDict(id=self._id, modes=tuple(modes))

    def reset(self) -> None:
        """Reset to the state after plugging in."""
        if not self._modes:
            raise os_error(error_numbers.EPERM)
        self._mode.name = self._device_modes.first_mode

    def read(self, mode: Any) -> Any:
        device_mode = self._checked_mode(mode, "Invalid argument")
        self._release_motor(device_mode.name)
        # A run's log needs a column for each value of the mode.
        name = device_mode.name.replace(" ", "_")
        columns = [name]
        if device_mode.count > 1:
            columns = [f"{name}_{index}" for index in range(device_mode.count)]
        return self._measure(device_mode.name, lambda: device_mode.values(self._plug), *columns)

    def write(
        self,
        mode: Any,
        data: Any,
    ) -> Any:
        """Command without a visible effect; values are checked."""
        device_mode = self._checked_mode(mode, "Invalid mode")
        if not device_mode.is_writable:
            raise ValueError("Mode not writable")
        if len(get_array(data)) != device_mode.count:
            raise ValueError(f"Expected {device_mode.count} values")
        bits = device_mode.data_type.bits
        limit = 1 << bits - 1
        for value in data:
            if not -limit <= get_exact_int(value) < limit:
                raise ValueError(f"Value out of range for int{bits}")
        self._release_motor(device_mode.name)
        for own in self._own_modes:
            if own.name == device_mode.name:
                own.take(tuple(data), self._machine.time_ms / 1000)
        return self._write(device_mode.name)

    def _checked_mode(
        self,
        mode: Any,
        refusal: str,
    ) -> DeviceMode:
        """A mode that the program names by its number. Raises OSError (EPERM) for a passive
        device."""
        if not self._modes:
            raise os_error(error_numbers.EPERM)
        # The firmware keeps a mode in a byte, so that 256 is mode 0.
        number = get_exact_int(mode) & 0xFF
        if number >= len(self._modes):
            raise ValueError(refusal)
        return self._modes[number]

    def _release_motor(self, mode: str) -> None:
        """Close a motor that no longer reports its angle, as the firmware does."""
        servo = self._machine.servos.get(self._letter)
        if servo is not None and not reports_angle(servo.kind, mode):
            servo.close()


def _device_id(machine: Machine, port: str) -> int | None:
    """Number of the kind of device on a port; ``None`` if there is none, or it is the user's."""
    if port in machine.own_devices:
        return None
    for device in (*machine.robot.motors, *machine.robot.sensors):
        if device.port == port:
            return device.kind.model.device_id
    # A bench has no description, so its devices are what the program has asked for.
    bench = machine.body
    if not isinstance(bench, FittedBench):
        return None
    if port in bench.motors:
        return bench.motors[port].model.device_id
    sensor = bench.device(port)
    return None if sensor is None else SensorKind(sensor).model.device_id


class UARTDevice(Native):
    """UART on a port; at the other end is a device of the user's own, or nothing.

    An abandoned transfer, such as a read that lost a race, keeps it busy until ``clear()``.
    """

    def __init__(
        self,
        port: Any,
        baudrate: Any = 115200,
        timeout: Any = None,
        power_pin: Any = 0,
    ) -> None:
        self._timeout_ms = None if timeout is None else get_int(timeout)
        expect(self._timeout_ms is None or self._timeout_ms >= 1)
        self._letter = self._context.port_letter(port)
        self.set_baudrate(baudrate)
        self._inbox = bytearray()
        if pin := get_int(power_pin):
            self._ask_for_power(pin)
        self._busy: set[str] = set()
        self._awaits_pattern = False
        self._reads = Awaited(self._context)
        self._writes = Awaited(self._context)

    def _ask_for_power(self, pin: int) -> None:
        """Ask a person for permission to put the battery's voltage on a pin."""
        expect(pin in (1, 2))
        console = self._context.console
        console.write(_WARNING)
        answer = console.read(1)
        if answer not in b"yY":
            console.write(b"Cancelled. Power not enabled.\r\n")
            raise os_error(error_numbers.EOPNOTSUPP)
        console.write(answer + b". Port power may be enabled.\r\n")

    def set_baudrate(self, baudrate: Any) -> None:
        rate = get_int(baudrate)
        expect(rate >= 1)
        self._bits_per_s = rate

    def read(self, length: Any = 1) -> Any:
        count = get_int(length)
        # Where nobody sends anything, only a timeout ends a read of a byte or more.
        transfer = self._transfer("read", lambda _waited_ms: self._arrived() >= count)
        return self._reads.finish(transfer, lambda: self._taken(count), poll_ms=1)

    def read_all(self) -> bytes:
        return self._taken(self._arrived())

    def write(self, data: Any) -> Any:
        content = data.encode() if isinstance(data, str) else data
        expect(type(content) in (bytes, HubBytearray))
        duration_ms = len(content) * _BITS_PER_BYTE * 1000 / self._bits_per_s
        transfer = self._transfer("write", lambda waited_ms: waited_ms >= duration_ms)

        def hand_over() -> None:
            self._arrived(bytes(content))

        return self._writes.finish(transfer, hand_over, poll_ms=1)

    def waiting(self) -> int:
        return self._arrived()

    def wait_until(self, pattern: Any) -> Any:
        if self._awaits_pattern:
            raise os_error(error_numbers.EBUSY)
        expect(get_text(pattern))
        self._awaits_pattern = True
        wanted = pattern.encode() if isinstance(pattern, str) else bytes(pattern)

        def has_come() -> bool:
            self._arrived()
            return wanted in self._inbox

        def take() -> None:
            self._awaits_pattern = False
            self._taken(self._inbox.index(wanted) + len(wanted))

        return self._reads.finish(has_come, take, poll_ms=1)

    def clear(self) -> None:
        self._arrived()
        self._inbox.clear()
        self._busy.clear()

    def _arrived(self, written: bytes = b"") -> int:
        """Number of bytes that wait, after the device has heard what was written."""
        own = self._machine.own_devices.get(self._letter)
        if isinstance(own, OwnUart):
            self._inbox += own.answered(written, self._machine.time_ms / 1000)
        return len(self._inbox)

    def _taken(self, count: int) -> bytes:
        """The first bytes that wait."""
        data = bytes(self._inbox[:count])
        del self._inbox[:count]
        return data

    def _transfer(
        self,
        direction: str,
        is_complete: Callable[[float], bool],
    ) -> Callable[[], bool]:
        """Whether a transfer is done; it begins at the first call. ``is_complete`` is asked with
        the ms that have passed since then. Raises OSError: EBUSY, ETIMEDOUT."""
        start_ms: int | None = None

        def is_done() -> bool:
            nonlocal start_ms
            # An awaitable begins when its task first runs, and not when it is made.
            if start_ms is None:
                if direction in self._busy:
                    raise os_error(error_numbers.EBUSY)
                self._busy.add(direction)
                start_ms = self._machine.time_ms
            waited_ms = self._machine.time_ms - start_ms
            is_late = self._timeout_ms is not None and waited_ms >= self._timeout_ms
            is_whole = is_complete(waited_ms)
            if not is_whole and not is_late:
                return False
            self._busy.discard(direction)
            if not is_whole:
                raise os_error(error_numbers.ETIMEDOUT)
            return True

        return is_done


class AnyMotor(DCMotor):
    """A motor of which nobody asks what it is: a voltage on the port."""

    _is_checked = False


AnyMotor.__name__ = AnyMotor.__qualname__ = "DCMotor"


class AnalogSensor(Native):
    """A voltage on a port, of 0 to 4972 mV; nothing is plugged in, so it is the highest."""

    def __init__(
        self,
        port: Any,
        custom: Any = False,
    ) -> None:
        self._context.assert_blocking()
        letter = self._context.port_letter(port)
        if letter not in self._machine.robot.hub.model.sensor_ports:
            raise os_error(error_numbers.EOPNOTSUPP)
        # Only a port that is free for a circuit of one's own has a voltage without a sensor.
        if not custom:
            raise os_error(error_numbers.ENODEV)

    def voltage(self) -> int:
        return _OPEN_MV

    def resistance(self) -> int:
        return _OPEN_OHM

    def active(self) -> None:
        """Switch the sensor's lamp on."""

    def passive(self) -> None:
        """Switch the sensor's lamp off."""


class I2CDevice(Native):
    """A device on the I2C bus of a sensor port: one of the user's own, or nothing."""

    def __init__(
        self,
        port: Any,
        address: Any,
        custom: Any = False,
        power_pin: Any = 0,
        nxt_quirk: Any = False,
    ) -> None:
        self._context.assert_blocking()
        self._letter = self._context.port_letter(port)
        self._address = get_exact_int(address)
        if self._letter not in self._machine.robot.hub.model.sensor_ports:
            raise os_error(error_numbers.EOPNOTSUPP)
        own = self._machine.own_devices.get(self._letter)
        if not (custom or isinstance(own, OwnI2c)):
            raise os_error(error_numbers.ENODEV)
        self._transfers = Awaited(self._context)

    def read(
        self,
        reg: Any = None,
        length: Any = 1,
    ) -> Any:
        register = self._register(reg)
        count = get_int(length)
        expect(0 <= count <= _MAX_I2C_BYTES)

        def take() -> bytes:
            own = self._answering()
            data = own.bytes_of(register, count, self._machine.time_ms / 1000)
            if data is None:
                raise os_error(error_numbers.EIO)
            return data

        return self._transfer(register, count, take)

    def write(
        self,
        reg: Any = None,
        data: Any = None,
    ) -> Any:
        register = self._register(reg)
        content = b"" if data is None else data
        expect(type(content) in (bytes, HubBytearray))
        written = bytes(content)
        expect(len(written) <= _MAX_I2C_BYTES)

        def give() -> None:
            own = self._answering()
            if not own.take(register, written, self._machine.time_ms / 1000):
                raise os_error(error_numbers.EIO)

        return self._transfer(register, len(written), give)

    def _register(self, reg: Any) -> int | None:
        if reg is None:
            return None
        register = get_int(reg)
        expect(0 <= register <= _LAST_REGISTER)
        return register

    def _answering(self) -> OwnI2c:
        """The device at the address. Raises OSError (EIO) if there is none."""
        own = self._machine.own_devices.get(self._letter)
        if not isinstance(own, OwnI2c) or own.address != self._address:
            raise os_error(error_numbers.EIO)
        return own

    def _transfer(
        self,
        register: int | None,
        count: int,
        end: Callable[[], Any],
    ) -> Any:
        """A transfer of so many bytes, after the address and a register."""
        before = 1 if register is None else 2
        duration_ms = (before + count) * _I2C_BITS_PER_BYTE * 1000 / _I2C_BITS_PER_S
        start_ms: int | None = None

        def is_done() -> bool:
            nonlocal start_ms
            # An awaitable begins when its task first runs, and not when it is made.
            if start_ms is None:
                start_ms = self._machine.time_ms
            return self._machine.time_ms - start_ms >= duration_ms

        return self._transfers.finish(is_done, end, poll_ms=1)


def iodevices_module(context: Context) -> ModuleType:
    names = classes(context, (PUPDevice, UARTDevice, LWP3Device, XboxController))
    if context.machine.robot.hub.model.sensor_ports:
        names |= classes(context, (AnalogSensor, I2CDevice))
        names["DCMotor"] = bind(context, AnyMotor)
        names["LUMPDevice"] = names["PUPDevice"]
    return module("iodevices", names)
