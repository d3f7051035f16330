"""``bricksrl check``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import option
from brickhub.cli.terminal import print_findings
from bricksrl.cli.terminal import load_learning


@dataclass(frozen=True)
class Check:
    """Check an environment or an agent, built-in or your own.

    Checks of an environment: description, functions, hub program, specs, reset, determinism, twin. Checks of an agent, in a small
    simulation: settings, build, acting, memory, learning, saving, copies. One line per check; exit code 1 if any failed.

    Examples:
      bricksrl check RunAway-v0
      bricksrl check my_task.py
      bricksrl check my_package.tasks:MY_TASK
      bricksrl check my_agent.py
    """

    what: Annotated[Positional[str], option(metavar="ENV|AGENT")]
    """Environment or agent; `bricksrl list` shows them. Your own: my_task.py, my_task.py:TASK, module:TASK, my_agent.py."""

    def execute(self) -> int:
        from bricksrl.envs.env_checker import check_env

        load_learning()
        from bricksrl.evaluation.agent_checker import check_agent, is_agent

        return print_findings(check_agent(self.what) if is_agent(self.what) else check_env(self.what), (8, 13))
