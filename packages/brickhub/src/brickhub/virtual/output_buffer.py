"""Buffer of a hub for the output of a program."""

from __future__ import annotations

from brickhub.virtual.machine import Machine

_BUFFER_BYTES = 511
_CHUNK_BYTES = 60


class OutputBuffer:
    """Buffer for output that waits to be sent over USB, 60 bytes each millisecond. A program waits while it is full."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._waiting = 0
        self._since_ms = 0
        self._free_ms = 0

    def add(self, size: int) -> None:
        """Add ``size`` bytes; simulated time passes until they fit."""
        machine = self._machine
        self._send(machine.body_ms - 1)
        if not self._waiting:
            self._since_ms = machine.time_ms
        while self._waiting + size > _BUFFER_BYTES:
            size -= _BUFFER_BYTES - self._waiting
            self._waiting = _BUFFER_BYTES
            self._send(machine.time_ms)
            machine.advance(1)
        self._waiting += size

    def _send(self, until_ms: int) -> None:
        """Send chunks that begin at a time or before."""
        while self._waiting and (begin_ms := max(self._free_ms, self._since_ms)) <= until_ms:
            self._waiting -= min(self._waiting, _CHUNK_BYTES)
            self._free_ms = begin_ms + 1
