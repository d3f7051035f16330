"""Transport: the byte stream between this computer and a program on a hub."""

import enum
from dataclasses import dataclass
from typing import Protocol

MAIN_FILE = "main.py"
"""File name in the tracebacks of a program without a file."""


class Pipe(enum.Enum):
    """Channel for the bytes to a program and back."""

    STDIN = "stdin"
    """Standard input and output: a queue. A write that does not fit the hub's buffer is refused and
    retried."""
    APP_DATA = "app-data"
    """AppData: a buffer that every write overwrites, so that nothing queues."""


def app_data_slot(count: int, frame: bytes) -> bytes:
    """Content of the program's AppData buffer for a frame; a changed ``count`` (1..255) marks it as
    new."""
    # The length is sent too, because the buffer may still hold the end of a longer frame.
    return bytes((count, len(frame))) + frame


def as_typed(data: bytes | str) -> bytes:
    """Bytes of input; lines of text end with the Enter key, CR, for which ``input()`` waits on a
    hub. Bytes that are no UTF-8 are surrogate escapes in text."""
    if isinstance(data, str):
        return data.replace("\n", "\r").encode(errors="surrogateescape")
    return data


@dataclass(frozen=True)
class HubModule:
    """Module of a program: its name on the hub (``parts.arm``), its file (``parts/arm.py``), its
    source."""

    name: str
    file: str
    source: str


@dataclass(frozen=True)
class HubProgram:
    """MicroPython program for a hub, and its communication channel.

    Attributes:
        source: source of the main file.
        hash: hash of the whole program, which its HELLO frame carries.
        pipe, name: channel for its input and output; name of its file in tracebacks.
        modules: modules that it imports.
        says_hello: whether it begins with a HELLO frame, by which a transport recognises it on the
            hub.
    """

    source: str
    hash: int
    pipe: Pipe = Pipe.STDIN
    name: str = MAIN_FILE
    modules: tuple[HubModule, ...] = ()
    says_hello: bool = True


class Transport(Protocol):
    """Transport to one hub: virtual, over Bluetooth, or over USB. All methods but ``stop`` are
    called from one thread.

    All errors are ``HubError`` or its subclasses. ``close`` stops the program; it may be called in
    any state and repeatedly.
    """

    def open(self) -> None:
        """Find the hub and connect to it."""

    def start(self, program: HubProgram) -> None:
        """Download the program to the hub, unless it is there already, and start it."""

    def write(self, data: bytes) -> None:
        """Write at most 20 bytes to the program; returns when the hub has accepted them."""

    def read(self, timeout_s: float) -> bytes:
        """Next bytes from the program, or ``b""`` if none came in time."""

    def stop(self) -> None:
        """Stop the program and with it the motors. May be called from any thread, even while
        another call is blocked."""

    def close(self) -> None:
        """Stop and disconnect."""

    def now_s(self) -> float:
        """Time of the link, in seconds: the computer's clock, or the simulated one."""
