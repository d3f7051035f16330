"""Scene that several robots share: where each of them starts, and what leaves its place for them.

It needs neither NumPy nor MuJoCo: places follow from the descriptions of the objects alone.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

from brickhub.errors import TwinError
from bricktwin.twin.objects import Ball, Block, Object, Point, Ramp, Solid, Wall
from bricktwin.twin.scene import Scene

APART_MM = 500.0
"""Distance between neighbours."""
_RINGS = 4
"""How many places away from the first robot's start another one is looked for."""
_ROOM_MM = 200.0
"""Free space around a robot at its start."""
_WAY_MM = 120.0
"""Free space on both sides of the way from the first robot's start to another one, which must not
lead through a wall."""
_STEP_MM = 50.0

Start = tuple[float, float, float]
"""Place x, y (m) and heading (deg, clockwise) of a robot."""
_Rectangle = tuple[Point, Point, float]
"""Middle and half sizes of a rectangle on the floor (mm), and its angle, counter-clockwise."""


def shared_scene(scene: Scene) -> Scene:
    """A scene as several robots share it: what can be pushed, and lies where another robot starts,
    is taken away, as it stood for that robot. Raises TwinError if the scene is for one robot
    alone."""
    own = _made_for_one(scene)
    if own:
        raise TwinError(
            f"{own} is for one robot alone, and several share this scene; leave it out of the "
            "scene, or take another one"
        )
    starts_mm = [(x_mm, y_mm) for x_mm, y_mm, _ in scene.others_start]
    objects = []
    for item in scene.objects:
        loose_mm = _loose_at_mm(item)
        if loose_mm is not None and any(
            math.dist(loose_mm, start_mm) < _ROOM_MM for start_mm in starts_mm
        ):
            continue
        objects.append(item)
    return replace(scene, objects=tuple(objects))


def _loose_at_mm(item: Object) -> Point | None:
    """Where something lies that can be pushed; ``None`` for what stays where it is."""
    if isinstance(item, Ball):
        return item.at_mm
    if isinstance(item, Block) and item.mass_g is not None:
        return item.at_mm
    return None


def _made_for_one(scene: Scene) -> str:
    """What of a scene only one robot can have; empty if there is nothing."""
    parts = {
        "a wall before its sensor (wall_distance_mm)": scene.wall_distance_mm is not None,
        "a hand that holds it (held_deg)": scene.held_deg is not None,
        "a ball in its gripper": scene.ball,
        "readings of its own": bool(scene.readings),
        "end stops of its own": bool(scene.end_stops),
    }
    return next((part for part, is_there in parts.items() if is_there), "")


def starts_in(scene: Scene, count: int) -> list[Start]:
    """Poses at which so many robots start: the first one where it would start alone, in the middle
    of its ranges, others where the scene says, further ones beside those, half a metre apart, and
    looking the same way. Raises TwinError if there is no room for them."""
    first_mm = (_middle(scene.start_mm[0]), _middle(scene.start_mm[1]))
    heading_deg = _middle(scene.heading_deg)
    starts = [(*first_mm, heading_deg), *scene.others_start]
    solids = list(map(_rectangle, scene.solids))
    for place_mm in _around(first_mm, heading_deg):
        if len(starts) >= count:
            break
        is_apart = all(math.dist(place_mm, start[:2]) >= APART_MM - 1.0 for start in starts)
        if is_apart and _is_free(first_mm, place_mm, solids):
            starts.append((*place_mm, heading_deg))
    if len(starts) < count:
        raise TwinError(
            f"there is no room for {count} robots in this scene; take fewer, or say where they "
            "start: others_start of the scene"
        )
    return [(x_mm / 1000, y_mm / 1000, turned_deg) for x_mm, y_mm, turned_deg in starts[:count]]


def _middle(ends: Point) -> float:
    return sum(ends) / 2


def _around(first_mm: Point, heading_deg: float) -> Iterator[Point]:
    """Places around a start, in the order in which they are tried: to its left, to its right,
    behind it, and then all others of a grid, the nearest first."""
    numbers = range(1, _RINGS + 1)
    steps = [(0, number) for number in numbers]
    steps += [(0, -number) for number in numbers]
    steps += [(-number, 0) for number in numbers]
    sides = range(-_RINGS, _RINGS + 1)
    steps += sorted(itertools.product(sides, sides), key=lambda step: math.hypot(*step))
    heading = math.radians(heading_deg)
    cosine = math.cos(heading)
    sine = math.sin(heading)
    for ahead, left in steps:
        # A heading is clockwise.
        x_mm = first_mm[0] + APART_MM * (ahead * cosine + left * sine)
        y_mm = first_mm[1] + APART_MM * (left * cosine - ahead * sine)
        yield x_mm, y_mm


def _is_free(
    first_mm: Point,
    place_mm: Point,
    solids: list[_Rectangle],
) -> bool:
    """Whether a robot can stand at a place, and nothing is between it and the first one."""
    if any(_distance_mm(place_mm, solid) < _ROOM_MM for solid in solids):
        return False
    pieces = math.ceil(math.dist(first_mm, place_mm) / _STEP_MM)
    for piece in range(1, pieces):
        share = piece / pieces
        point = (
            first_mm[0] + share * (place_mm[0] - first_mm[0]),
            first_mm[1] + share * (place_mm[1] - first_mm[1]),
        )
        if any(_distance_mm(point, solid) < _WAY_MM for solid in solids):
            return False
    return True


def _rectangle(solid: Solid) -> _Rectangle:
    """The floor that something covers."""
    if isinstance(solid, Wall):
        from_x, from_y = solid.from_mm
        to_x, to_y = solid.to_mm
        half = (math.dist(solid.from_mm, solid.to_mm) / 2, solid.thickness_mm / 2)
        angle = math.atan2(to_y - from_y, to_x - from_x)
        return ((from_x + to_x) / 2, (from_y + to_y) / 2), half, angle
    if isinstance(solid, Ball):
        return solid.at_mm, (solid.diameter_mm / 2, solid.diameter_mm / 2), 0.0
    angle = -math.radians(solid.heading_deg)
    if isinstance(solid, Ramp):
        # It begins at its place, and lies ahead of it.
        half = (solid.length_mm / 2, solid.width_mm / 2)
        x_mm = solid.at_mm[0] + half[0] * math.cos(angle)
        y_mm = solid.at_mm[1] + half[0] * math.sin(angle)
        return (x_mm, y_mm), half, angle
    return solid.at_mm, (solid.size_mm[0] / 2, solid.size_mm[1] / 2), angle


def _distance_mm(point: Point, rectangle: _Rectangle) -> float:
    """Distance of a point from a rectangle; 0 in it."""
    (x_mm, y_mm), (half_x, half_y), angle = rectangle
    offset_x = point[0] - x_mm
    offset_y = point[1] - y_mm
    # The point in the rectangle's own frame.
    along = abs(offset_x * math.cos(angle) + offset_y * math.sin(angle))
    across = abs(offset_y * math.cos(angle) - offset_x * math.sin(angle))
    return math.hypot(max(along - half_x, 0.0), max(across - half_y, 0.0))
