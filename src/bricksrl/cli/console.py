"""Writing to the terminal: results on standard output, all else on standard error, a line each."""

from __future__ import annotations

import sys

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def print_line(line: str = "") -> None:
    """A line of results, at once even into a pipe."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def print_error(message: str) -> None:
    """``error: ...`` in one line, whatever the message holds."""
    sys.stderr.write(f"error: {' '.join(message.split())}\n")


def print_note(line: str) -> None:
    """A line for the human, beside the results."""
    sys.stderr.write(f"{line}\n")


def print_interrupted(saved: str) -> None:
    """What Ctrl-C left."""
    sys.stderr.write(f"interrupted: {saved}\n")
