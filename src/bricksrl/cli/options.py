"""Annotations of command-line options, for all commands."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from tyro.conf import arg


def _default(value: str) -> str:
    """Text of a default in the help; empty for None, False and empty values."""
    return "" if value in ("None", "False", "") else f"(default: {value})"


option = partial(arg, help_behavior_hint=_default)
"""Annotation of an option: its name and the placeholder of its value, as tyro's ``arg``."""
Flag = Annotated[bool, option()]
"""An option without a value."""
PageFlag = Annotated[bool, option(help="Show it live in the browser: the robot in 3D, curves, buttons, and sliders to drive it.")]
"""``--page``."""
