"""Terminal: results on standard output, all other lines and questions on standard error."""

import json
import sys
from collections.abc import Iterable

from brickhub.finding import Finding, Outcome


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
