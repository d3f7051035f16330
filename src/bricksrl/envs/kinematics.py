"""How a task is simulated without a robot; the numbers only, so that naming environments needs no torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class Kinematics:
    """Each commanded motor turns by its command, at once, with some noise.

    Attributes:
        noise: standard deviation of the normal noise on each normalised action, before it is mapped to degrees.
        noise_on: ``"action"``, or ``"state"`` for the same noise, in the same degrees, on the angle after the move.

    Raises:
        DescriptionError: the noise is negative, or on neither.
    """

    noise: float
    noise_on: Literal["action", "state"] = "action"

    def __post_init__(self) -> None:
        if self.noise < 0 or self.noise_on not in ("action", "state"):
            raise DescriptionError(f"kinematics: noise {self.noise} on '{self.noise_on}'; give 0 or more, on 'action' or 'state'")
