"""What an observation vector holds: bounds of each entry, and which entries are angles that wrap around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase


@dataclass(frozen=True)
class ObservationLayout:
    """Bounds of each entry of an observation ``[n]``; ``wraps`` marks angles in degrees that run around from 360 to 0."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    wraps: tuple[bool, ...]

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.wraps):
            raise DescriptionError("an observation layout needs low, high and wraps of one length; give one value per entry")

    def __len__(self) -> int:
        return len(self.low)

    def to_dict(self) -> dict[str, list[Any]]:
        """Plain lists, fit for JSON and for a checkpoint."""
        return {"low": list(self.low), "high": list(self.high), "wraps": list(self.wraps)}

    @classmethod
    def from_dict(cls, data: dict[str, list[Any]]) -> ObservationLayout:
        """Inverse of `to_dict`."""
        return cls(tuple(data["low"]), tuple(data["high"]), tuple(data["wraps"]))


def layout_of(env: EnvBase) -> ObservationLayout:
    """The layout of ``env``'s entry "observation": from its task where it has one, else the bounds of its spec."""
    task = getattr(env, "task", None)
    if task is not None:
        entries = task.entries
        return ObservationLayout(*zip(*((e.low, e.high, e.wraps) for e in entries), strict=True))
    spec = env.observation_spec["observation"]
    n = int(spec.shape[-1])
    space = getattr(spec, "space", None)
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if low is None or high is None:
        return ObservationLayout((-math.inf,) * n, (math.inf,) * n, (False,) * n)
    return ObservationLayout(tuple(low.flatten().tolist()), tuple(high.flatten().tolist()), (False,) * n)
