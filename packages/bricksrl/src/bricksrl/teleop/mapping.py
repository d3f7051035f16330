"""Mapping of keys and sticks to the action of any robot.

A released stick means that no motor moves, which is not the middle of every command's range: the Walker's legs turn by
-100 to 0 degrees. Fully up is the upper end of a command, fully down the lower one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from brickhub.entry import Entry

KEY_PAIRS = (("q", "a"), ("w", "s"), ("e", "d"), ("r", "f"), ("t", "g"), ("y", "h"))
"""Keys of each command in order: the key that raises it, and the key below that lowers it."""


def rest_action(commands: Sequence[Entry]) -> Tensor:
    """Action ``[m]`` that moves nothing, or as little as possible; 0 for a command of unknown range."""
    values = []
    for command in commands:
        low, high = command.low, command.high
        if not math.isfinite(high - low) or low == high:
            values.append(0.0)
        else:
            values.append(min(max(-(high + low) / (high - low), -1.0), 1.0))
    return torch.tensor(values)


def push_action(pushes: Tensor, at_rest: Tensor) -> Tensor:
    """Action for pushes ``[m]`` from -1 (fully down) over 0 (released) to 1 (fully up)."""
    pushes = pushes.clamp(-1.0, 1.0)
    return at_rest + pushes.clamp(min=0.0) * (1.0 - at_rest) + pushes.clamp(max=0.0) * (1.0 + at_rest)


def legend(commands: Sequence[Entry]) -> list[str]:
    """Keys and their functions, one line each."""
    lines = [f"{up} / {down}    {command.name} up / down" for command, (up, down) in zip(commands, KEY_PAIRS, strict=False)]
    return [*lines, "space    take over, or give back", "Ctrl-C   end"]


class Paced:
    """Driver that limits a simulation to ``rate_hz`` steps per second, so that a human can follow."""

    def __init__(self, driver: Callable[[Tensor], Tensor | None], rate_hz: float) -> None:
        self._driver = driver
        self._period_s = 1.0 / rate_hz
        self._due_s = time.monotonic()

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Wait for the next period, then call the driver."""
        self._due_s = max(self._due_s + self._period_s, time.monotonic())
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        return self._driver(observation)
