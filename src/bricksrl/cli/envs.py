"""``bricksrl list``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from bricksrl.cli.options import Flag
from bricksrl.cli.terminal import print_line


@dataclass(frozen=True)
class List:
    """List the environments, arenas (several robots in one world), agents, presets and robots.

    The JSON object also names the entries of each observation and action.

    Examples:
      bricksrl list
      bricksrl list --json
    """

    json: Flag = False
    """Print one JSON object instead of a table."""

    def execute(self) -> None:
        names = _collect()
        if self.json:
            print_line(json.dumps(names, indent=2))
        else:
            _print_table(names)


def _collect() -> dict[str, Any]:
    from bricksrl import agents, envs, robots
    from bricksrl.envs.arenas import ARENAS

    summaries = envs.list_envs()
    tasks = [envs.get_task(env_id) for env_id in summaries]
    return {
        "environments": [
            {
                "id": task.id,
                "robot": task.robot.name,
                "observation": [entry.name for entry in task.entries],
                "action": [command.name for command in task.interface.commands],
                "max_steps": task.max_steps,
                "summary": summaries[task.id],
            }
            for task in tasks
        ],
        "arenas": list(ARENAS),
        "agents": list(agents.AGENTS),
        "presets": list(agents.PRESETS),
        "robots": sorted(robots.ROBOTS),
    }


def _print_table(names: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("environment", "robot", "steps", "what to learn", box=None, pad_edge=False)
    for env in names["environments"]:
        table.add_row(env["id"], env["robot"], str(env["max_steps"]), env["summary"])
    console = Console()
    console.print(table)
    console.print()
    for kind in ("arenas", "agents", "presets", "robots"):
        console.print(f"{kind + ':':9}{', '.join(names[kind])}", highlight=False)
