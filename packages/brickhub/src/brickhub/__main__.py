"""``python -m brickhub``: the command ``brickhub``."""

from __future__ import annotations

import sys

from brickhub.cli import main

if __name__ == "__main__":
    sys.exit(main())
