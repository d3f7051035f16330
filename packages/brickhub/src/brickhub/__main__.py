"""``python -m brickhub``: the command ``brickhub``."""

import sys

from brickhub.cli import main

if __name__ == "__main__":
    sys.exit(main())
