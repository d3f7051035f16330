"""``python -m bricktwin``: the command ``bricktwin``."""

from __future__ import annotations

import sys

from bricktwin.cli import main

if __name__ == "__main__":
    sys.exit(main())
