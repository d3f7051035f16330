"""Pushes: how far a human pushes each command of a robot, as actions. A released stick means that no motor moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

from brickhub.entry import Entry


def at_rest(commands: Sequence[Entry]) -> list[float]:
    """Action ``[m]`` that moves nothing, or as little as possible; 0 for a command of unknown range."""
    spans = [(command.high + command.low, command.high - command.low) for command in commands]
    return [min(max(-double / span, -1.0), 1.0) if math.isfinite(span) and span else 0.0 for double, span in spans]


def pushed(pushes: Sequence[float], rest: Sequence[float]) -> list[float]:
    """Action ``[m]`` for pushes from -1 (fully down) over 0 (released, the action ``rest``) to 1 (fully up)."""
    ways = zip((min(max(push, -1.0), 1.0) for push in pushes), rest, strict=True)
    return [still + (push * (1.0 - still) if push > 0.0 else push * (1.0 + still)) for push, still in ways]
