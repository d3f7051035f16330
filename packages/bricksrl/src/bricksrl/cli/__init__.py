"""The command ``bricksrl``.

torch and MuJoCo are imported only by commands that need them, so that help is printed at once.
"""

from __future__ import annotations

import os

from brickhub.cli import start

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a hub program that failed, 2 for an error,
    130 for Ctrl-C."""
    os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # hide TorchRL's notes about its buffers
    return start("bricksrl.cli.app", arguments)
