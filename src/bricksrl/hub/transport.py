"""The byte stream between this computer and the standard input and output of a program on a hub."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class HubProgram:
    """A MicroPython program for a hub and the hash that its HELLO frame carries."""

    source: str
    hash: int


class Transport(Protocol):
    """One hub: virtual, over Bluetooth, or over USB. Calls come from one thread, but for ``stop``.

    All errors are ``HubError`` or its children. ``close`` stops the program, may be called in any state, twice too.
    """

    def open(self) -> None:
        """Find the hub and connect to it."""

    def start(self, program: HubProgram) -> None:
        """Bring the program onto the hub (only where it is not there yet) and start it."""

    def write(self, data: bytes) -> None:
        """Write at most 20 bytes to the program's standard input; returns when the hub has taken them."""

    def read(self, timeout_s: float) -> bytes:
        """The next bytes of the program's standard output, or ``b""`` when none came in time."""

    def stop(self) -> None:
        """Stop the program and with it the motors. From any thread, also while another one waits in another call."""

    def close(self) -> None:
        """Stop and disconnect."""

    def now_s(self) -> float:
        """Time of the link, in seconds: the computer's clock, or the simulated one."""
