"""Dicts and sets in the order of a hub's open hash tables.

Source: ``py/map.c``, ``py/qstr.c``, ``py/obj{dict,set,tuple}.c`` of MicroPython 1.26, with
Pybricks' 2-byte string hashes. Values that are hashed by address there (objects, functions,
``None``) are in insertion order here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from types import FunctionType
from typing import Any, Self

from brickhub.virtual.micropython.memory import check_allocation

# fmt: off
_SIZES = (
    0, 2, 4, 6, 8, 10, 12,
    17, 23, 29, 37, 47, 59, 73, 97, 127, 167, 223, 293, 389, 521, 691, 919, 1223, 1627, 2161,
    3229, 4831, 7243, 10861, 16273, 24407, 36607, 54907,
)
# fmt: on
"""Numbers of slots to which a table grows (``hash_allocation_sizes`` in ``py/map.c``): even ones,
then primes that grow by a quarter, a third, and a half."""
_SLOT_BYTES = 4
"""Bytes of a set's slot; one of a dict has 8."""
_MISSING = object()


class _Mark:
    """Marks an empty or deleted slot."""


_FREE = _Mark()
_DELETED = _Mark()


def hash_of(value: Any) -> int | None:
    """``hash(value)`` on a hub; ``None`` if it is the address. Raises TypeError if the value is
    unhashable."""
    kind = type(value)
    if getattr(kind, "hash_is_address", False):
        return None
    # A function here is a method `__hash__` of the program.
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
    # `hash` refuses lists, dicts and so on, as on a hub.
    hash(value)
    if isinstance(value, range | memoryview):
        raise TypeError(f"unhashable type: '{type(value).__name__}'")
    if isinstance(value, tuple):
        total = 0
        is_address = False
        # All items are hashed, because a later one may be unhashable.
        for part in value:
            part_hash = hash_of(part)
            if part_hash is None:
                is_address = True
            else:
                total += part_hash
        return None if is_address else _small(total)
    return None


def _small(value: int) -> int:
    """The lowest 31 bits, signed."""
    return (value + 0x4000_0000 & 0x7FFF_FFFF) - 0x4000_0000


def _text_hash(data: bytes) -> int:
    # This is djb2, of which a hub keeps two bytes; 0 would mean that there is no hash yet
    # (`py/qstr.c`).
    value = 5381
    for byte in data:
        value = value * 33 ^ byte
    return value & 0xFFFF or 1


def _float_hash(value: float) -> int:
    """Hash of a float: its whole part, saturated to 32 bits, as ARM processors convert."""
    if math.isnan(value):
        return 0
    return int(max(-(2.0**31), min(2.0**31 - 1, value)))


class HashTable:
    """Keys in slots. The owner knows which keys exist, and adds none twice. ``size``: initial
    number of slots."""

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

    def _put(
        self,
        key: Any,
        hash_: int,
    ) -> None:
        slots = self.slots
        size = len(slots)
        # With open addressing, a key takes the first free slot from that of its hash on.
        for step in range(size):
            index = (hash_ + step) % size
            if isinstance(slots[index], _Mark):
                slots[index] = key
                self._hashes[index] = hash_
                return
        # The table is full, so all keys move into a larger one, in the order of their slots.
        entries = [
            (other, other_hash)
            for other, other_hash in zip(slots, self._hashes, strict=True)
            if not isinstance(other, _Mark)
        ]
        size = _greater_size(size)
        check_allocation(_SLOT_BYTES * size)
        self.slots = [_FREE] * size
        self._hashes = [0] * size
        for other, other_hash in entries:
            self._put(other, other_hash)
        self._put(key, hash_)

    def remove(self, key: Any) -> None:
        """Remove an existing key."""
        index = self._index_of(key)
        # No search passes a slot whose next one is free, so that slot may be free itself.
        after = self.slots[(index + 1) % len(self.slots)]
        self.slots[index] = _FREE if after is _FREE else _DELETED

    def _index_of(self, key: Any) -> int:
        for index, other in enumerate(self.slots):
            # Identity is tested first, because some keys do not equal themselves, such as NaN.
            if other is key or other == key:
                return index
        raise KeyError(key)

    def drop_first(self) -> Any:
        """Remove the first key as ``popitem`` does: its slot counts as used until the table
        grows."""
        for index, key in enumerate(self.slots):
            if not isinstance(key, _Mark):
                self.slots[index] = _DELETED
                return key
        raise KeyError

    def clear(self) -> None:
        """Remove all keys and slots."""
        self.slots = []
        self._hashes = []

    def copy(self) -> HashTable:
        """A copy with the same keys in the same slots."""
        other = HashTable()
        other.slots = list(self.slots)
        other._hashes = list(self._hashes)
        other._added = self._added
        return other

    def __iter__(self) -> Iterator[Any]:
        return TableIterator(self)


