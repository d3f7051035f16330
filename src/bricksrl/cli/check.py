"""``bricksrl check``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.console import print_line
from bricksrl.cli.loading import load_learning


@dataclass(frozen=True)
class Check:
    """Check an environment, ours or your own: description, functions, hub program, specs, reset, determinism, twin.

    One line a check; exit code 1 when one failed.

    Examples:
      bricksrl check RunAway-v0
      bricksrl check my_task.py
      bricksrl check my_package.tasks:MY_TASK
    """

    env: Annotated[Positional[str], arg(metavar="ENV")]
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or module:TASK."""

    def execute(self) -> int:
        """Check and print."""
        from bricksrl.envs.check import Outcome, check_env

        load_learning()
        code = 0
        for check in check_env(self.env):
            print_line(f"{check.outcome.value:8}{check.name:13}{check.detail}")
            code = 1 if check.outcome is Outcome.FAILED else code
        return code
