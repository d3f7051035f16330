"""``python -m bricksrl``: the command ``bricksrl``."""

from __future__ import annotations

import sys

from bricksrl.cli import main

if __name__ == "__main__":
    sys.exit(main())
