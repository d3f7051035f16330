"""Job of a start page: a command of ``bricksrl`` that ends when the page asks for it, or is gone.

``python -m bricksrl.cli.job play Walker-v1 --page``; the page holds standard input open.
"""

import sys

from brickhub.cli.ending import end_with_parent


def main() -> int:
    """Run the command of the arguments, until the page closes standard input at the latest."""
    from bricksrl.cli import main as run

    end_with_parent()
    return run()


if __name__ == "__main__":
    sys.exit(main())
