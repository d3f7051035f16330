"""Starts of robots: none is inside of an obstacle."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator

import mujoco

from brickhub.errors import TwinError
from bricktwin.twin.models.mjcf import FLOOR_GROUP, OBSTACLE_GROUP
from bricktwin.twin.objects import Solid
from bricktwin.twin.scene import Scene

_DEPTH_M = 0.008
"""Depth from which on an overlap is more than a touch."""


def ends_of_ranges(count: int) -> Iterator[Callable[[float, float], float]]:
    """Functions that choose one end of each of so many ranges, in all combinations."""
    for ends in itertools.product((False, True), repeat=count):
        yield functools.partial(_end, iter(ends))


def _end(ends: Iterator[bool], low: float, high: float) -> float:
    return high if next(ends) else low


def refuse_overlap(model: mujoco.MjModel, data: mujoco.MjData, scene: Scene | None = None) -> None:
    """Raise TwinError if a robot is inside of an obstacle of the ``scene``, or of an arena. Contacts have to be computed."""
    contacts = data.contact
    groups = model.geom_group[contacts.geom]
    is_of_robot = ((groups == OBSTACLE_GROUP).sum(-1) == 1) & (groups != FLOOR_GROUP).all(-1)
    for pair in contacts.geom[is_of_robot & (contacts.dist < -_DEPTH_M)]:
        name = next(model.geom(geom).name for geom in pair if model.geom_group[geom] == OBSTACLE_GROUP)
        if scene is None:
            remedy = "narrow the place of the robot, or make the arena wider"
        else:
            start = "start_mm" if scene.wall_distance_mm is None else "wall_distance_mm"
            remedy = f"move that, or change {start} or heading_deg of the scene"
        if scene is not None and name.startswith("object_"):
            solids = [item for item in scene.objects if isinstance(item, Solid)]
            name = f"{solids[int(name.removeprefix('object_'))]}"
        raise TwinError(f"a robot would start inside of {name or 'an obstacle'}; {remedy}")
