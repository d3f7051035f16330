"""Memory of hubs for a program's objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

from brickhub.robot import HubKind

RAM_BYTES = {
    HubKind.PRIME: 272 * 1024,
    HubKind.ESSENTIAL: 258 * 1024,
    HubKind.TECHNIC: 32 * 1024,
    HubKind.CITY: 20 * 1024,
    HubKind.MOVE: 7 * 1024,
}
"""Memory for stored data and the heap (``PBDRV_CONFIG_BLOCK_DEVICE_RAM_SIZE`` of Pybricks 4); a Prime hub has most."""
BLOCK_BYTES = 16
"""Bytes of a block of MicroPython's heap."""
_REFERENCE_BYTES = 4


def check_allocation(size_bytes: int) -> None:
    """Raise MemoryError for an object that fits on no hub."""
    if size_bytes > RAM_BYTES[HubKind.PRIME]:
        raise MemoryError(f"memory allocation failed, allocating {size_bytes} bytes")


def items_of(values: Iterable[Any], item_bytes: int = _REFERENCE_BYTES) -> list[Any]:
    """A list of an iterable's items. Raises MemoryError if there are more than fit on any hub."""
    items: list[Any] = []
    extend(items, values, item_bytes)
    return items


def extend(items: list[Any], values: Iterable[Any], item_bytes: int = _REFERENCE_BYTES) -> None:
    """Append an iterable's items one by one. Raises MemoryError if there are more than fit on any hub."""
    items.extend(itertools.islice(values, RAM_BYTES[HubKind.PRIME] // item_bytes + 1))
    check_allocation(item_bytes * len(items))
