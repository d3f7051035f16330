"""The robot of a command: its name or file, and flags of its connection and physics."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, UseAppendAction

from brickhub.cli.options import Flag, option
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.envs.options import EnvOptions


@dataclass(frozen=True, kw_only=True)
class RobotFlags:
    """Flags of the robot's connection and physics."""

    hub: Annotated[str, option(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble or usb; ble:NAME, ble:ADDRESS or usb:PORT if there are several."""
    streaming: Flag = False
    """Let the hub stream observations at 100 Hz and apply the latest command, so that steps do not wait for the link."""
    app_data: Flag = False
    """Send commands over AppData, where a new command replaces an unread one, instead of standard input."""
    realtime: Flag = False
    """Run a virtual robot in real time; always on while a human drives."""
    randomize: Flag = False
    """Draw the physics of the virtual robot (battery, friction, masses, noise, link) anew for each episode."""
    physics: Annotated[Path | None, option(metavar="FILE")] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes."""
    task_options: Annotated[UseAppendAction[tuple[str, ...]], option(name="option", metavar="NAME=VALUE")] = ()
    """Option of the environment's task, such as sparse=true, threshold_deg=20 or calibration=red.json. May be repeated."""

    def env_options(self) -> EnvOptions:
        """The flags as options of an environment."""
        from bricksrl.envs.options import EnvOptions
        from bricktwin.twin.physics import read_physics

        return EnvOptions(
            hub=self.hub,
            streaming=self.streaming,
            app_data=self.app_data,
            realtime=self.realtime,
            randomize=self.randomize,
            physics=None if self.physics is None else read_physics(self.physics),
            options=dict(map(parse_option, self.task_options)),
        )


RobotGroup = Annotated[RobotFlags, OmitArgPrefixes]
"""Robot flags of a command, as a separate group in the help."""


def parse_option(text: str) -> tuple[str, Any]:
    """Parse ``NAME=VALUE`` into the name and the value: JSON, or else a string. Raises DescriptionError if the text has no name
    or no ``=``."""
    name, equals, value = text.partition("=")
    if not (name.isidentifier() and equals):
        raise DescriptionError(f"'{text}' is not an option; give NAME=VALUE, such as sparse=true")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):
        return name, value
