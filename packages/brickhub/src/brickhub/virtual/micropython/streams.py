"""Bytes and streams of a hub: ``bytearray``, which keeps the last eight bits of numbers, and
``BytesIO`` and ``StringIO``.

Both hold bytes, and accept text and bytes. Source: ``py/objarray.c`` and ``py/binary.c`` of
MicroPython 1.26.
"""

import io
import operator
from typing import Any, Protocol

from brickhub.virtual import error_numbers
from brickhub.virtual.micropython.exceptions import HubOSError
from brickhub.virtual.micropython.memory import check_allocation, items_of


def _low_bytes(values: Any) -> Any:
    """Numbers as bytes; a size and a buffer, unchanged."""
    if isinstance(values, int | str | bytes | bytearray | memoryview):
        return values
    return bytes(operator.index(value) & 0xFF for value in items_of(values, item_bytes=1))


def _buffer(value: Any) -> Any:
    return value.encode() if isinstance(value, str) else value


class HubBytearray(bytearray):
    """A bytearray of any integers, modulo 256. Text is added as UTF-8."""

    __slots__ = ()

    def __init__(
        self,
        source: Any = b"",
        *encoding: Any,
    ) -> None:
        if isinstance(source, bool):
            raise TypeError("'bool' object isn't iterable")
        if isinstance(source, int):
            # Without a sign, a negative size is a large one.
            check_allocation(source & 0xFFFFFFFF)
        super().__init__(_low_bytes(source), *encoding)

    def __setitem__(
        self,
        index: Any,
        value: Any,
    ) -> None:
        if not isinstance(index, slice):
            value = operator.index(value) & 0xFF
        super().__setitem__(index, value)

    def __getitem__(self, index: Any) -> Any:
        item = super().__getitem__(index)
        return HubBytearray(item) if isinstance(index, slice) else item

    def __delitem__(self, index: Any) -> None:
        raise TypeError("'bytearray' object doesn't support item deletion")

    def __contains__(self, item: Any) -> bool:
        # A hub searches for data only, and not for a single number (`py/objarray.c`).
        if isinstance(item, int | float):
            raise NotImplementedError
        is_data = isinstance(item, str | bytes | bytearray | memoryview)
        return is_data and super().__contains__(_buffer(item))

    # A hub's bytearray cannot be repeated.
    def __mul__(self, other: Any) -> Any:
        return NotImplemented

    __rmul__ = __imul__ = __mul__

    def __add__(self, other: Any) -> "HubBytearray":
        return HubBytearray(super().__add__(_buffer(other)))

    def __iadd__(self, other: Any) -> "HubBytearray":
        self.extend(other)
        return self

    def append(self, value: Any, /) -> None:
        super().append(operator.index(value) & 0xFF)

    def extend(self, values: Any, /) -> None:
        super().extend(_low_bytes(_buffer(values)))


HubBytearray.__name__ = HubBytearray.__qualname__ = "bytearray"


class Console(Protocol):
    """Byte streams between a program and its host. ``print`` writes ``\\r\\n`` for ``\\n``.
    ``inbox``: AppData of the host, of a size that the program sets."""

    inbox: bytearray

    def available(self) -> int:
        """Number of bytes that can be read without waiting."""

    def read(self, n: int) -> bytes:
        """Exactly ``n`` bytes; simulated time advances in steps of 1 ms until they are there."""

    def write(self, data: bytes) -> None:
        """Send bytes unchanged."""

    def write_app_data(self, data: bytes) -> None:
        """Send bytes of AppData."""


def as_bytes(value: Any) -> bytes:
    """Bytes of a buffer or text. Raises TypeError if it is not a buffer."""
    if isinstance(value, str):
        return value.encode()
    if not isinstance(value, bytes | bytearray | memoryview):
        raise TypeError("object with buffer protocol required")
    return bytes(value)


def part_of(data: Any, *part: int) -> bytes:
    """Bytes of a buffer or text: all, the first ``(count,)`` or, after a start, ``(start,
    count)``."""
    content = as_bytes(data)
    if not part:
        return content
    start, count = part if len(part) > 1 else (0, *part)
    # A negative count means no limit.
    return content[start:] if count < 0 else content[start : start + count]


class Stream:
    """A stream to which ``print`` can write."""


class IOBase:
    """A stream of a program, which has ``write``."""


def write_text(stream: Any, piece: str) -> None:
    """Write to a stream, as ``print`` does. Raises HubOSError if it is none."""
    if isinstance(stream, Stream):
        # An object without the method has no file number 1 either, and raises here.
        stream.write(piece)  # type: ignore[attr-defined]
    elif not isinstance(stream, IOBase):
        raise HubOSError("stream operation not supported")
    elif piece:
        # This is a method of the program, so it gets a bytearray as on a hub.
        stream.write(HubBytearray(piece.encode()))  # type: ignore[attr-defined]


class BytesIO(Stream, io.BytesIO):
    """Bytes as a file; an initial number reserves memory."""

    def __init__(self, initial: Any = b"", /) -> None:
        content = b"" if isinstance(initial, int) else as_bytes(initial)
        super().__init__(content)

    def __repr__(self) -> str:
        return f"<io.{type(self).__name__} 0x{id(self) & 0xFFFFFFFF:x}>"

    def write(
        self,
        data: Any,
        /,
        *part: int,
    ) -> int:
        return super().write(part_of(data, *part))

    def readinto(
        self,
        buffer: Any,
        /,
        size: int = -1,
    ) -> int:
        if size >= 0:
            buffer = memoryview(buffer)[:size]
        return super().readinto(buffer)

    def seek(
        self,
        offset: int,
        whence: int = 0,
        /,
    ) -> int:
        try:
            return super().seek(offset, whence)
        except ValueError:
            raise HubOSError(error_numbers.EINVAL) from None


class StringIO(BytesIO):
    """Text as a file."""

    def read(self, size: Any = -1, /) -> Any:
        return super().read(size).decode()

    def readline(self, size: Any = -1, /) -> Any:
        return super().readline(size).decode()

    def getvalue(self) -> Any:
        return super().getvalue().decode()

    def __next__(self) -> Any:
        line = self.readline()
        if not line:
            raise StopIteration
        return line
