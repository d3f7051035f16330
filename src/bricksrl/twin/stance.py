"""Stance of a legged robot: the feet that touch a flat floor, and the resulting pose."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bricksrl.plans.geometry import Floats

_MIN_INSIDE = -1e-9


def standing_pose(points: Floats, centre: Floats) -> tuple[Floats, float]:
    """Pose in which a rigid body rests on three of its points.

    Args:
        points: [n, 3], possible contact points in the body's frame, m.
        centre: [3], centre of mass.

    Returns:
        The quaternion [4] of that orientation, without a change of heading, and the height of the frame's origin above the
        touching points, m.
    """
    triples = points[_triples(len(points))]
    first, second, third = triples[:, 0], triples[:, 1], triples[:, 2]
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
    # If more than three points lie in one plane, rounding makes some triples fail slightly: take the best one.
    violation = np.where(usable, np.maximum(-clearance, 0.0) + np.maximum(_MIN_INSIDE - inside, 0.0), math.inf)
    best = int(np.argmin(violation))
    up = normal[best]
    return _upright(up), float(-up @ first[best])


def _upright(up: Floats) -> Floats:
    """Quaternion of the shortest rotation that makes a direction vertical."""
    quaternion = np.array([1.0 + up[2], up[1], -up[0], 0.0])
    upright: Floats = quaternion / np.linalg.norm(quaternion)
    return upright


@cache
def _triples(count: int) -> NDArray[np.intp]:
    return np.array(list(itertools.combinations(range(count), 3)))
