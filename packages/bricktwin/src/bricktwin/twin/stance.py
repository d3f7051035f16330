"""Stance of a robot at its start: feet that touch a flat floor, the resulting pose, and no overlap
with an obstacle."""

import itertools
import math
from collections.abc import Sequence

from brickhub.errors import TwinError
from bricktwin.twin.engines.conventions import FLOOR_GROUP, OBSTACLE_GROUP
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import (
    Quaternion,
    Vector,
    cross,
    dot,
    minus,
    plus,
    times,
    vector,
)
from bricktwin.twin.scene import Scene

_SPHERE = 2
"""MuJoCo's number of this type of geometry (``mjtGeom``), as of the next one."""
_CAPSULE = 3
_MIN_INSIDE = -1e-9
"""Least distance of the centre of mass from the edges of a triangle: rounding may put one that is
on an edge just beyond it."""
_ROUNDING_M = 1e-9
"""Rounding error of a length."""

_MOST_POINTS = 20
"""Most points of which all triples are tried: of more, the highest are no feet to stand on now."""


class Feet:
    """Points of a model's feet that may touch a floor.

    Capsules and spheres touch with the balls at their ends, other feet with the corners of their
    bounding boxes.

    Args:
        geoms: indices of the feet.
    """

    def __init__(
        self,
        engine: Engine,
        geoms: list[int],
    ) -> None:
        self._engine = engine
        types = engine.indices("geom_type")
        boxes_m = engine.nominal("geom_aabb")
        sizes_m = engine.nominal("geom_size")
        self._points: list[tuple[int, Vector, float]] = []
        """Geometry of each point, its place in the frame of that, and the radius around it."""
        # Of all feet first one corner, then the next: the order decides between equal stances.
        for corner, signs in enumerate(itertools.product((1, -1), repeat=3)):
            for geom in geoms:
                box_m = boxes_m[6 * geom : 6 * geom + 6]
                half_m = vector(box_m[3:])
                radius_m = 0.0
                if types[geom] in (_SPHERE, _CAPSULE):
                    # A capsule lies along its z axis: size 1 is the half length between its balls.
                    half_m = (0.0, 0.0, sizes_m[3 * geom + 1])
                    radius_m = sizes_m[3 * geom]
                    if corner > 1:
                        continue
                turned = [half * sign for half, sign in zip(half_m, signs, strict=True)]
                self._points.append((geom, plus(vector(box_m[:3]), vector(turned)), radius_m))

    def points_m(self) -> list[tuple[Vector, float]]:
        """The points in the world, of the present positions of the geoms, and the radius of the
        ball around each; 0 for a corner."""
        places = self._engine.derived("geom_xpos")
        frames = self._engine.derived("geom_xmat")
        points = []
        for geom, offset_m, radius_m in self._points:
            place = vector(places[3 * geom : 3 * geom + 3])
            frame = frames[9 * geom : 9 * geom + 9]
            points.append((plus(place, in_frame(frame, offset_m)), radius_m))
        return points


