"""The command ``bricktwin``."""

from __future__ import annotations

from brickhub.cli import start

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a hub program that failed, 2 for an error,
    130 for Ctrl-C."""
    return start("bricktwin.cli.command_table", arguments)