def _greater_size(size: int) -> int:
    required = size + 1
    for known in _SIZES:
        if known >= required:
            return known
    return required + required // 2 | 1


class TableIterator:
    """Iterates over slots, regardless of changes; gives keys, or what a function makes of them."""

    __slots__ = ("_function", "_next", "_table")

    def __init__(
        self,
        table: HashTable,
        function: Callable[[Any], Any] | None = None,
    ) -> None:
        self._table = table
        self._function = function
        self._next = 0

    def __iter__(self) -> TableIterator:
        return self

    def __next__(self) -> Any:
        slots = self._table.slots
        while self._next < len(slots):
            key = slots[self._next]
            self._next += 1
            if not isinstance(key, _Mark):
                return key if self._function is None else self._function(key)
        raise StopIteration


class _Slotted:
    """A container ordered by the slots of a table."""

    __slots__ = ()
    _table: HashTable

    def __new__(
        cls,
        *args: Any,
        **kwargs: Any,
    ) -> Any:
        # The table is made here, because a program's subclass need not call `__init__`.
        result: Any = super().__new__(cls)
        result._table = HashTable()
        return result

    @classmethod
    def sized(
        cls,
        size: int,
        values: Iterable[Any],
    ) -> Self:
        """Make a dict or set with an initial number of slots."""
        result: Any = cls()
        result._table = HashTable(size)
        result.update(values)
        return result  # type: ignore[no-any-return]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._table)

    def clear(self) -> None:
        super().clear()  # type: ignore[misc]  # of the dict or set
        self._table.clear()


class HubDict(_Slotted, dict[Any, Any]):
    """A dict ordered by slots."""

    __slots__ = ("_table",)

    def __init__(
        self,
        *args: Any,
        **kwargs: Any,
    ) -> None:
        self.update(*args, **kwargs)

    def __setitem__(
        self,
        key: Any,
        value: Any,
        /,
    ) -> None:
        if key not in self:
            self._table.add(key)
        super().__setitem__(key, value)

    def __delitem__(self, key: Any, /) -> None:
        super().__delitem__(key)
        self._table.remove(key)

    # CPython's dict has this method, but a hub's does not.
    def __reversed__(self) -> Any:
        raise TypeError("'dict' object is not reversible")

    def keys(self) -> Any:
        return DictView(self, "keys")

    def values(self) -> Any:
        return DictView(self, "values")

    def items(self) -> Any:
        return DictView(self, "items")

    def copy(self) -> HubDict:
        result = HubDict()
        # The methods of `dict` itself are used, because a program's subclass may override its own.
        pairs = [(key, dict.__getitem__(self, key)) for key in self._table]
        dict.update(result, pairs)
        result._table = self._table.copy()
        return result

    @classmethod
    def fromkeys(
        cls,
        keys: Iterable[Any],
        value: Any = None,
        /,
    ) -> HubDict:
        size = len(keys) if isinstance(keys, Sized) else 0
        return HubDict.sized(size, ((key, value) for key in keys))

    def pop(
        self,
        key: Any,
        default: Any = _MISSING,
        /,
    ) -> Any:
        if key not in self:
            return super().pop(key) if default is _MISSING else default
        self._table.remove(key)
        return super().pop(key)

    def popitem(self) -> tuple[Any, Any]:
        if not self:
            raise KeyError("popitem(): dictionary is empty")
        key = self._table.drop_first()
        return key, super().pop(key)

    def setdefault(
        self,
        key: Any,
        default: Any = None,
        /,
    ) -> Any:
        if key not in self:
            self[key] = default
        return self[key]

    def update(
        self,
        other: Any = (),
        /,
        **named: Any,
    ) -> None:
        # A hub takes only a dict itself for one. What a subclass iterates over is taken for pairs.
        pairs = other.items() if type(other) in (HubDict, FixedDict) else other
        for entry in itertools.chain(pairs, named.items()):
            pair = list(entry)
            if len(pair) != 2:
                raise ValueError("dict update sequence has wrong length")
            self[pair[0]] = pair[1]


