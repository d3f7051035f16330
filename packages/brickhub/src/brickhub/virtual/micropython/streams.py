"""``BytesIO`` and ``StringIO`` of a hub: both hold bytes, and accept text and bytes."""

from __future__ import annotations

import errno
import io
from typing import Any

from brickhub.virtual.micropython.byte_array import HubBytearray
from brickhub.virtual.micropython.exceptions import HubOSError


def as_bytes(value: Any) -> bytes:
    """Bytes of a buffer or text. Raises TypeError if it is not a buffer."""
    if isinstance(value, str):
        return value.encode()
    if not isinstance(value, bytes | bytearray | memoryview):
        raise TypeError("object with buffer protocol required")
    return bytes(value)


def part_of(data: Any, *part: int) -> bytes:
    """Bytes of a buffer or text: all, the first ``(count,)`` or, after a start, ``(start, count)``."""
    content = as_bytes(data)
    start, count = part if len(part) > 1 else (0, *(part or (-1,)))
    return content[start:] if count < 0 else content[start : start + count]


class Stream:
    """What ``print`` can write to."""


class IOBase:
    """A stream of a program, which has ``write``."""


def write_text(stream: Any, piece: str) -> None:
    """Write to a stream, as ``print`` does. Raises HubOSError if it is none."""
    if isinstance(stream, Stream):
        stream.write(piece)  # type: ignore[attr-defined]  # those that lack it have no file number 1
    elif not isinstance(stream, IOBase):
        raise HubOSError("stream operation not supported")
    elif piece:
        stream.write(HubBytearray(piece.encode()))  # type: ignore[attr-defined]  # a program's method


class BytesIO(Stream, io.BytesIO):
    """Bytes as a file; an initial number reserves memory."""

    def __init__(self, initial: Any = b"", /) -> None:
        super().__init__(b"" if isinstance(initial, int) else as_bytes(initial))

    def __repr__(self) -> str:
        return f"<io.{type(self).__name__} 0x{id(self) & 0xFFFFFFFF:x}>"

    def write(self, data: Any, /, *part: int) -> int:
        return super().write(part_of(data, *part))

    def readinto(self, buffer: Any, /, size: int = -1) -> int:
        return super().readinto(memoryview(buffer)[:size] if size >= 0 else buffer)

    def seek(self, offset: int, whence: int = 0, /) -> int:
        try:
            return super().seek(offset, whence)
        except ValueError:
            raise HubOSError(errno.EINVAL) from None


class StringIO(BytesIO):
    """Text as a file."""

    def read(self, size: Any = -1, /) -> Any:
        return super().read(size).decode()

    def readline(self, size: Any = -1, /) -> Any:
        return super().readline(size).decode()

    def getvalue(self) -> Any:
        return super().getvalue().decode()

    def __next__(self) -> Any:
        if line := self.readline():
            return line
        raise StopIteration
