"""``bricksrl list``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from brickhub.cli.options import Flag
from brickhub.cli.terminal import print_line

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


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
        from bricksrl import agents, envs, robots
        from bricksrl.envs.arenas import ARENAS

        names: dict[str, Any] = {
            "environments": [_environment(envs.get_task(env_id), summary) for env_id, summary in envs.list_envs().items()],
            "arenas": list(ARENAS),
            "agents": list(agents.AGENTS),
            "presets": list(agents.PRESETS),
            "robots": sorted(robots.ROBOTS),
        }
        if self.json:
            print_line(json.dumps(names, indent=2))
        else:
            _print_table(names)


def _environment(task: Task, summary: str) -> dict[str, Any]:
    return {
        "id": task.id,
        "robot": task.robot.name,
        "observation": [entry.name for entry in task.entries],
        "action": [command.name for command in task.interface.commands],
        "max_steps": task.max_steps,
        "summary": summary,
    }


def _print_table(names: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Column, Table

    table = Table(Column("environment", no_wrap=True), "robot", "steps", "what to learn", box=None, pad_edge=False)
    for env in names["environments"]:
        table.add_row(env["id"], env["robot"], str(env["max_steps"]), env["summary"])
    console = Console()
    console.print(table)
    console.print()
    for kind in ("arenas", "agents", "presets", "robots"):
        console.print(f"{kind + ':':9}{', '.join(names[kind])}", highlight=False)
