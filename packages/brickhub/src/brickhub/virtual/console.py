"""Standard input and output of a program on a virtual hub."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


class Console(Protocol):
    """Byte streams between a program and its host. ``print`` writes ``\\r\\n`` for ``\\n``."""

    def available(self) -> int:
        """Number of bytes that can be read without waiting."""

    def read(self, n: int) -> bytes:
        """Exactly ``n`` bytes; simulated time advances in steps of 1 ms until they are there."""

    def write(self, data: bytes) -> None:
        """Send bytes unchanged."""


@runtime_checkable
class AppDataConsole(Protocol):
    """A console with AppData. ``inbox``: buffer that the host writes to; the program sets its size."""

    inbox: bytearray

    def write_app_data(self, data: bytes) -> None:
        """Send bytes; raises OSError without a listener."""
