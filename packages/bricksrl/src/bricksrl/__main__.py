"""``python -m bricksrl``: the command ``bricksrl``."""

import sys

from bricksrl.cli import main

if __name__ == "__main__":
    sys.exit(main())
