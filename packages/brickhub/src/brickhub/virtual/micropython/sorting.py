"""Sorting as on a hub: a quicksort (``py/objlist.c`` of MicroPython 1.26), which changes the order of equal elements."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from brickhub.virtual.memory import items_of

_INDISTINGUISHABLE = (int, str)
"""Kinds whose equal elements are the same in every respect."""


def sort(owner: Any, *args: Any, **kwargs: Any) -> Any:
    """``owner.sort(...)``."""
    if not isinstance(owner, list) or type(owner).sort is not list.sort:
        return owner.sort(*args, **kwargs)
    if args:
        raise TypeError("extra positional arguments given")
    return _sort(owner, **kwargs)


def sorted_list(values: Iterable[Any], /, *args: Any, **kwargs: Any) -> list[Any]:
    """``sorted(...)``."""
    if args:
        raise TypeError("must use keyword argument for key function")
    items = items_of(values)
    _sort(items, **kwargs)
    return items


def _sort(items: list[Any], *, key: Callable[[Any], Any] | None = None, reverse: Any = False) -> None:
    kinds = set(map(type, items))
    if key is None and len(kinds) == 1 and kinds.issubset(_INDISTINGUISHABLE):
        items.sort(reverse=bool(reverse))
    else:
        _quicksort(items, 0, len(items) - 1, key or _identity, not reverse)


def _identity(value: Any) -> Any:
    return value


def _is_less(a: Any, b: Any) -> Any:
    """``a < b``; a hub asks the first items that differ for ``>``."""
    if type(a) not in (list, tuple) or type(b) is not type(a):
        return a < b
    for x, y in zip(a, b, strict=False):
        if x is not y and not x == y:  # noqa: SIM201  `!=` may be another method
            return y > x
    return len(a) < len(b)


def _quicksort(items: list[Any], first: int, last: int, key: Callable[[Any], Any], is_less: bool) -> None:
    """Sort ``items[first:last + 1]`` so that ``<`` gives ``is_less``; keys are computed for each comparison."""
    while first < last:
        pivot = key(items[last])
        low, high = first, last - 1
        while True:
            while low <= high and _is_less(key(items[low]), pivot) is is_less:
                low += 1
            while low < high and _is_less(pivot, key(items[high])) is is_less:
                high -= 1
            if low >= high:
                break
            items[low], items[high] = items[high], items[low]
            low, high = low + 1, high - 1
        items[low], items[last] = items[last], items[low]
        if high - first < last - low - 1:
            _quicksort(items, first, high, key, is_less)
            first = low + 1
        else:
            _quicksort(items, low + 1, last, key, is_less)
            last = high
