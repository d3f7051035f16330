"""``python -m bricktwin``: the command ``bricktwin``."""

import sys

from bricktwin.cli import main

if __name__ == "__main__":
    sys.exit(main())