def in_frame(frame: Sequence[float], of: Vector) -> Vector:
    """A vector of a frame, given by the flat matrix [9] of its axes, in that frame's parent."""
    a, b, c, d, e, f, g, h, i = frame
    x, y, z = of
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def standing_pose(points: Sequence[Vector], centre: Vector) -> tuple[Quaternion, float]:
    """Pose in which a rigid body rests on three of its points: of several, the one whose centre of
    mass is lowest.

    Args:
        points: possible contact points in the body's frame, m.
        centre: centre of mass.

    Returns:
        The quaternion [4] of that orientation, without a change of heading, and the height of the
        frame's origin above the touching points, m.
    """
    # A body stands if no point is below the plane of three, and its centre of mass is above their
    # triangle. If more than three points lie in one plane, rounding makes some triples fail
    # slightly: the triples that fail least are taken, not those that do not fail.
    least = math.inf
    stances: list[tuple[float, float, Vector, Vector]] = []
    """Failure, height of the centre, normal and first point of each."""
    if len(points) > _MOST_POINTS:
        points = sorted(points, key=lambda point: point[2])[:_MOST_POINTS]
    # Every three points may be those that touch.
    for first, second, third in itertools.combinations(points, 3):
        # The plane of the triple, with its normal upwards in the body's frame.
        across = cross(minus(second, first), minus(third, first))
        length = math.hypot(*across)
        # Three points on one line have no plane.
        if length <= 1e-9:
            continue
        sign = -1.0 if across[2] < 0.0 else 1.0
        normal = times(sign / length, across)
        # The corners, so that they go round the normal.
        corners = (first, third, second) if sign < 0.0 else (first, second, third)
        inside = _distance_inside(corners, normal, centre)
        failure = max(_MIN_INSIDE - inside, 0.0)
        # Most triples fail by more than another one, whatever lies below them.
        if failure > least + _ROUNDING_M:
            continue
        level = dot(normal, first)
        lowest = min(dot(normal, point) for point in points)
        failure += max(level - lowest, 0.0)
        if failure <= least + _ROUNDING_M:
            least = min(least, failure)
            height = dot(normal, minus(centre, first))
            stances.append((failure, height, normal, first))

    if not stances:
        # All points are on one line, which carries nothing: upright, on the lowest of them.
        return (1.0, 0.0, 0.0, 0.0), -min(height for _, _, height in points)
    # Of several stances, a body falls into that of the least potential energy.
    _, _, up, touching = min(
        (stance for stance in stances if stance[0] <= least + _ROUNDING_M),
        key=lambda stance: stance[1],
    )
    # The shortest rotation that makes this direction vertical.
    x, y, z = up
    length = math.hypot(1.0 + z, y, x)
    quaternion = ((1.0 + z) / length, y / length, -x / length, 0.0)
    return quaternion, -dot(up, touching)


def _distance_inside(
    corners: tuple[Vector, Vector, Vector],
    normal: Vector,
    centre: Vector,
) -> float:
    """How far a point is inside of the nearest edge of a triangle, times that edge's length;
    negative outside. The corners go round the normal."""
    first, second, third = corners
    edges = (
        (first, second),
        (second, third),
        (third, first),
    )
    sides = []
    for start, end in edges:
        moment = cross(minus(end, start), minus(centre, start))
        sides.append(dot(moment, normal))
    return min(sides)


_DEPTH_M = 0.008
"""Depth from which on an overlap is more than a touch."""


def refuse_overlap(engine: Engine, scene: Scene | None = None) -> None:
    """Raise TwinError if a robot is inside of an obstacle of the ``scene``, or of an arena.
    Contacts have to be computed."""
    groups = engine.indices("geom_group")
    for touch in engine.touches():
        if touch.distance_m >= -_DEPTH_M:
            continue
        pair = (touch.first, touch.second)
        obstacles = [geom for geom in pair if groups[geom] == OBSTACLE_GROUP]
        is_floor = any(groups[geom] == FLOOR_GROUP for geom in pair)
        # Of one obstacle and a robot: not of two obstacles, and not of an obstacle and the floor.
        if len(obstacles) == 1 and not is_floor:
            raise _overlap(engine.names("geom")[obstacles[0]], scene)


def _overlap(obstacle: str, scene: Scene | None) -> TwinError:
    """The error of a robot inside of an obstacle, with what the user can change."""
    if scene is None:
        remedy = "narrow the place of the robot, or make the arena wider"
    else:
        start = "start_mm" if scene.wall_distance_mm is None else "wall_distance_mm"
        remedy = f"move that, or change {start} or heading_deg of the scene"
    if scene is not None and obstacle.startswith("object_"):
        # The user knows the object as it was written, not by its number in the model.
        number = int(obstacle.removeprefix("object_"))
        obstacle = f"{scene.solids[number]}"
    return TwinError(f"a robot would start inside of {obstacle or 'an obstacle'}; {remedy}")
