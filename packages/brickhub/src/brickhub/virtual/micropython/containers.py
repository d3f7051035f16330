"""Dicts and sets in the order of a hub's hash tables (``py/objdict.c`` and ``py/objset.c`` of MicroPython 1.26)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from typing import Any

from brickhub.virtual.micropython.hash_table import HashTable

_MISSING = object()


class HubDict(dict[Any, Any]):
    """A dict ordered by slots."""

    __slots__ = ("_table",)
    _table: HashTable

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        result = super().__new__(cls)
        result._table = HashTable()
        return result

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.update(*args, **kwargs)

    @classmethod
    def sized(cls, size: int, pairs: Iterable[tuple[Any, Any]]) -> HubDict:
        """With an initial number of slots."""
        result = cls()
        result._table = HashTable(size)
        for key, value in pairs:
            result[key] = value
        return result

    @classmethod
    def in_order(cls, values: Mapping[Any, Any]) -> HubDict:
        """An ordered dict, as made by the firmware."""
        result = cls()
        dict.update(result, values)
        result._table = HashTable.in_order(values)
        return result

    def __setitem__(self, key: Any, value: Any, /) -> None:
        if key not in self:
            self._table.add(key)
        super().__setitem__(key, value)

    def __delitem__(self, key: Any, /) -> None:
        super().__delitem__(key)
        self._table.remove(key)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._table)

    def __reversed__(self) -> Any:
        raise TypeError("'dict' object is not reversible")

    def keys(self) -> Any:
        return DictView(self, "keys")

    def values(self) -> Any:
        return DictView(self, "values")

    def items(self) -> Any:
        return DictView(self, "items")

    def clear(self) -> None:
        super().clear()
        self._table.clear()

    def copy(self) -> HubDict:
        result = HubDict()
        dict.update(result, [(key, dict.__getitem__(self, key)) for key in self._table])
        result._table = self._table.copy()
        return result

    @classmethod
    def fromkeys(cls, keys: Iterable[Any], value: Any = None, /) -> HubDict:
        return HubDict.sized(len(keys) if isinstance(keys, Sized) else 0, ((key, value) for key in keys))

    def pop(self, key: Any, default: Any = _MISSING, /) -> Any:
        if key not in self:
            return super().pop(key) if default is _MISSING else default
        self._table.remove(key)
        return super().pop(key)

    def popitem(self) -> tuple[Any, Any]:
        if not self:
            raise KeyError("popitem(): dictionary is empty")
        key = self._table.drop_first()
        return key, super().pop(key)

    def setdefault(self, key: Any, default: Any = None, /) -> Any:
        if key not in self:
            self[key] = default
        return self[key]

    def update(self, other: Any = (), /, **named: Any) -> None:
        pairs = other.items() if type(other) is HubDict else map(_pair, other)
        for key, value in itertools.chain(pairs, named.items()):
            self[key] = value


def _pair(values: Iterable[Any]) -> list[Any]:
    pair = list(values)
    if len(pair) != 2:
        raise ValueError("dict update sequence has wrong length")
    return pair


class DictView:
    """Result of ``keys()``, ``values()`` and ``items()``; no set, no length."""

    __slots__ = ("kind", "owner")

    def __init__(self, owner: HubDict, kind: str) -> None:
        self.owner = owner
        self.kind = kind

    def __iter__(self) -> Iterator[Any]:
        if self.kind == "keys":
            return iter(self.owner)
        if self.kind == "values":
            return Mapped(self.owner, lambda key: dict.__getitem__(self.owner, key))
        return Mapped(self.owner, lambda key: (key, dict.__getitem__(self.owner, key)))

    def __hash__(self) -> int:
        if self.kind != "values":
            raise TypeError("unhashable type: 'dict_view'")
        return id(self)

    def __contains__(self, value: Any) -> bool:
        return value in self.owner if self.kind == "keys" else any(value == other for other in self)


class Mapped:
    """Iterator over a function of the keys."""

    __slots__ = ("_function", "_keys")

    def __init__(self, owner: HubDict, function: Callable[[Any], Any]) -> None:
        self._keys = iter(owner)
        self._function = function

    def __iter__(self) -> Mapped:
        return self

    def __next__(self) -> Any:
        return self._function(next(self._keys))


class HubSet(set[Any]):
    """A set ordered by slots."""

    __slots__ = ("_table",)
    _table: HashTable

    def __new__(cls, *args: Any) -> Any:
        result = super().__new__(cls)
        result._table = HashTable()
        return result

    def __init__(self, *values: Iterable[Any]) -> None:
        if len(values) > 1:
            raise TypeError(f"function expected at most 1 arguments, got {len(values)}")
        self.update(*values)

    @classmethod
    def sized(cls, values: Iterable[Any], size: int) -> HubSet:
        """With an initial number of slots."""
        result = cls()
        result._table = HashTable(size)
        result.update(values)
        return result

    def __iter__(self) -> Iterator[Any]:
        return iter(self._table)

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
        value = self._table.first()
        self.discard(value)
        return value

    def clear(self) -> None:
        super().clear()
        self._table.clear()

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

    def intersection_update(self, other: Iterable[Any], /) -> None:  # type: ignore[override]  # one, on a hub
        common = self.intersection(other)
        set.intersection_update(self, common)
        self._table = common._table

    def union(self, other: Iterable[Any], /) -> HubSet:  # type: ignore[override]  # one, on a hub
        result = self.copy()
        result.update(other)
        return result

    def difference(self, *others: Iterable[Any]) -> HubSet:
        result = self.copy()
        result.difference_update(*(result if other is self else other for other in others))
        return result

    def symmetric_difference(self, other: Iterable[Any], /) -> HubSet:
        result = self.copy()
        result.symmetric_difference_update(other)
        return result

    def intersection(self, other: Iterable[Any], /) -> HubSet:  # type: ignore[override]  # one, on a hub
        return self.copy() if other is self else HubSet(value for value in other if value in self)

    def __or__(self, other: Any) -> Any:
        return self.union(other) if isinstance(other, set) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        return self.difference(other) if isinstance(other, set) else NotImplemented

    def __xor__(self, other: Any) -> Any:
        return self.symmetric_difference(other) if isinstance(other, set) else NotImplemented

    def __and__(self, other: Any) -> Any:
        return self.intersection(other) if isinstance(other, set) else NotImplemented

    def __ior__(self, other: Any) -> Any:
        return _in_place(self, self.update, other)

    def __isub__(self, other: Any) -> Any:
        return _in_place(self, self.difference_update, other)

    def __ixor__(self, other: Any) -> Any:
        return _in_place(self, self.symmetric_difference_update, other)

    def __iand__(self, other: Any) -> Any:
        return _in_place(self, self.intersection_update, other)


def _in_place(owner: HubSet, change: Callable[[Any], None], other: Any) -> Any:
    if not isinstance(other, set):
        return NotImplemented
    change(other)
    return owner


for _kind, _name in ((HubDict, "dict"), (HubSet, "set"), (DictView, "dict_view"), (Mapped, "iterator")):
    _kind.__name__ = _kind.__qualname__ = _name
