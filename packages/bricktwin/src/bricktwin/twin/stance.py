"""Stance of a robot at its start: feet that touch a flat floor, the resulting pose, and no overlap
with an obstacle."""

import itertools
import math
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from bricktwin.plans.geometry import Floats
from bricktwin.twin.models.mjcf import FLOOR_GROUP, OBSTACLE_GROUP
from bricktwin.twin.scene import Scene

_MIN_INSIDE = -1e-9
"""Least distance of the centre of mass from the edges of a triangle: rounding may put one that is
on an edge just beyond it."""
_ROUNDING_M = 1e-9
"""Rounding error of a length."""


class Feet:
    """Points of a model's feet that may touch a floor.

    Capsules and spheres of one radius touch with the balls at their ends, other feet with the
    corners of their bounding boxes.

    Args:
        geoms: indices of the feet.

    Attributes:
        radius_m: radius of the balls around the points; 0 for corners.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        geoms: list[int],
    ) -> None:
        self.radius_m = 0.0
        # [n, 3] each, in the frames of the geoms
        centres_m = model.geom_aabb[geoms, :3]
        halves_m = model.geom_aabb[geoms, 3:]
        corner_signs = list(itertools.product((1, -1), repeat=3))
        if _have_one_radius(model, geoms):
            self.radius_m = float(model.geom_size[geoms[0], 0])
            # A capsule lies along its z axis: size 1 is the half length between its balls.
            across_m = np.zeros((len(geoms), 2))
            along_m = model.geom_size[geoms, 1]
            halves_m = np.column_stack([across_m, along_m])
            corner_signs = [(1, 1, 1), (1, 1, -1)]
        offsets_m = [centres_m + halves_m * signs for signs in corner_signs]
        self._offsets_m = np.concatenate(offsets_m)
        self._geoms = np.tile(geoms, len(offsets_m))

    def points_m(self, data: mujoco.MjData) -> Floats:
        """The points in the world ``[n, 3]``, of the present positions of the geoms."""
        frames = data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        turned_m = np.einsum("nij,nj->ni", frames, self._offsets_m)
        points: Floats = data.geom_xpos[self._geoms] + turned_m
        return points


def _have_one_radius(model: mujoco.MjModel, geoms: list[int]) -> bool:
    """Whether all geoms are capsules or spheres of one radius."""
    round_kinds = (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE)
    is_round = np.isin(model.geom_type[geoms], round_kinds)
    radii_m = set(model.geom_size[geoms, 0])
    return bool(is_round.all()) and len(radii_m) == 1


def standing_pose(points: Floats, centre: Floats) -> tuple[Floats, float]:
    """Pose in which a rigid body rests on three of its points: of several, the one whose centre of
    mass is lowest.

    Args:
        points: [n, 3], possible contact points in the body's frame, m.
        centre: [3], centre of mass.

    Returns:
        The quaternion [4] of that orientation, without a change of heading, and the height of the
        frame's origin above the touching points, m.
    """
    # Every three points may be those that touch: [triples, 3 points, 3].
    triples = points[_triples(len(points))]
    first = triples[:, 0]
    second = triples[:, 1]
    third = triples[:, 2]

    # The plane of each triple, with its normal upwards in the body's frame.
    normal = np.cross(second - first, third - first)
    is_downward = normal[:, 2:] < 0.0
    normal *= np.where(is_downward, -1.0, 1.0)
    length = np.linalg.norm(normal, axis=1)
    # Three points on one line have no plane.
    usable = length > 1e-9
    normal[usable] /= length[usable, None]

    # A body stands if no point is below the plane, and its centre of mass is above the triangle.
    offsets = points[None] - first[:, None]  # [triples, n, 3]
    heights = offsets @ normal[:, :, None]  # [triples, n, 1]
    clearance = np.min(heights, axis=(1, 2))
    inside = _distance_inside(
        first,
        second,
        third,
        normal,
        centre,
    )

    # If more than three points lie in one plane, rounding makes some triples fail slightly: the
    # triples that fail least are taken, not those that do not fail.
    below = np.maximum(-clearance, 0.0)
    beside = np.maximum(_MIN_INSIDE - inside, 0.0)
    violation = np.where(usable, below + beside, math.inf)
    is_stance = violation <= violation.min() + _ROUNDING_M

    # Of several stances, a body falls into that of the least potential energy.
    height = np.einsum("ij,ij->i", normal, centre - first)
    heights = np.where(is_stance, height, math.inf)
    best = int(np.argmin(heights))
    up = normal[best]
    # The shortest rotation that makes this direction vertical.
    x, y, z = up
    quaternion = np.array([1.0 + z, y, -x, 0.0])
    quaternion = quaternion / np.linalg.norm(quaternion)
    height_m = float(-up @ first[best])
    return quaternion, height_m


def _distance_inside(
    first: Floats,
    second: Floats,
    third: Floats,
    normal: Floats,
    centre: Floats,
) -> Floats:
    """How far a point is inside of the nearest edge of each triangle, times that edge's length
    ``[n]``; negative outside. Corners and normals are ``[n, 3]``."""
    # Which way round the corners go, seen against the normal.
    around = np.cross(second - first, third - first)
    orientation = np.sign(np.einsum("ij,ij->i", around, normal))
    inside = np.full(len(first), math.inf)
    edges = (
        (first, second),
        (second, third),
        (third, first),
    )
    for start, end in edges:
        moment = np.cross(end - start, centre - start)
        side = np.einsum("ij,ij->i", moment, normal)
        inside = np.minimum(inside, side * orientation)
    return inside


@cache
def _triples(count: int) -> NDArray[np.intp]:
    """Indices ``[n, 3]`` of all triples of so many points; each reset of a legged robot needs
    them."""
    triples = itertools.combinations(range(count), 3)
    return np.array(list(triples))


_DEPTH_M = 0.008
"""Depth from which on an overlap is more than a touch."""


def refuse_overlap(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    scene: Scene | None = None,
) -> None:
    """Raise TwinError if a robot is inside of an obstacle of the ``scene``, or of an arena.
    Contacts have to be computed."""
    contacts = data.contact
    groups = model.geom_group[contacts.geom]  # [contacts, 2]
    # Of one obstacle and a robot: not of two obstacles, and not of an obstacle and the floor.
    has_one_obstacle = (groups == OBSTACLE_GROUP).sum(-1) == 1
    has_no_floor = (groups != FLOOR_GROUP).all(-1)
    is_of_robot = has_one_obstacle & has_no_floor
    is_deep = contacts.dist < -_DEPTH_M
    for pair in contacts.geom[is_of_robot & is_deep]:
        is_first = model.geom_group[pair[0]] == OBSTACLE_GROUP
        obstacle = pair[0] if is_first else pair[1]
        raise _overlap(model.geom(obstacle).name, scene)


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
