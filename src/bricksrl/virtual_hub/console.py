"""Standard input and output of a program on a virtual hub."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


class Console(Protocol):
    """The bytes between a program and whoever listens. What ``print`` writes has its ``\\n`` turned into ``\\r\\n``."""

    def available(self) -> int:
        """Number of bytes that can be read without waiting."""

    def read(self, n: int) -> bytes:
        """Exactly ``n`` bytes; lets simulated time pass, 1 ms at a time, until they are there."""

    def write(self, data: bytes) -> None:
        """Send these bytes as they are."""


@runtime_checkable
class AppDataConsole(Protocol):
    """A console whose listener takes AppData too.

    Attributes:
        inbox: what the listener writes into; the program makes it as large as it likes.
    """

    inbox: bytearray

    def write_app_data(self, data: bytes) -> None:
        """Send these bytes; raises OSError when nobody listens."""
