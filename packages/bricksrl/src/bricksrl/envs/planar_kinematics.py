"""Parameters of a kinematic simulation, without torch, so that the registry imports none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bricksrl.errors import DescriptionError


@dataclass(frozen=True)
class Kinematics:
    """Kinematic model: each commanded motor turns by its command plus noise. Raises DescriptionError if the noise is negative, or
    ``noise_on`` or ``motion`` is unknown.

    Attributes:
        noise: standard deviation of the normal noise on each normalised action, before it is mapped to degrees.
        noise_on: ``"action"``, or ``"state"`` for the same noise, in the same degrees, on the angle after the move.
        motion: ``"instant"``: a motor reaches its target before the next command. ``"firmware"``: it follows the firmware's
            trajectory for the task's step time and carries its speed over into the next command.
    """

    noise: float
    noise_on: Literal["action", "state"] = "action"
    motion: Literal["instant", "firmware"] = "instant"

    def __post_init__(self) -> None:
        if self.noise < 0 or self.noise_on not in ("action", "state"):
            raise DescriptionError(f"kinematics: noise {self.noise} on '{self.noise_on}'; give 0 or more, on 'action' or 'state'")
        if self.motion not in ("instant", "firmware"):
            raise DescriptionError(f"kinematics: there is no motion '{self.motion}'; choose 'instant' or 'firmware'")
