"""Devices of one's own on the ports of a virtual hub: Python functions answer what a program asks
by `PUPDevice`, `UARTDevice` and, of an EV3, `I2CDevice`, on the bench and in a body.

A file of yours, such as ``my_device.py``::

    from brickhub.virtual.own_devices import OwnDevice, OwnMode

    GAUGE = OwnDevice(id=200, modes=(OwnMode("LEVEL", lambda time_s: [round(10 * time_s)]),))

is plugged in with ``brickhub run main.py --port A=my_device.py:GAUGE``. A device that measures the
robot is a function instead, which gets the robot::

    def compass(robot):
        return OwnDevice(201, (OwnMode("NORTH", lambda time_s: [round(robot.heading_deg())]),))
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from brickhub.errors import DescriptionError
from brickhub.user_lines import line_of_user
from brickhub.virtual.body import Body

_BITS = (8, 16, 32)
_MAX_VALUES = 32
"""Bytes of a message of a Powered Up device."""
_MAX_MODES = 16
_MAX_NAME = 11
_LAST_ADDRESS = 127
_LAST_ID = 255

Read = Callable[[float], Sequence[int]]
"""Values of a mode at a simulated time in s."""
Write = Callable[[Sequence[int], float], None]
"""Called with the values that a program writes, and the simulated time in s."""
Answer = Callable[[bytes, float], bytes]
"""Called with the bytes that a program has written since the last call, which may be none, and the
simulated time in s; returns the bytes that the device has sent since then."""
ReadRegister = Callable[[int | None, int, float], bytes]
"""Called with a register, or ``None`` for none, the number of bytes that a program reads from there
on, and the simulated time in s; returns these bytes."""
WriteRegister = Callable[[int | None, bytes, float], None]
"""Called with a register, or ``None`` for none, the bytes that a program writes from there on, and
the simulated time in s."""


class AnyOwnDevice:
    """Device of the user's own, of any kind."""


class TrueRobot:
    """A robot as it truly is, for devices that measure it: no noise, no range.

    Args:
        body: of the robot, on the bench or in a world.
    """

    def __init__(self, body: Body) -> None:
        self._body = body

    def angle_deg(self, port: str) -> float:
        """Angle of the shaft of the motor on a port, clockwise positive, before its direction and
        gears. Raises DescriptionError if there is no motor."""
        try:
            return self._body.angle_mdeg(port) / 1000
        except KeyError:
            raise DescriptionError(
                f"port {port} of '{self._body.robot.name}' has no motor whose angle a device of "
                "yours could tell; name another port"
            ) from None

    def x_mm(self) -> float:
        """Place on the floor, along the robot's first direction; 0 on a bench."""
        return self._body.true_place()[0]

    def y_mm(self) -> float:
        """Place on the floor, to the left of it; 0 on a bench."""
        return self._body.true_place()[1]

    def heading_deg(self) -> float:
        """Angle by which the robot has turned, clockwise positive, not wrapped; on a bench, by
        which its wheels have turned it."""
        return self._body.true_place()[2]


OwnDeviceOf = Callable[[TrueRobot], AnyOwnDevice]
"""Function that makes a device for a robot."""

T = TypeVar("T")


def own_device_of(device: AnyOwnDevice | OwnDeviceOf, body: Body) -> AnyOwnDevice:
    """A device, or what a function makes for a robot. Raises DescriptionError if the function
    raises, or makes something else."""
    if isinstance(device, AnyOwnDevice):
        return device
    make = device
    name = getattr(make, "__name__", "a device")
    made = _answered(name, lambda: make(TrueRobot(body)))
    if not isinstance(made, AnyOwnDevice):
        raise DescriptionError(
            f"the function {name} returned {made!r}; return an OwnDevice, OwnUart or OwnI2c"
        )
    return made


def _answered(name: str, ask: Callable[[], T]) -> T:
    """Answer of a function of the user's. Raises DescriptionError, with the line, if it raises."""
    try:
        return ask()
    except DescriptionError:
        raise
    except Exception as error:
        what = f"{type(error).__name__}: {error}{line_of_user(error)}"
        raise DescriptionError(f"the function of {name} failed ({what}); correct it") from error


