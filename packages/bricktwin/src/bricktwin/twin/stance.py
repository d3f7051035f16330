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
_ROUNDING_M = 1e-9


class Feet:
    """Points of a model's feet that may touch a floor.

    Capsules and spheres of one radius touch with the balls at their ends, other feet with the
    corners of their bounding boxes.

    Args:
        geoms: indices of the feet.

    Attributes:
        radius_m: radius of the balls around the points; 0 for corners.
    """

    def __init__(self, model: mujoco.MjModel, geoms: list[int]) -> None:
        self.radius_m = 0.0
        centres = model.geom_aabb[geoms, :3]
        halves = model.geom_aabb[geoms, 3:]
        signs = list(itertools.product((1, -1), repeat=3))
        is_round = np.isin(
            model.geom_type[geoms], (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE)
        ).all()
        if is_round and len(set(model.geom_size[geoms, 0])) == 1:
            self.radius_m = float(model.geom_size[geoms[0], 0])
            halves = np.column_stack([np.zeros((len(geoms), 2)), model.geom_size[geoms, 1]])
            signs = [(1, 1, 1), (1, 1, -1)]
        offsets = [centres + halves * sign for sign in signs]
        self._offsets_m = np.concatenate(offsets)
        self._geoms = np.tile(geoms, len(offsets))

    def points_m(self, data: mujoco.MjData) -> Floats:
        """The points in the world ``[n, 3]``, of the present positions of the geoms."""
        turned = np.einsum(
            "nij,nj->ni", data.geom_xmat[self._geoms].reshape(-1, 3, 3), self._offsets_m
        )
        points: Floats = data.geom_xpos[self._geoms] + turned
        return points


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
    triples = points[_triples(len(points))]
    first = triples[:, 0]
    second = triples[:, 1]
    third = triples[:, 2]
    normal = np.cross(second - first, third - first)
    normal *= np.where(normal[:, 2:] < 0.0, -1.0, 1.0)
    length = np.linalg.norm(normal, axis=1)
    usable = length > 1e-9
    normal[usable] /= length[usable, None]
    # No point may be below the plane, and the centre of mass must be above the triangle.
    clearance = np.min((points[None] - first[:, None]) @ normal[:, :, None], axis=(1, 2))
    inside = np.full(len(triples), math.inf)
    for start, end in ((first, second), (second, third), (third, first)):
        side = np.einsum("ij,ij->i", np.cross(end - start, centre - start), normal)
        orientation = np.einsum("ij,ij->i", np.cross(second - first, third - first), normal)
        inside = np.minimum(inside, side * np.sign(orientation))
    # If more than three points lie in one plane, rounding makes some triples fail slightly.
    violation = np.where(
        usable, np.maximum(-clearance, 0.0) + np.maximum(_MIN_INSIDE - inside, 0.0), math.inf
    )
    height = np.einsum("ij,ij->i", normal, centre - first)
    best = int(np.argmin(np.where(violation <= violation.min() + _ROUNDING_M, height, math.inf)))
    up = normal[best]
    # The shortest rotation that makes this direction vertical.
    quaternion = np.array([1.0 + up[2], up[1], -up[0], 0.0])
    return quaternion / np.linalg.norm(quaternion), float(-up @ first[best])


@cache
def _triples(count: int) -> NDArray[np.intp]:
    return np.array(list(itertools.combinations(range(count), 3)))


_DEPTH_M = 0.008
"""Depth from which on an overlap is more than a touch."""


def refuse_overlap(model: mujoco.MjModel, data: mujoco.MjData, scene: Scene | None = None) -> None:
    """Raise TwinError if a robot is inside of an obstacle of the ``scene``, or of an arena.
    Contacts have to be computed."""
    contacts = data.contact
    groups = model.geom_group[contacts.geom]
    is_of_robot = ((groups == OBSTACLE_GROUP).sum(-1) == 1) & (groups != FLOOR_GROUP).all(-1)
    for pair in contacts.geom[is_of_robot & (contacts.dist < -_DEPTH_M)]:
        name = next(
            model.geom(geom).name for geom in pair if model.geom_group[geom] == OBSTACLE_GROUP
        )
        if scene is None:
            remedy = "narrow the place of the robot, or make the arena wider"
        else:
            start = "start_mm" if scene.wall_distance_mm is None else "wall_distance_mm"
            remedy = f"move that, or change {start} or heading_deg of the scene"
        if scene is not None and name.startswith("object_"):
            name = f"{scene.solids[int(name.removeprefix('object_'))]}"
        raise TwinError(f"a robot would start inside of {name or 'an obstacle'}; {remedy}")
