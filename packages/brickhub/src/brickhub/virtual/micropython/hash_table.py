"""Order of dicts and sets on a hub: that of an open hash table.

Source: ``py/map.c``, ``py/qstr.c``, ``py/objtuple.c`` of MicroPython 1.26, with Pybricks' 2-byte string hashes. Values that are
hashed by address there (objects, functions, ``None``) are in insertion order here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from types import FunctionType
from typing import Any

from brickhub.virtual.memory import check_allocation

_SIZES = (
    *(0, 2, 4, 6, 8, 10, 12, 17, 23, 29, 37, 47, 59, 73, 97, 127, 167, 223, 293, 389, 521, 691, 919, 1223, 1627, 2161),
    *(3229, 4831, 7243, 10861, 16273, 24407, 36607, 54907),
)

_SLOT_BYTES = 4
"""Bytes of a set's slot; one of a dict has 8."""


class _Mark:
    """Marks an empty or deleted slot."""


_FREE, _DELETED = _Mark(), _Mark()


def hash_of(value: Any) -> int | None:
    """``hash(value)`` on a hub; ``None`` if it is the address. Raises TypeError if the value is unhashable."""
    kind = type(value)
    if getattr(kind, "hash_is_address", False):
        return None
    if isinstance(kind.__hash__, FunctionType):
        return _small(hash(value))
    if isinstance(value, int):
        return int(value)
    if isinstance(value, str):
        return _text_hash(value.encode("utf-8", "surrogatepass"))
    if isinstance(value, bytes):
        return _text_hash(value)
    if isinstance(value, float):
        return _small(_float_hash(value))
    if isinstance(value, complex):
        return _small(_float_hash(value.real) ^ _float_hash(value.imag))
    hash(value)
    if isinstance(value, range):
        raise TypeError("unhashable type: 'range'")
    if isinstance(value, tuple):
        parts = [hash_of(part) for part in value]
        return None if None in parts else _small(sum(part for part in parts if part is not None))
    return None


def _small(value: int) -> int:
    """The lowest 31 bits, signed."""
    return (value + 0x4000_0000 & 0x7FFF_FFFF) - 0x4000_0000


def _text_hash(data: bytes) -> int:
    value = 5381
    for byte in data:
        value = value * 33 ^ byte
    return value & 0xFFFF or 1


def _float_hash(value: float) -> int:
    """Whole part; saturated to 32 bits, as ARM processors convert."""
    return 0 if math.isnan(value) else int(max(-(2.0**31), min(2.0**31 - 1, value)))


class HashTable:
    """Keys in slots. The owner knows which keys exist, and adds none twice. ``size``: initial number of slots."""

    __slots__ = ("_added", "_hashes", "slots")

    def __init__(self, size: int = 0) -> None:
        check_allocation(_SLOT_BYTES * size)
        self.slots: list[Any] = [_FREE] * size
        self._hashes = [0] * size
        self._added = 0

    def add(self, key: Any) -> None:
        """Add a new key; grows the table if it is full."""
        key_hash = hash_of(key)
        self._put(key, self._added if key_hash is None else key_hash & 0xFFFF_FFFF)
        self._added += 1

    def _put(self, key: Any, hash_: int) -> None:
        slots, size = self.slots, len(self.slots)
        for step in range(size):
            index = (hash_ + step) % size
            if isinstance(slots[index], _Mark):
                slots[index], self._hashes[index] = key, hash_
                return
        self._grow()
        self._put(key, hash_)

    def _grow(self) -> None:
        required = len(self.slots) + 1
        entries = [pair for pair in zip(self.slots, self._hashes, strict=True) if not isinstance(pair[0], _Mark)]
        size = next((size for size in _SIZES if size >= required), required + required // 2 | 1)
        check_allocation(_SLOT_BYTES * size)
        self.slots, self._hashes = [_FREE] * size, [0] * size
        for key, hash_ in entries:
            self._put(key, hash_)

    def remove(self, key: Any) -> None:
        """Remove an existing key."""
        index = next(index for index, other in enumerate(self.slots) if other is key or other == key)
        after = self.slots[(index + 1) % len(self.slots)]
        self.slots[index] = _FREE if after is _FREE else _DELETED

    def first(self) -> Any:
        """The first key. Raises StopIteration if there is none."""
        return next(iter(self))

    def drop_first(self) -> Any:
        """Remove the first key as ``popitem`` does: its slot counts as used until the table grows."""
        key = self.first()
        self.slots[next(index for index, other in enumerate(self.slots) if other is key)] = _DELETED
        return key

    def clear(self) -> None:
        """Remove all keys and slots."""
        self.slots, self._hashes = [], []

    def copy(self) -> HashTable:
        """A copy with the same keys in the same slots."""
        other = HashTable()
        other.slots, other._hashes, other._added = list(self.slots), list(self._hashes), self._added
        return other

    def __iter__(self) -> Iterator[Any]:
        return TableIterator(self)

    @classmethod
    def in_order(cls, keys: Iterable[Any]) -> HashTable:
        """An ordered table, as made by the firmware."""
        table = cls()
        table.slots = list(keys)
        table._hashes = [0] * len(table.slots)
        return table


class TableIterator:
    """Iterates over slots, regardless of changes."""

    __slots__ = ("_next", "_table")

    def __init__(self, table: HashTable) -> None:
        self._table = table
        self._next = 0

    def __iter__(self) -> TableIterator:
        return self

    def __next__(self) -> Any:
        slots = self._table.slots
        while self._next < len(slots):
            key = slots[self._next]
            self._next += 1
            if not isinstance(key, _Mark):
                return key
        raise StopIteration


TableIterator.__name__ = TableIterator.__qualname__ = "iterator"
