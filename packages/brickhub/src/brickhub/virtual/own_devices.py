"""Devices of one's own on the ports of a virtual hub: Python functions answer what a program asks
by `PUPDevice` and `UARTDevice`, on the bench and in a body.

A file of yours, such as ``my_device.py``::

    from brickhub.virtual.own_devices import OwnDevice, OwnMode

    GAUGE = OwnDevice(id=200, modes=(OwnMode("LEVEL", lambda time_s: [round(10 * time_s)]),))

is plugged in with ``brickhub run main.py --port A=my_device.py:GAUGE``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from brickhub.errors import DescriptionError

_BITS = (8, 16, 32)
_MAX_VALUES = 32
"""Bytes of a message of a Powered Up device."""
_MAX_MODES = 16
_MAX_NAME = 11

Read = Callable[[float], Sequence[int]]
"""Values of a mode at a simulated time in s."""
Write = Callable[[Sequence[int], float], None]
"""Called with the values that a program writes, and the simulated time in s."""
Answer = Callable[[bytes, float], bytes]
"""Called with the bytes that a program has written since the last call, which may be none, and the
simulated time in s; returns the bytes that the device has sent since then."""


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
        try:
            values = tuple(self.read(time_s))
        except Exception as error:
            raise DescriptionError(
                f"the function of mode {self.name} failed ({type(error).__name__}: {error}); "
                "correct it"
            ) from error
        limit = 1 << (self.bits - 1)
        fits = all(type(value) is int and -limit <= value < limit for value in values)
        if len(values) != self.count or not fits:
            raise DescriptionError(
                f"mode {self.name} returned {values!r}; return {self.count} whole numbers of "
                f"{self.bits} bits"
            )
        return values


@dataclass(frozen=True)
class OwnDevice:
    """A Powered Up device, for `PUPDevice`. Raises DescriptionError without modes, or with too
    many.

    Attributes:
        id: number of its kind, as `PUPDevice.info()` tells it.
        modes: by number.
    """

    id: int
    modes: tuple[OwnMode, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.modes) <= _MAX_MODES:
            raise DescriptionError(
                f"a device of {len(self.modes)} modes; give it 1 to {_MAX_MODES}"
            )


@dataclass(frozen=True)
class OwnUart:
    """What is at the other end of a `UARTDevice`.

    Attributes:
        answer: asked whenever the program reads, writes, or asks what is waiting.
    """

    answer: Answer


AnyOwnDevice = OwnDevice | OwnUart
