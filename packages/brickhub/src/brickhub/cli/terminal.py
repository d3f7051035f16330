"""Terminal: results on standard output, all other lines and questions on standard error; uninterrupted slow imports."""

from __future__ import annotations

import importlib
import json
import signal
import sys
from collections.abc import Iterable
from types import FrameType
from typing import TYPE_CHECKING

from brickhub.errors import RunError

if TYPE_CHECKING:
    import numpy as np

    from brickhub.finding import Finding

_SLOW_IMPORTS = ("torch", "torchrl.data", "torchrl.envs")


class Interrupted(Exception):
    """Ctrl-C or a stop, which ends the command. The message says what is saved; without one, nothing is printed."""


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


def print_findings(findings: Iterable[Finding], widths: tuple[int, int], *, as_json: bool = False, **about: str) -> int:
    """Print each finding as it is made, in columns of these ``widths``, or all as one JSON object with the names and values in
    ``about``. Returns the exit code: 1 if a finding is an error, else 0."""
    from brickhub.finding import Outcome

    found = []
    for finding in findings:
        found.append(finding)
        if not as_json:
            print_line(f"{finding.outcome.value:{widths[0]}}{finding.name:{widths[1]}}{finding.detail}")
    failed = any(finding.outcome is Outcome.ERROR for finding in found)
    if as_json:
        print_line(json.dumps({**about, "ok": not failed, "findings": [finding.to_dict() for finding in found]}))
    return int(failed)


def is_terminal() -> bool:
    """Whether the user can be asked a question."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def confirm(question: str) -> bool:
    """Ask a question on standard error; True if the answer is yes, False without a terminal."""
    if not is_terminal():
        return False
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def place_robot(_rng: np.random.Generator | None = None) -> None:
    """Ask the user to put a real robot at the start, and wait for Enter. Raises RunError if standard input has ended."""
    sys.stderr.write("put the robot where an episode starts, then press Enter ")
    sys.stderr.flush()
    if not (sys.stdin and sys.stdin.readline()):
        sys.stderr.write("\n")
        raise RunError("nobody can be asked to place the robot: standard input is not a terminal; start this in one")


def load_learning() -> None:
    """Import torch and TorchRL; a Ctrl-C meanwhile is raised afterwards, because these modules may ignore it."""
    from bricktwin.twin.make_body import check_mujoco

    interrupted = False

    def remember(_signum: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    previous_handler = signal.signal(signal.SIGINT, remember)
    try:
        check_mujoco()
        for name in _SLOW_IMPORTS:
            importlib.import_module(name)
            if interrupted:
                break
    finally:
        signal.signal(signal.SIGINT, previous_handler)
    if interrupted:
        raise KeyboardInterrupt
