"""``bricksrl settings``: settings of an agent, with values and meanings."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Annotated, Any

from tyro.conf import Positional

from brickhub.cli.options import Flag, option
from brickhub.cli.terminal import print_line


@dataclass(frozen=True)
class ShowSettings:
    """Show the settings of an agent: name, value and meaning; `bricksrl train --set NAME=VALUE` changes one.

    Examples:
      bricksrl settings sac
      bricksrl settings td3 --preset paper --json
      bricksrl settings my_agent.py
    """

    agent: Annotated[Positional[str], option(metavar="AGENT")]
    """Agent; `bricksrl list` shows them. One of your own: my_agent.py, my_agent.py:NAME or module:NAME."""
    preset: Annotated[str, option(metavar="NAME")] = "default"
    """Preset whose values are shown: default or paper."""
    json: Flag = False
    """Print one JSON object of names and values, for `bricksrl train --settings`, instead of a table."""

    def execute(self) -> None:
        from bricksrl.agents import preset

        settings = preset(self.preset, self.agent)
        if self.json:
            print_line(json.dumps(dataclasses.asdict(settings), indent=2))
            return
        from rich.console import Console
        from rich.table import Table

        table = Table("setting", "value", "meaning", box=None, pad_edge=False)
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
    for base in reversed(cls.__mro__[:-1]):
        fields = [param for param in parse_from_object(base).params if param.args[0] == "attribute"]
        docs |= {field.arg_name: " ".join((field.description or "").split()) for field in fields}
    return docs
