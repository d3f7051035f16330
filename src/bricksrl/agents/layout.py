"""What an observation vector holds: bounds of each entry, and which entries are angles that wrap around."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.task import Entry


@dataclass(frozen=True)
class ObservationLayout:
    """Bounds of each entry of an observation ``[n]``; ``wraps`` marks angles in degrees that run around from 360 to 0.

    ``goals`` are pairs of places: of a goal, and of the entry that is to reach it.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    wraps: tuple[bool, ...]
    goals: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.wraps):
            raise DescriptionError("an observation layout needs low, high and wraps of one length; give one value per entry")

    def __len__(self) -> int:
        return len(self.low)

    def to_dict(self) -> dict[str, list[Any]]:
        """Plain lists, fit for JSON and for a checkpoint."""
        goals = [list(pair) for pair in self.goals]
        return {"low": list(self.low), "high": list(self.high), "wraps": list(self.wraps), "goals": goals}

    @classmethod
    def from_dict(cls, data: dict[str, list[Any]]) -> ObservationLayout:
        """Inverse of `to_dict`."""
        goals = tuple((goal, reached) for goal, reached in data["goals"])
        return cls(tuple(data["low"]), tuple(data["high"]), tuple(data["wraps"]), goals)


def _goals(entries: tuple[Entry, ...]) -> tuple[tuple[int, int], ...]:
    """Each entry ``X_goal`` with the entry ``X_angle`` of the same kind, where every goal has one."""
    places = {entry.name: place for place, entry in enumerate(entries)}
    goals = [place for name, place in places.items() if name.endswith("_goal")]
    pairs = [(goal, places.get(entries[goal].name.removesuffix("_goal") + "_angle")) for goal in goals]
    found = tuple((goal, reached) for goal, reached in pairs if reached is not None)
    alike = all(entries[goal].wraps == entries[reached].wraps for goal, reached in found)
    return found if alike and len(found) == len(goals) else ()


def layout_of(env: EnvBase) -> ObservationLayout:
    """The layout of ``env``'s entry "observation": from its task where it has one, else the bounds of its spec."""
    task = getattr(env, "task", None)
    if task is not None:
        entries = task.entries
        bounds = tuple(e.low for e in entries), tuple(e.high for e in entries)
        return ObservationLayout(*bounds, tuple(e.wraps for e in entries), _goals(entries))
    spec = env.observation_spec["observation"]
    n = int(spec.shape[-1])
    space = getattr(spec, "space", None)
    low, high = getattr(space, "low", None), getattr(space, "high", None)
    if low is None or high is None:
        return ObservationLayout((-math.inf,) * n, (math.inf,) * n, (False,) * n)
    return ObservationLayout(tuple(low.flatten().tolist()), tuple(high.flatten().tolist()), (False,) * n)
