"""Options of commands that learn: environment, live page, the default folder of a run."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import option

PageFlag = Annotated[bool, option(help="Show it live in the browser: the robot in 3D, curves, buttons, and sliders to drive it.")]
"""``--page``."""
EnvArgument = Annotated[Positional[str], option(metavar="ENV", help="Environment; `bricksrl list` shows them.")]
"""Positional argument ``ENV``."""


def run_folder(named: Path | None, env: str, agent: str, seed: int) -> Path:
    """The folder that the user has named for a run; by default one with the run's and the time's name."""
    from bricksrl.training.run_folder import file_name

    time = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    return named or Path("runs") / f"{file_name(env)}-{file_name(agent)}-{seed}-{time}"
