"""Terminal: results on standard output, all other lines and questions on standard error."""

import json
import os
import queue
import select
import sys
import threading
from collections.abc import Iterable, Sequence
from typing import TextIO

from brickhub.finding import Finding, Outcome


class Interrupted(Exception):
    """Ctrl-C or a stop, which ends the command. The message says what is saved; without one,
    nothing is printed."""


def print_line(line: str = "") -> None:
    """Print a line of results, flushed even into a pipe."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def print_error(message: str) -> None:
    """Print ``error: ...`` as one line, with the line breaks of the message removed."""
    sys.stderr.write(f"error: {' '.join(message.split())}\n")


def print_note(line: str) -> None:
    """Print a line for the user, apart from the results."""
    sys.stderr.write(f"{line}\n")


def print_findings(
    findings: Iterable[Finding],
    widths: tuple[int, int],
    *,
    as_json: bool = False,
    **about: str,
) -> int:
    """Print each finding as it is made, in columns of these ``widths``, or all as one JSON object
    with the names and values in ``about``. Returns the exit code: 1 if a finding is an error, else
    0."""
    outcome_width, name_width = widths
    found = []
    for finding in findings:
        found.append(finding)
        # Each line is printed at once, because the next check may take long or need the person who
        # reads this.
        if not as_json:
            outcome = f"{finding.outcome.value:{outcome_width}}"
            print_line(f"{outcome}{finding.name:{name_width}}{finding.detail}")
    failed = any(finding.outcome is Outcome.ERROR for finding in found)
    if as_json:
        dicts = [finding.to_dict() for finding in found]
        print_line(json.dumps({**about, "ok": not failed, "findings": dicts}))
    return int(failed)


def is_terminal() -> bool:
    """Whether the user can be asked a question."""
    # A closed stream cannot even be asked.
    is_open = sys.stdin is not None and not sys.stdin.closed
    return is_open and sys.stdin.isatty() and sys.stderr.isatty()


_PIPE_S = 2.0
"""Time within which an answer has to be in a pipe: nobody types into it, and one without a writer
would wait for ever."""
_LONGEST_ANSWER = 100
"""Bytes after which what a pipe sends is taken for no answer any more."""


def confirm(question: str) -> bool:
    """Whether the answer to a question is yes; False for Enter, and where nobody answers."""
    return bool(ask(question, default=False))


def ask(question: str, *, default: bool | None = None) -> bool | None:
    """Ask a question on standard error, and again after an answer that is neither yes nor no.

    Args:
        question: what is asked.
        default: what Enter says; ``None``: nothing, so the question is asked again.

    Returns:
        Whether the answer is yes; ``None`` at the end of the input, or if nothing can be asked.
    """
    choices = {None: "y/n", True: "Y/n, Enter is yes", False: "y/N, Enter is no"}[default]
    while True:
        if is_terminal():
            sys.stderr.write(f"{question} [{choices}] ")
            sys.stderr.flush()
        line = _answer()
        if line is None:
            return None
        answer = line.strip().lower()
        if answer in ("y", "yes"):
            return True
        if answer in ("n", "no"):
            return False
        if not answer and default is not None:
            return default
        fault = f"'{answer[:20]}' is neither y nor n; " if answer else ""
        print_note(f"{fault}type y for yes, n for no")


def choose(
    question: str,
    choices: Sequence[str],
    default: str,
) -> str:
    """Ask for one of some names on standard error, and again after an answer that is none of them;
    the default for Enter, at the end of the input, and where nothing can be asked."""
    if not is_terminal():
        return default
    while True:
        sys.stderr.write(f"{question} [{'/'.join(choices)}, Enter is {default}] ")
        sys.stderr.flush()
        line = _answer()
        answer = (line or "").strip().lower()
        if not answer:
            return default
        if answer in choices:
            return answer
        print_note(f"'{answer[:20]}' is none of them; type one of {', '.join(choices)}")


def _answer() -> str | None:
    """A line of standard input, of a terminal or out of a pipe; ``None`` if there is no more."""
    stream = sys.stdin
    if stream is None:
        return None
    if is_terminal():
        return stream.readline() or None
    # Text in memory and closed streams have no file behind them.
    try:
        handle = stream.fileno()
    except (OSError, ValueError):
        return _line_of_memory(stream)
    line = b""
    while len(line) < _LONGEST_ANSWER and not line.endswith(b"\n"):
        # Bytes are read one by one, because nobody can wait for those that a buffer has already
        # taken.
        byte = _next_byte(handle)
        if not byte:
            break
        line += byte
    return line.decode("utf-8", "replace") or None


def _line_of_memory(stream: TextIO) -> str | None:
    """A line of a stream without a file; ``None`` if there is none, or it cannot be read."""
    try:
        return stream.readline() or None
    except (OSError, ValueError):
        return None


def _next_byte(handle: int) -> bytes:
    """The next byte of a pipe or file; ``b""`` at its end, or if none comes within a short time."""
    # Windows can wait for sockets only, not for files.
    if sys.platform == "win32":
        return b"" if os.isatty(handle) else _byte_of_thread(handle)
    readable, _, _ = select.select([handle], [], [], _PIPE_S)
    return os.read(handle, 1) if readable else b""


def _byte_of_thread(handle: int) -> bytes:
    """The next byte, as by `_next_byte`, but read in a thread, which is left behind if nothing
    comes."""
    read: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def read_one() -> None:
        try:
            read.put(os.read(handle, 1))
        except OSError:
            read.put(b"")

    # The thread may wait for ever, and as a daemon it does not keep the process from ending.
    threading.Thread(
        target=read_one,
        name="answer",
        daemon=True,
    ).start()
    try:
        return read.get(timeout=_PIPE_S)
    except queue.Empty:
        return b""
