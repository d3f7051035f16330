"""User's program on a hub: its file and the modules beside it, its run with output and input, its
traceback."""

import contextlib
import hashlib
import io
import math
import queue
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from brickhub.errors import HubBusyError, ProgramError, ProgramStoppedError
from brickhub.hub.program.compile import imported_modules
from brickhub.hub.program.pybricks2 import outdated_note
from brickhub.hub.program.syntax import parse
from brickhub.hub.protocol import WRITE_BYTES
from brickhub.hub.transport import MAIN_FILE, HubModule, HubProgram, Transport, as_typed

_MAX_FOLDERS_ABOVE = 5
"""A project's own folders; further up, a module of that name is another project's."""
TIME_LIMIT_EXIT_CODE = 124
"""Exit code of a program that the time limit ended, as the command ``timeout`` has it."""


def read_program(path: Path) -> str:
    """Source of a program. Raises ProgramError if the file cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ProgramError(
            f"cannot read the program '{path}' ({error.strerror}); give the path of a Python file"
        ) from error
    except UnicodeDecodeError as error:
        raise ProgramError(
            f"the program '{path}' is no text in UTF-8 ({error.reason}); save it as UTF-8"
        ) from error


def check_time_limit(time_limit_s: float | None) -> None:
    """Check a time limit in seconds; ``None`` for no limit. Raises ProgramError if the limit is not
    a positive finite number."""
    if time_limit_s is not None and not 0 < time_limit_s < math.inf:
        raise ProgramError(f"the time limit is {time_limit_s} s; give a number above zero, or none")


def time_limit_note(time_limit_s: float) -> str:
    """Note to a person about a program that the time limit ended."""
    return f"The program was stopped at the time limit of {time_limit_s:g} s.\n"


def module_beside(path: Path, name: str) -> HubModule | None:
    """The module ``name`` (such as ``parts.arm``) beside a program; ``None`` if there is none.
    Raises ProgramError if the file cannot be read."""
    stem = "/".join(name.split("."))
    for file in (f"{stem}.py", f"{stem}/__init__.py"):
        if (path.parent / file).is_file():
            return HubModule(name, file, read_program(path.parent / file))
    return None


def folder_with_module(path: Path, name: str) -> Path | None:
    """The nearest folder above a program's that has a module which it lacks; ``None`` if there is
    none."""
    folders_above = path.resolve().parents[1:_MAX_FOLDERS_ABOVE]
    for folder in folders_above:
        program_there = folder / path.name
        if module_beside(program_there, name):
            return folder
    return None


def load_program(path: Path) -> HubProgram:
    """A program for a hub, with all modules beside it that it may import. Raises ProgramError if a
    file cannot be read."""
    main = read_program(path)
    modules: dict[str, HubModule] = {}
    sources = [main]
    # Modules may import each other; each is taken once, so that a cycle ends.
    while sources:
        for name in _imported(sources.pop()):
            if name in modules:
                continue
            module = module_beside(path, name)
            if module is not None:
                modules[name] = module
                sources.append(module.source)
    # A source has no null byte, so two different programs never have the same joined text.
    texts = [main, *(f"{module.name}\0{module.source}" for module in modules.values())]
    digest = hashlib.sha256("\0".join(texts).encode()).digest()
    program_hash = int.from_bytes(digest[:4], "little")
    return HubProgram(
        main,
        program_hash,
        name=path.name,
        modules=tuple(modules.values()),
        says_hello=False,
    )


def imports(program: HubProgram, name: str) -> bool:
    """Whether a program or a module beside it imports a module of that name."""
    sources = [program.source, *(module.source for module in program.modules)]
    return any(name in _imported(source) for source in sources)


def _imported(source: str) -> Iterator[str]:
    """Names of modules in all import statements; empty for invalid source, which the hub's compiler
    rejects later."""
    with contextlib.suppress(SyntaxError, ValueError):
        yield from imported_modules(parse(source))


_HINTS = {
    "ENODEV": "plug the device into the port that the robot's description names",
    "ETIMEDOUT": "switch the remote on at the start of the program, its light blinks then",
    "MemoryError": "use fewer commands and channels, or a larger hub",
}


def describe_traceback(
    text: str,
    source: str,
    name: str = MAIN_FILE,
) -> str:
    """One line from the hub's output: the last exception, its line in ``source`` (file ``name``),
    and a remedy."""
    # The program may have printed tracebacks of its own before, so the last one counts.
    traceback = text[text.rfind("Traceback (") :]
    error = "an unknown error"
    for line in traceback.splitlines():
        # The line that names the exception is neither indented, nor the heading, nor the firmware's
        # closing message. The last such line counts.
        if re.match(r"[A-Za-z_]\w*(:|$)", line):
            error = line.strip()
    # The innermost call comes last. A call in a module beside the program is not in this source.
    numbers = re.findall(rf'File "{re.escape(name)}", line (\d+)', traceback)
    lines = source.splitlines()
    where = ""
    if numbers:
        number = int(numbers[-1])
        # The text came from the hub, so the number may be anything.
        if 1 <= number <= len(lines):
            where = f" at line {numbers[-1]} ({lines[number - 1].strip()})"
    return f"the program on the hub raised {error}{where}; {_remedy(error)}"


def _remedy(error: str) -> str:
    for key, remedy in _HINTS.items():
        if key in error:
            return remedy
    return "correct the cause, then call open()"


_READ_S = 0.25
"""Longest wait for output; then the time limit is looked at."""
_LONGEST_READ_BYTES = 1024
_READ_BESIDE_INPUT_S = 0.02
"""Time of a read while there is input, which waits for its turn meanwhile."""
_TRACEBACK_HEAD = "Traceback (most recent call last):"
_LOCATION = "  File "
_STOPPED = re.compile(r"The program was stopped \(\w+\)\.")
_CLOSING = re.compile(rf"{re.escape(_TRACEBACK_HEAD)}$|{_STOPPED.pattern}$")
_CLOSING_LINES = (_TRACEBACK_HEAD.encode(), b"The program was stopped (SystemExit).")


def run_program(
    transport: Transport,
    program: HubProgram,
    *,
    stdout: BinaryIO,
    stderr: TextIO,
    stdin: BinaryIO | TextIO | None = None,
    time_limit_s: float | None = None,
) -> int:
    """Start a program over a transport, connecting it if necessary, and wait until it ends.

    Args:
        transport: transport to the hub.
        program: from :func:`~brickhub.hub.program.run_program.load_program`.
        stdout: receives the program's output as it comes.
        stderr: receives the traceback, or the message that the program was stopped.
        stdin: input of the program, bytes, or text as if it were typed; read in a thread, and
            passed on as the hub accepts it.
        time_limit_s: seconds after which the program is stopped.

    Returns:
        Exit code: 1 if the program raised, `TIME_LIMIT_EXIT_CODE` if the time limit ended it, else
        0.

    Raises:
        ProgramError: the program is invalid or too large for the hub, or the time limit is invalid.
        HubError: the hub cannot be reached, or the link was lost.
    """
    check_time_limit(time_limit_s)
    transcript = Transcript(stdout, stderr)
    transport.start(program)
    pieces = _pieces_of(stdin)
    pending = b""
    read_s = _READ_S if stdin is None else _READ_BESIDE_INPUT_S
    deadline_s = None if time_limit_s is None else transport.now_s() + time_limit_s
    is_late = False
    try:
        while True:
            if deadline_s is not None and transport.now_s() >= deadline_s:
                # The program is stopped only once, and reading goes on until the end of its output.
                deadline_s = None
                is_late = True
                transport.stop()
            elif pending or not pieces.empty():
                pending = pending or pieces.get()
                # If the program does not read at present, the same piece is tried again later.
                with contextlib.suppress(HubBusyError):
                    transport.write(pending)
                    pending = b""
            transcript.feed(transport.read(read_s))
    # The transport raises this after the last output, however the program has ended.
    except ProgramStoppedError:
        if not is_late:
            exit_code = transcript.end()
            identity = getattr(transport, "identity", None)
            if exit_code and identity is not None and identity.kind.model.ran_pybricks_2:
                stderr.write(outdated_note(program))
            return exit_code
        transcript.end(is_stopped_by_us=True)
        stderr.write(time_limit_note(time_limit_s or 0.0))
        return TIME_LIMIT_EXIT_CODE


def _pieces_of(stream: BinaryIO | TextIO | None) -> queue.SimpleQueue[bytes]:
    """Pieces of standard input that fit a write, as a thread reads them."""
    pieces = queue.SimpleQueue[bytes]()
    if stream is None:
        return pieces
    # `read1` returns what is there, but a whole read would wait until somebody has finished typing.
    # A text stream has no `read1`, and gives lines.
    read = getattr(stream, "read1", stream.readline)

    def put_all() -> None:
        # The stream may be closed while this thread waits for it.
        with contextlib.suppress(OSError, ValueError):
            while data := as_typed(read(_LONGEST_READ_BYTES)):
                for start in range(0, len(data), WRITE_BYTES):
                    pieces.put(data[start : start + WRITE_BYTES])

    # What is in memory keeps nobody waiting; in a browser's tab there are no threads.
    if isinstance(stream, io.BytesIO | io.StringIO):
        put_all()
        return pieces
    # Nothing can wake a thread that waits for a keyboard, so it is a daemon.
    threading.Thread(
        target=put_all,
        name="standard input",
        daemon=True,
    ).start()
    return pieces


class Transcript:
    """Separator of a program's output from the firmware's closing message: a hub writes both to the
    same stream.

    A traceback that is followed by other output was printed by the program itself.
    """

    def __init__(
        self,
        stdout: BinaryIO,
        stderr: TextIO,
    ) -> None:
        self._stdout = stdout
        self._stderr = stderr
        self._line = b""
        self._pending: list[str] = []

    def feed(self, data: bytes) -> None:
        """Process further output of the hub."""
        # A hub's print ends lines with CR LF.
        text = (self._line + data).replace(b"\r\n", b"\n")
        *lines, self._line = text.split(b"\n")
        for line in lines:
            self._feed_line(line)
        # The beginning of a line may be a prompt for input, so it is printed at once.
        if not self._pending:
            printed = self._line[: _start_of_message(self._line)]
            self._print(printed)
            self._line = self._line[len(printed) :]

    def end(self, *, is_stopped_by_us: bool = False) -> int:
        """Flush at the end of the output; returns the exit code. ``is_stopped_by_us``: leave out
        that it was stopped."""
        if self._line:
            self._print_pending()
            self._print(self._line)
        # The firmware says a place after this line, so that alone it is the program's.
        if self._pending == [_TRACEBACK_HEAD]:
            self._print_pending()
        # Nothing came after these lines, so they are the firmware's and not the program's.
        for line in self._pending:
            if is_stopped_by_us and _STOPPED.fullmatch(line):
                continue
            self._stderr.write(f"{line}\n")
        return int(_TRACEBACK_HEAD in self._pending)

    def _feed_line(self, line: bytes) -> None:
        text = line.decode("utf-8", "replace")
        if self._pending and not self._continues_traceback(text):
            self._print_pending()
        closing = None if self._pending else _CLOSING.search(text)
        if closing is not None:
            # Output whose last line has not ended is in front of the firmware's message.
            self._print(line.removesuffix(closing[0].encode()))
            self._pending.append(closing[0])
        elif self._pending:
            self._pending.append(text)
        else:
            self._print(line + b"\n")

    def _continues_traceback(self, text: str) -> bool:
        """True if a line continues the pending traceback: locations, then the error."""
        if self._pending[0] != _TRACEBACK_HEAD:
            return False
        if len(self._pending) == 1:
            return text.startswith(_LOCATION)
        # A location is followed by another one, or by the error, which may be any text.
        return self._pending[-1].startswith(_LOCATION)

    def _print_pending(self) -> None:
        self._print("".join(f"{line}\n" for line in self._pending).encode())
        self._pending = []

    def _print(self, data: bytes) -> None:
        self._stdout.write(data)
        self._stdout.flush()


def _start_of_message(partial: bytes) -> int:
    """Place in the beginning of a line from which on it may be the firmware's message; its end if
    nowhere."""
    # A CR at the end may be the first half of a line end.
    text = partial.removesuffix(b"\r")
    for start in range(len(text)):
        if any(line.startswith(text[start:]) for line in _CLOSING_LINES):
            return start
    return len(text)
