"""Flags of a robot and its world, shared by the commands that make an environment."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import UseAppendAction, arg

from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.envs.options import EnvOptions


@dataclass(frozen=True, kw_only=True)
class RobotFlags:
    """How a robot is reached and what its world is, as on the command line."""

    hub: Annotated[str, arg(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble or usb; ble:NAME, ble:ADDRESS or usb:PORT where there are several."""
    streaming: bool = False
    """Have the hub send observations 100 times a second, and take the latest command: steps then last their own time only."""
    app_data: bool = False
    """Speak to the program over AppData, where a new command replaces an old one, instead of its standard input."""
    realtime: bool = False
    """Let a virtual robot take as long as a real one; always so with a human at the keys."""
    randomize: bool = False
    """Draw another physics of the virtual robot (battery, friction, masses, noise, link) for each episode."""
    physics: Annotated[Path | None, arg(metavar="FILE")] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes."""
    option: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE")] = ()
    """Option of the environment's task, as often as needed: sparse=true, threshold_deg=20, calibration=red.json."""

    def env_options(self) -> EnvOptions:
        """Options of the environment that the flags stand for."""
        from bricksrl.envs.options import EnvOptions
        from bricksrl.twin.physics import read_physics

        return EnvOptions(
            hub=self.hub,
            streaming=self.streaming,
            app_data=self.app_data,
            realtime=self.realtime,
            randomize=self.randomize,
            physics=None if self.physics is None else read_physics(self.physics),
            options=dict(map(parse_option, self.option)),
        )


def parse_option(text: str) -> tuple[str, Any]:
    """``NAME=VALUE`` as a name and a number, true or false, or else a text.

    Raises:
        DescriptionError: there is no value.
    """
    name, equals, value = text.partition("=")
    if not (name.isidentifier() and equals):
        raise DescriptionError(f"'{text}' is no option; give NAME=VALUE, such as sparse=true")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):
        return name, value
