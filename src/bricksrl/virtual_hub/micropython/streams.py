"""``BytesIO`` and ``StringIO`` of a hub: both hold bytes, and accept text and bytes."""

from __future__ import annotations

import io
from typing import Any


def as_bytes(value: Any) -> bytes:
    """Bytes of a buffer or text. Raises TypeError if it is not a buffer."""
    if isinstance(value, str):
        return value.encode()
    if not isinstance(value, bytes | bytearray | memoryview):
        raise TypeError("object with buffer protocol required")
    return bytes(value)


class BytesIO(io.BytesIO):
    """Bytes as a file; an initial number reserves memory."""

    def __init__(self, initial: Any = b"", /) -> None:
        super().__init__(b"" if isinstance(initial, int) else as_bytes(initial))

    def write(self, data: Any, /) -> int:
        return super().write(as_bytes(data))


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
