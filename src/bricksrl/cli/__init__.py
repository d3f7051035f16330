"""The command ``bricksrl``.

Nothing here imports torch or MuJoCo before a command runs that needs them: help answers at once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a hub program that failed, 2 for an error, 130 for Ctrl-C."""
    os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # TorchRL's notes about its buffers are not for our users
    try:
        from bricksrl.cli.app import run

        return run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        from bricksrl.cli.console import INTERRUPTED, print_interrupted

        print_interrupted("nothing was saved")
        return INTERRUPTED
