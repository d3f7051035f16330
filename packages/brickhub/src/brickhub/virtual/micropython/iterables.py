"""Iterables of a hub: collecting their items, generators, and sorting.

Functions that collect items refuse more than fit on any hub. A generator that a program drops in
the middle just stays there, where CPython closes it. Sorting is a quicksort (``py/objlist.c`` of
MicroPython 1.26), which changes the order of equal elements.
"""

import sys
import threading
from collections.abc import Callable, Iterable
from types import GeneratorType
from typing import Any

from brickhub.virtual.micropython.memory import check_allocation, extend, items_of


def _to_bytes(values: Any) -> Any:
    """``bytes(values)``: of a size, a buffer or an iterable."""
    # CPython would take a truth value for a size of 0 or 1.
    if isinstance(values, bool):
        raise TypeError("'bool' object isn't iterable")
    if isinstance(values, int):
        zero_byte = 1
        check_allocation(values + zero_byte)
    elif not isinstance(values, str | bytes | bytearray | memoryview | list | tuple):
        values = items_of(values, item_bytes=1)
    return bytes(values)


def _star(values: Any) -> Any:
    """Arguments ``*values``, whose number the hub asks for first, as it makes room for them and the
    function."""
    # These are in memory already, and have been measured.
    if isinstance(values, list | tuple | str | bytes | dict):
        return values
    if isinstance(values, range):
        check_allocation(4 * (1 + len(values)))
    return items_of(values)


def _extend(owner: Any, values: Any) -> Any:
    """``owner.extend(values)``."""
    # Another object may have a method of this name, such as a program's subclass of list.
    is_plain_list = isinstance(owner, list) and type(owner).extend is list.extend
    if not is_plain_list or isinstance(values, list | tuple):
        return owner.extend(values)
    return extend(owner, values)


def _join(owner: Any, values: Any) -> Any:
    """``owner.join(values)``."""
    if not isinstance(owner, str | bytes):
        return owner.join(values)
    parts = values if isinstance(values, list | tuple) else items_of(values)
    separator_bytes = len(owner)
    size_bytes = 0
    for part in parts:
        # Parts of other kinds are left for `join` to refuse.
        if isinstance(part, str | bytes):
            size_bytes += len(part) + separator_bytes
    check_allocation(size_bytes)
    return owner.join(parts)


def add_in_place(a: Any, b: Any) -> Any:
    """``a += b``."""
    if type(a) is list and not isinstance(b, list | tuple):
        extend(a, b)
    else:
        a += b
    return a


class _Ending(threading.local):
    """Number of calls that end a generator, in this thread: several hubs may run at once, each in
    its own."""

    calls = 0


_ending = _Ending()


def close(
    owner: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``owner.close(...)``."""
    _ending.calls += 1
    try:
        return owner.close(*args, **kwargs)
    finally:
        _ending.calls -= 1


def _throw(
    generator: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``generator.throw(...)``; a generator that has ended remains so."""
    # CPython would raise what is thrown into a generator that has ended.
    if isinstance(generator, GeneratorType) and generator.gi_frame is None:
        raise StopIteration
    _ending.calls += 1
    try:
        return generator.throw(*args, **kwargs)
    finally:
        _ending.calls -= 1


def is_dropped() -> bool:
    """Whether CPython ends a generator now that a program has dropped."""
    # If no call is ending a generator, only CPython itself throws a GeneratorExit.
    return not _ending.calls and isinstance(sys.exc_info()[1], GeneratorExit)


ITERABLE_FUNCTIONS = {
    "@star": _star,
    "@extend": _extend,
    "@join": _join,
    "@close": close,
    "@throw": _throw,
}
"""Functions by their names in the transformed program."""
ITERABLE_CONVERSIONS: dict[Any, Callable[..., Any]] = {
    list: items_of,
    tuple: lambda values: values if type(values) is tuple else tuple(items_of(values)),
    bytes: _to_bytes,
}
"""Calls of classes with one argument."""


def sort(
    owner: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``owner.sort(...)``."""
    if not isinstance(owner, list) or type(owner).sort is not list.sort:
        return owner.sort(*args, **kwargs)
    if args:
        raise TypeError("extra positional arguments given")
    return _sort(owner, **kwargs)


def sorted_list(
    values: Iterable[Any],
    /,
    *args: Any,
    **kwargs: Any,
) -> list[Any]:
    """``sorted(...)``."""
    if args:
        raise TypeError("must use keyword argument for key function")
    items = items_of(values)
    _sort(items, **kwargs)
    return items


def _sort(
    items: list[Any],
    *,
    key: Callable[[Any], Any] | None = None,
    reverse: Any = False,
) -> None:
    kinds = set(map(type, items))
    # Equal integers or texts are the same in every respect, so any way of sorting gives the same
    # list.
    if key is None and kinds in ({int}, {str}):
        items.sort(reverse=bool(reverse))
        return
    if key is None:
        key = _itself
    _quicksort(
        items,
        0,
        len(items) - 1,
        key,
        not reverse,
    )


def _itself(value: Any) -> Any:
    return value


def _is_less(a: Any, b: Any) -> Any:
    """``a < b``; a hub asks the first items that differ for ``>``."""
    if type(a) not in (list, tuple) or type(b) is not type(a):
        return a < b
    for x, y in zip(a, b, strict=False):
        # `!=` is not used, because the program may have made it another method.
        if x is not y and not x == y:  # noqa: SIM201
            return y > x
    return len(a) < len(b)


def _quicksort(
    items: list[Any],
    first: int,
    last: int,
    key: Callable[[Any], Any],
    is_less: bool,
) -> None:
    """Sort ``items[first:last + 1]`` so that ``<`` gives ``is_less``; keys are computed for each
    comparison."""
    while first < last:
        # A hub takes the last item as its pivot, and another one would change the order of equal
        # elements.
        pivot = key(items[last])
        low = first
        high = last - 1
        while True:
            while low <= high and _is_less(key(items[low]), pivot) is is_less:
                low += 1
            while low < high and _is_less(pivot, key(items[high])) is is_less:
                high -= 1
            if low >= high:
                break
            items[low], items[high] = items[high], items[low]
            low = low + 1
            high = high - 1
        items[low], items[last] = items[last], items[low]
        # The smaller part is sorted by a call and the larger one by this loop, which keeps the
        # calls few.
        if high - first < last - low - 1:
            _quicksort(items, first, high, key, is_less)
            first = low + 1
        else:
            _quicksort(
                items,
                low + 1,
                last,
                key,
                is_less,
            )
            last = high
