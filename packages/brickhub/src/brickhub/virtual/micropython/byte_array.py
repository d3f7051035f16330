"""``bytearray``, which keeps the last eight bits of numbers (``py/objarray.c`` and ``py/binary.c`` of MicroPython 1.26)."""

from __future__ import annotations

import operator
from typing import Any

from brickhub.virtual.memory import check_allocation, items_of


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

    def __init__(self, source: Any = b"", *encoding: Any) -> None:
        if isinstance(source, int):
            check_allocation(source)
        super().__init__(_low_bytes(source), *encoding)

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(index, value if isinstance(index, slice) else operator.index(value) & 0xFF)

    def __getitem__(self, index: Any) -> Any:
        item = super().__getitem__(index)
        return HubBytearray(item) if isinstance(index, slice) else item

    def __delitem__(self, index: Any) -> None:
        raise TypeError("'bytearray' object doesn't support item deletion")

    def __contains__(self, item: Any) -> bool:
        if isinstance(item, int | float):
            raise NotImplementedError
        return isinstance(item, str | bytes | bytearray | memoryview) and super().__contains__(_buffer(item))

    def __mul__(self, other: Any) -> Any:
        return NotImplemented

    __rmul__ = __imul__ = __mul__

    def __add__(self, other: Any) -> HubBytearray:
        return HubBytearray(super().__add__(_buffer(other)))

    def __iadd__(self, other: Any) -> HubBytearray:
        self.extend(other)
        return self

    def append(self, value: Any, /) -> None:
        super().append(operator.index(value) & 0xFF)

    def extend(self, values: Any, /) -> None:
        super().extend(_low_bytes(_buffer(values)))


HubBytearray.__name__ = HubBytearray.__qualname__ = "bytearray"
