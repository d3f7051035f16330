"""Memory of hubs for a program's objects."""

from __future__ import annotations

from bricksrl.robots import HubKind

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


def check_allocation(size_bytes: int) -> None:
    """Raise MemoryError for an object that fits on no hub."""
    if size_bytes > RAM_BYTES[HubKind.PRIME]:
        raise MemoryError(f"memory allocation failed, allocating {size_bytes} bytes")
