"""Run of a user's program on a hub: what it prints, what it raises, what it reads."""

from __future__ import annotations

import contextlib
import queue
import re
import threading
from typing import BinaryIO, TextIO

from bricksrl.hub.errors import HubBusyError, ProgramStoppedError
from bricksrl.hub.program.user_program import check_time_limit
from bricksrl.hub.protocol import WRITE_BYTES
from bricksrl.hub.transport import HubProgram, Transport

_READ_S = 0.25
_READ_BESIDE_INPUT_S = 0.02
_HEAD = "Traceback (most recent call last):"
_PLACE = "  File "
_STOPPED = re.compile(r"The program was stopped \(\w+\)\.")
_LAST_WORDS = (_HEAD.encode(), b"The program was stopped (SystemExit).")


def run_program(
    transport: Transport,
    program: HubProgram,
    *,
    stdout: BinaryIO,
    stderr: TextIO,
    stdin: BinaryIO | None = None,
    time_limit_s: float | None = None,
) -> int:
    """Start a program over a transport, which connects where it has not yet, and stay until it ends.

    Args:
        transport: to the hub.
        program: from :func:`~bricksrl.hub.program.user_program.own_program`.
        stdout: gets what it prints, as it comes.
        stderr: gets the traceback when it raises, or that it was stopped.
        stdin: what the program can read; read in a thread, and passed on as the hub takes it.
        time_limit_s: seconds after which the program is stopped.

    Returns:
        Exit code: 1 when the program raised, 0 else.

    Raises:
        ProgramError: the program is wrong, or too large for the hub, or the time limit is no time.
        HubError: the hub cannot be reached, or the link was lost.
    """
    check_time_limit(time_limit_s)
    transcript = Transcript(stdout, stderr)
    transport.start(program)
    typed = _Typed(stdin) if stdin is not None else None
    deadline_s = None if time_limit_s is None else transport.now_s() + time_limit_s
    try:
        while True:
            if deadline_s is not None and transport.now_s() >= deadline_s:
                deadline_s = None
                transport.stop()
            elif typed is not None and (data := typed.next()):
                try:
                    transport.write(data)
                except HubBusyError:
                    typed.put_back(data)  # the program reads nothing just now
            transcript.take(transport.read(_READ_S if typed is None else _READ_BESIDE_INPUT_S))
    except ProgramStoppedError:
        return transcript.end()


class _Typed:
    """Standard input, read in a separate thread, since nobody can wait for it and for the hub at once."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._pieces: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._again = b""
        threading.Thread(target=self._read, name="standard input", daemon=True).start()

    def _read(self) -> None:
        read = getattr(self._stream, "read1", self._stream.read)
        with contextlib.suppress(OSError, ValueError):  # closed: nothing more is typed
            while data := read(WRITE_BYTES):
                self._pieces.put(data)

    def next(self) -> bytes:
        """The next bytes; ``b""`` while there are none."""
        data, self._again = self._again, b""
        try:
            return data or self._pieces.get_nowait()
        except queue.Empty:
            return b""

    def put_back(self, data: bytes) -> None:
        self._again = data


class Transcript:
    """Tells apart what a program prints and how the firmware says that it ended: a hub writes both to the same place.

    A traceback that other output follows was printed by the program itself.
    """

    def __init__(self, stdout: BinaryIO, stderr: TextIO) -> None:
        self._stdout = stdout
        self._stderr = stderr
        self._line = b""
        self._held: list[str] = []

    def take(self, data: bytes) -> None:
        """More output of the hub."""
        *lines, self._line = (self._line + data).replace(b"\r\n", b"\n").split(b"\n")
        for line in lines:
            self._take_line(line)
        shown = self._line.removesuffix(b"\r")  # the rest of a line's end may follow
        if not self._held and not any(words.startswith(shown) for words in _LAST_WORDS):
            self._print(shown)
            self._line = self._line[len(shown) :]

    def end(self) -> int:
        """No more output; the exit code."""
        if self._line:
            self._let_go()
            self._print(self._line)
        for line in self._held:
            self._stderr.write(f"{line}\n")
        return int(_HEAD in self._held)

    def _take_line(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace")
        if self._held and not self._goes_on(text):
            self._let_go()
        if self._held or text == _HEAD or _STOPPED.fullmatch(text):
            self._held.append(text)
        else:
            self._print(line + b"\n")

    def _goes_on(self, text: str) -> bool:
        """True if a line belongs to the traceback before it: places, and then the error."""
        if self._held[0] != _HEAD:
            return False
        return text.startswith(_PLACE) if len(self._held) == 1 else self._held[-1].startswith(_PLACE)

    def _let_go(self) -> None:
        self._print("".join(f"{line}\n" for line in self._held).encode())
        self._held = []

    def _print(self, data: bytes) -> None:
        self._stdout.write(data)
        self._stdout.flush()