class FixedDict(HubDict):
    """A dict of the firmware, in the order of its table, which no program changes
    (`mp_ensure_not_fixed` in ``py/objdict.c``)."""

    __slots__ = ()

    @classmethod
    def of(cls, values: Mapping[Any, Any]) -> FixedDict:
        """A fixed dict with these values."""
        result: FixedDict = cls()
        dict.update(result, values)
        # The slots are filled in the order of the firmware's table, whatever the hashes.
        result._table.slots = list(values)
        result._table._hashes = [0] * len(values)
        return result

    def __init__(self) -> None:
        """An empty dict is not filled by an update."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise TypeError

    __setitem__ = __delitem__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


class DictView:
    """Result of ``keys()``, ``values()`` and ``items()``; no set, no length."""

    __slots__ = ("kind", "owner")

    def __init__(
        self,
        owner: HubDict,
        kind: str,
    ) -> None:
        self.owner = owner
        self.kind = kind

    def __iter__(self) -> Iterator[Any]:
        owner = self.owner
        if self.kind == "keys":
            return iter(owner)
        if self.kind == "values":
            return TableIterator(owner._table, lambda key: dict.__getitem__(owner, key))
        return TableIterator(owner._table, lambda key: (key, dict.__getitem__(owner, key)))

    def __hash__(self) -> int:
        # A hub gives only the address of `values()` (`py/objdict.c`).
        if self.kind != "values":
            raise TypeError("unhashable type: 'dict_view'")
        return id(self)

    def __contains__(self, value: Any) -> bool:
        if self.kind == "keys":
            return value in self.owner
        return any(value == other for other in self)


def _operator(method: str) -> Any:
    """An operator of sets that does what a method does, in place if that returns nothing."""

    def operate(self: HubSet, other: Any) -> Any:
        if not isinstance(other, set):
            return NotImplemented
        result = getattr(self, method)(other)
        return self if result is None else result

    return operate


class HubSet(_Slotted, set[Any]):
    """A set ordered by slots."""

    __slots__ = ("_table",)

    def __init__(self, *values: Iterable[Any]) -> None:
        if len(values) > 1:
            raise TypeError(f"function expected at most 1 arguments, got {len(values)}")
        self.update(*values)

    def add(self, value: Any, /) -> None:
        if value not in self:
            self._table.add(value)
            super().add(value)

    def discard(self, value: Any, /) -> None:
        if value in self:
            self._table.remove(value)
            super().discard(value)

    def remove(self, value: Any, /) -> None:
        if value not in self:
            raise KeyError(value)
        self.discard(value)

    def pop(self) -> Any:
        if not self:
            raise KeyError("pop from an empty set")
        value = next(iter(self))
        self.discard(value)
        return value

    def copy(self) -> HubSet:
        result = HubSet()
        set.update(result, list(self._table))
        result._table = self._table.copy()
        return result

    def update(self, *others: Iterable[Any]) -> None:
        for other in others:
            for value in other:
                self.add(value)

    def difference_update(self, *others: Iterable[Any]) -> None:
        for other in others:
            if other is self:
                self.clear()
            else:
                for value in other:
                    self.discard(value)

    def symmetric_difference_update(self, other: Iterable[Any], /) -> None:
        for value in other:
            if value in self:
                self.discard(value)
            else:
                self.add(value)

    # A hub's method takes one argument, but CPython's any number. The same holds for `union` and
    # `intersection`.
    def intersection_update(self, other: Iterable[Any], /) -> None:  # type: ignore[override]
        common = self.intersection(other)
        set.intersection_update(self, common)
        self._table = common._table

    def union(self, other: Iterable[Any], /) -> HubSet:  # type: ignore[override]
        result = self.copy()
        result.update(other)
        return result

    def difference(self, *others: Iterable[Any]) -> HubSet:
        result = self.copy()
        # The set itself is replaced by its copy, because `difference_update` clears what it is
        # given.
        removed = [result if other is self else other for other in others]
        result.difference_update(*removed)
        return result

    def symmetric_difference(self, other: Iterable[Any], /) -> HubSet:
        result = self.copy()
        result.symmetric_difference_update(other)
        return result

    def intersection(self, other: Iterable[Any], /) -> HubSet:  # type: ignore[override]
        if other is self:
            return self.copy()
        # The other set gives the order, which decides the slots.
        return HubSet(value for value in other if value in self)

    __or__ = _operator("union")
    __ior__ = _operator("update")
    __sub__ = _operator("difference")
    __isub__ = _operator("difference_update")
    __xor__ = _operator("symmetric_difference")
    __ixor__ = _operator("symmetric_difference_update")
    __and__ = _operator("intersection")
    __iand__ = _operator("intersection_update")


# Programs see the names of these classes in texts and messages.
for _kind, _name in (
    (HubDict, "dict"),
    (FixedDict, "dict"),
    (HubSet, "set"),
    (DictView, "dict_view"),
    (TableIterator, "iterator"),
):
    _kind.__name__ = _kind.__qualname__ = _name
