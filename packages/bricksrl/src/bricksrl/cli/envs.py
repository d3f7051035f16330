"""Environments, agents and settings: ``bricksrl list``, ``settings`` and ``check``."""

import dataclasses
import json
from dataclasses import dataclass
from typing import Annotated, Any

from rich.console import Console
from rich.table import Column, Table
from tyro.conf import Positional

from brickhub.cli.terminal import print_findings, print_line
from brickhub.options import Existing, Flag, SavesNothing, option
from brickhub.user_files import check_there, is_reference
from bricksrl import agents, envs, robots
from bricksrl.cli.terminal import load_learning
from bricksrl.envs.arenas import ARENAS
from bricksrl.envs.task import Task
from bricksrl.training.config import settings_for


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
        described = []
        for env_id, summary in envs.list_envs().items():
            described.append(_environment(envs.get_task(env_id), summary))
        names: dict[str, Any] = {
            "environments": described,
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


_WIDE = 60
"""Width of a console from which on there is room for all columns."""


def _print_table(names: dict[str, Any]) -> None:
    console = Console()
    is_wide = console.width >= _WIDE
    # Names are to be typed, and must not be broken over lines, however narrow the terminal is.
    columns: list[Column | str] = [Column("environment", no_wrap=True)]
    if is_wide:
        columns += ["robot", "steps"]
    columns.append("what to learn")
    table = Table(*columns, box=None, pad_edge=False)
    for env in names["environments"]:
        cells = [env["id"]]
        if is_wide:
            cells += [env["robot"], str(env["max_steps"])]
        table.add_row(*cells, env["summary"])
    console.print(table)
    console.print()
    for kind in ("arenas", "agents", "presets", "robots"):
        console.print(f"{kind + ':':9}{', '.join(names[kind])}", highlight=False)


@dataclass(frozen=True)
class ShowSettings:
    """Show the settings of an agent: name, value and meaning; `bricksrl train --set NAME=VALUE`
    changes one.

    Examples:
      bricksrl settings sac
      bricksrl settings td3 --preset paper --json
      bricksrl settings sac --env Walker-v2
      bricksrl settings my_agent.py
    """

    agent: Annotated[Positional[str], option(metavar="AGENT"), Existing(check_there)]
    """Agent; `bricksrl list` shows them. One of your own: my_agent.py, my_agent.py:NAME or
    module:NAME."""
    preset: Annotated[str, option(metavar="NAME")] = "default"
    """Preset whose values are shown: default or paper."""
    env: Annotated[str | None, option(metavar="ENV"), Existing(check_there)] = None
    """Environment: a task may have values of its own, and one with a camera has others."""
    json: Flag = False
    """Print one JSON object of names and values, for `bricksrl train --settings`, instead of a
    table."""

    def execute(self) -> None:
        # It raises if there is none, which `settings_for` takes for an environment of a user's.
        if self.env is not None:
            envs.get_task(self.env)
        settings = settings_for(self.env or "", self.preset, self.agent)
        if self.json:
            print_line(json.dumps(dataclasses.asdict(settings), indent=2))
            return

        table = Table(
            "setting",
            "value",
            "meaning",
            box=None,
            pad_edge=False,
        )
        meanings = field_docs(type(settings))
        for field in dataclasses.fields(settings):
            value = getattr(settings, field.name)
            text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
            table.add_row(field.name, text or "-", meanings.get(field.name, ""))
        Console().print(table)


def field_docs(cls: type[Any]) -> dict[str, str]:
    """Docstrings of a dataclass's fields, by name, including those of its bases."""
    from docstring_parser import parse_from_object

    docs: dict[str, str] = {}
    # From the base to the class, whose own words on a field count.
    for base in reversed(cls.__mro__[:-1]):
        for parameter in parse_from_object(base).params:
            if parameter.args[0] == "attribute":
                words = (parameter.description or "").split()
                docs[parameter.arg_name] = " ".join(words)
    return docs


@dataclass(frozen=True)
class Check(SavesNothing):
    """Check an environment or an agent, built-in or your own.

    Checks of an environment: description, functions, hub program, specs, reset, determinism, twin.
    Checks of an agent, in a small simulation: settings, build, acting, memory, learning, saving,
    copies. One line per check; exit code 1 if any failed.

    Examples:
      bricksrl check RunAway-v0
      bricksrl check my_task.py
      bricksrl check my_package.tasks:MY_TASK
      bricksrl check my_agent.py
    """

    what: Annotated[Positional[str], option(metavar="ENV|AGENT"), Existing(check_there)]
    """Environment or agent; `bricksrl list` shows them. Your own: my_task.py, my_task.py:TASK,
    module:TASK, my_agent.py."""

    def execute(self) -> int:
        # It raises if there is none, before anything slow is imported.
        if not is_reference(self.what) and self.what not in agents.AGENTS:
            envs.get_task(self.what)
        load_learning()
        from bricksrl.envs.env_checker import check_env
        from bricksrl.evaluation.agent_checker import check_agent, is_agent

        check = check_agent if is_agent(self.what) else check_env
        return print_findings(check(self.what), (8, 13))