@dataclass(frozen=True)
class OwnMode:
    """A mode of a Powered Up device. Raises DescriptionError if a value is out of range.

    Attributes:
        name: as `PUPDevice.info()` tells it.
        read: its values.
        count: number of values.
        bits: of each value, which is signed: 8, 16 or 32.
        write: what a program's values do; ``None`` if it cannot be written.
    """

    name: str
    read: Read
    count: int = 1
    bits: int = 32
    write: Write | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.name) <= _MAX_NAME:
            raise DescriptionError(
                f"'{self.name}' names a mode; give it 1 to {_MAX_NAME} characters"
            )
        if self.bits not in _BITS:
            raise DescriptionError(
                f"values of mode {self.name} have {self.bits} bits; give 8, 16 or 32"
            )
        if not 1 <= self.count * self.bits // 8 <= _MAX_VALUES:
            raise DescriptionError(
                f"mode {self.name} has {self.count} values of {self.bits} bits; give at least one, "
                f"and no more than {_MAX_VALUES} bytes"
            )

    def values(self, time_s: float) -> tuple[int, ...]:
        """Values of the mode at a simulated time. Raises DescriptionError if the function raises,
        or they are not as many, or do not fit."""
        values = _answered(f"mode {self.name}", lambda: tuple(self.read(time_s)))
        limit = 1 << (self.bits - 1)
        fits = all(type(value) is int and -limit <= value < limit for value in values)
        if len(values) != self.count or not fits:
            raise DescriptionError(
                f"mode {self.name} returned {values!r}; return {self.count} whole numbers of "
                f"{self.bits} bits"
            )
        return values

    def take(self, values: Sequence[int], time_s: float) -> None:
        """Take what a program writes. Raises DescriptionError if the function raises."""
        if self.write is not None:
            write = self.write
            _answered(f"mode {self.name}", lambda: write(values, time_s))


@dataclass(frozen=True)
class OwnDevice(AnyOwnDevice):
    """A Powered Up device, for `PUPDevice`. Raises DescriptionError without modes, with too many,
    or if the id is out of range.

    Attributes:
        id: number of its kind, 0 to 255, as `PUPDevice.info()` tells it.
        modes: by number.
    """

    id: int
    modes: tuple[OwnMode, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.modes) <= _MAX_MODES:
            raise DescriptionError(
                f"a device of {len(self.modes)} modes; give it 1 to {_MAX_MODES}"
            )
        if type(self.id) is not int or not 0 <= self.id <= _LAST_ID:
            raise DescriptionError(
                f"a device with the id {self.id!r}; give a whole number from 0 to {_LAST_ID}"
            )


@dataclass(frozen=True)
class OwnUart(AnyOwnDevice):
    """What is at the other end of a `UARTDevice`.

    Attributes:
        answer: asked whenever the program reads, writes, or asks what is waiting.
    """

    answer: Answer

    def answered(self, written: bytes, time_s: float) -> bytes:
        """What the device has sent. Raises DescriptionError if the function raises, or returns no
        bytes."""
        sent = _answered("the UART", lambda: self.answer(written, time_s))
        if not isinstance(sent, bytes | bytearray):
            raise DescriptionError(f"the function of the UART returned {sent!r}; return bytes")
        return bytes(sent)


@dataclass(frozen=True)
class OwnI2c(AnyOwnDevice):
    """A device on the I2C bus of an EV3's sensor port, for `I2CDevice`. Raises DescriptionError if
    the address is out of range.

    Attributes:
        address: its address of 7 bits; at others nothing answers.
        read: the bytes that a program reads; ``None`` if it cannot be read.
        write: what a program's bytes do; ``None`` if it cannot be written.
    """

    address: int
    read: ReadRegister | None = None
    write: WriteRegister | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.address <= _LAST_ADDRESS:
            raise DescriptionError(
                f"a device at the I2C address {self.address}; give 0 to {_LAST_ADDRESS}, without "
                "the bit for reading and writing"
            )

    def bytes_of(
        self,
        register: int | None,
        length: int,
        time_s: float,
    ) -> bytes | None:
        """Bytes that a program reads; ``None`` if the device does not answer. Raises
        DescriptionError if the function raises, or returns something else."""
        if self.read is None:
            return None
        read = self.read
        name = f"the I2C device at {self.address}"
        data = _answered(name, lambda: read(register, length, time_s))
        if not isinstance(data, bytes | bytearray) or len(data) != length:
            raise DescriptionError(
                f"the function of {name} returned {data!r}; return {length} bytes"
            )
        return bytes(data)

    def take(
        self,
        register: int | None,
        data: bytes,
        time_s: float,
    ) -> bool:
        """Whether the device takes what a program writes. Raises DescriptionError if the function
        raises."""
        if self.write is None:
            return False
        write = self.write
        name = f"the I2C device at {self.address}"
        _answered(name, lambda: write(register, data, time_s))
        return True
