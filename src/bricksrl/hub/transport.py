"""Transport: the byte stream between this computer and a program on a hub."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol

MAIN_FILE = "main.py"
"""Name of a program in its tracebacks, where it has no file."""


class Pipe(enum.Enum):
    """Way of the bytes to a program and back."""

    STDIN = "stdin"
    """Standard input and output: a queue. What does not fit the hub's buffer is refused and comes again."""
    APP_DATA = "app-data"
    """AppData: a place that every write replaces, so that nothing waits in it."""


@dataclass(frozen=True)
class HubModule:
    """A module that a program brings along: its name on the hub (``parts.arm``), its file (``parts/arm.py``), its source."""

    name: str
    file: str
    source: str


@dataclass(frozen=True)
class HubProgram:
    """A MicroPython program for a hub, and how to speak to it.

    Attributes:
        source: of the program itself.
        hash: of all of it; its HELLO frame carries it.
        name: of its file, in tracebacks.
        beside: modules that it imports.
        says_hello: whether it begins with that frame, by which a transport knows that it is on the hub already.
    """

    source: str
    hash: int
    pipe: Pipe = Pipe.STDIN
    name: str = MAIN_FILE
    beside: tuple[HubModule, ...] = ()
    says_hello: bool = True


class Transport(Protocol):
    """One hub: virtual, over Bluetooth, or over USB. Calls come from one thread, but for ``stop``.

    All errors are ``HubError`` or its children. ``close`` stops the program, may be called in any state, twice too.
    """

    def open(self) -> None:
        """Find the hub and connect to it."""

    def start(self, program: HubProgram) -> None:
        """Bring the program onto the hub (only where it is not there yet) and start it."""

    def write(self, data: bytes) -> None:
        """Write at most 20 bytes to the program; returns when the hub has taken them."""

    def read(self, timeout_s: float) -> bytes:
        """The next bytes from the program, or ``b""`` when none came in time."""

    def stop(self) -> None:
        """Stop the program and with it the motors. From any thread, also while another one waits in another call."""

    def close(self) -> None:
        """Stop and disconnect."""

    def now_s(self) -> float:
        """Time of the link, in seconds: the computer's clock, or the simulated one."""
