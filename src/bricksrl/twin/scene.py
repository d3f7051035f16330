"""What stands around a virtual robot, and how it is placed at the start of an episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from bricksrl.errors import TwinError
from bricksrl.twin.senses import Reading

_MOST_HEADING_AT_WALL_DEG = 60.0


@dataclass(frozen=True)
class Scene:
    """An even floor, and maybe a wall ahead of the robot.

    Attributes:
        wall_distance_mm: lowest and highest distance from the ultrasonic sensor to the wall at the start, drawn
            uniformly; ``None`` for an open floor.
        heading_deg: lowest and highest heading at the start, drawn uniformly, clockwise positive; 0 looks straight at
            the wall.
        ball: a red ball in the gripper, for robots that have one.
        readings: for a robot that has no MuJoCo model: what its sensors sense, as a function of the angles of its motors (deg at
            the output, by the motor's name). The name of a sensor, such as ``"light"``, stands for the first thing that it
            senses, ``"light.ambient"`` for another one; see ``twin/senses.py``.

    Raises:
        TwinError: at construction, when the robot cannot be placed so.
    """

    wall_distance_mm: tuple[float, float] | None = None
    heading_deg: tuple[float, float] = (0.0, 0.0)
    ball: bool = False
    readings: Mapping[str, Reading] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        _check_range("heading_deg", self.heading_deg, -180.0, 180.0)
        if self.wall_distance_mm is not None:
            _check_range("wall_distance_mm", self.wall_distance_mm, 20.0, 5000.0)
            _check_range("heading_deg before a wall", self.heading_deg, -_MOST_HEADING_AT_WALL_DEG, _MOST_HEADING_AT_WALL_DEG)


def _check_range(name: str, bounds: tuple[float, float], lowest: float, highest: float) -> None:
    low, high = bounds
    if not (math.isfinite(low) and math.isfinite(high) and lowest <= low <= high <= highest):
        raise TwinError(f"scene: {name} is {bounds}; give (low, high) within {lowest:g} to {highest:g}")


OPEN_FLOOR = Scene()
