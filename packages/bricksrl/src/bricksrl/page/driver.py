"""Driver by the sliders and the joystick of the page."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from brickhub.entry import Entry
from bricksrl.page.presses import is_finite
from bricksrl.teleoperation import push_action, rest_action

PUSH_TIMEOUT_S = 1.5
"""Time without a message of the page, which repeats the pushes, after which the robot rests, as the tab may be closed."""


class PageDriver:
    """Human at the page, as a driver of the rollout, called at each step in the thread that steps the robot.

    Args:
        commands: commands of the robot.
        in_charge: drive from the start.
    """

    def __init__(self, commands: Sequence[Entry], *, in_charge: bool = False) -> None:
        self.commands = tuple(commands)
        self.in_charge = in_charge
        self._rest = rest_action(self.commands)
        self._pushes = torch.zeros(len(self.commands))
        self._pushed_s = 0.0

    def push(self, values: Any) -> bool:
        """Set the pushes, a number in -1..1 per command; returns False if they are invalid."""
        if not isinstance(values, list) or len(values) != len(self.commands):
            return False
        if not all(map(is_finite, values)):
            return False
        self._pushes, self._pushed_s = torch.tensor(values, dtype=torch.float32).clamp(-1.0, 1.0), time.monotonic()
        return True

    def release(self) -> None:
        """Reset all pushes to 0."""
        self._pushes = torch.zeros(len(self.commands))

    @property
    def pushes(self) -> list[float]:
        """Present pushes; 0 if the page sent none for :data:`PUSH_TIMEOUT_S`."""
        if time.monotonic() - self._pushed_s > PUSH_TIMEOUT_S:
            self.release()
        return [round(value, 3) for value in self._pushes.tolist()]

    def __call__(self, observation: Tensor) -> Tensor | None:
        """Action ``[m]``; ``None`` while the policy is in charge."""
        return push_action(torch.tensor(self.pushes), self._rest) if self.in_charge else None

    def actions(self) -> list[float]:
        """Command values of the pushes, in the units of the commands."""
        values = push_action(torch.tensor(self.pushes), self._rest).tolist()
        return [
            (c.high + c.low) / 2 + (c.high - c.low) / 2 * value if math.isfinite(c.high - c.low) else value
            for c, value in zip(self.commands, values, strict=True)
        ]


def stick_map(commands: Sequence[Entry]) -> list[list[float]]:
    """Weights of the joystick's axes (right, forward) for each command: rows of two numbers.

    Commands of a left and a right side are driven like a tank; otherwise a turn, or the first one, follows the joystick sideways
    and the next one forward, and a single one forward.
    """
    sides = [1.0 if "left" in command.name else -1.0 if "right" in command.name else 0.0 for command in commands]
    if all(sides):
        # A leg or wheel with a range below zero moves forward with decreasing values.
        return [[side * _forward(command), _forward(command)] for side, command in zip(sides, commands, strict=True)]
    if len(commands) == 1:
        return [[0.0, 1.0]]
    sideways = next((index for index, command in enumerate(commands) if command.name.startswith("turn")), 0)
    forward = int(sideways == 0)
    return [[float(index == sideways), float(index == forward)] for index in range(len(commands))]


def _forward(command: Entry) -> float:
    return -1.0 if command.high <= 0.0 else 1.0
