"""Memory of hubs for a program's objects."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

from brickhub.robot import HubKind

MOST_BYTES = max(kind.model.program_bytes for kind in HubKind)
"""Memory of the largest hub."""
BLOCK_BYTES = 16
"""Bytes of a block of MicroPython's heap."""
_REFERENCE_BYTES = 4


def check_allocation(size_bytes: int) -> None:
    """Raise MemoryError for an object that fits on no hub."""
    if size_bytes > MOST_BYTES:
        raise MemoryError(f"memory allocation failed, allocating {size_bytes} bytes")


def items_of(values: Iterable[Any], item_bytes: int = _REFERENCE_BYTES) -> list[Any]:
    """A list of an iterable's items. Raises MemoryError if there are more than fit on any hub."""
    items: list[Any] = []
    extend(items, values, item_bytes)
    return items


def extend(items: list[Any], values: Iterable[Any], item_bytes: int = _REFERENCE_BYTES) -> None:
    """Append an iterable's items one by one. Raises MemoryError if there are more than fit on any hub."""
    items.extend(itertools.islice(values, MOST_BYTES // item_bytes + 1))
    check_allocation(item_bytes * len(items))
