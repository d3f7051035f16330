"""Meshes of parts for moving robots: triangles of the solids of `looks`, without those that other
solids hide. LDraw units."""

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bricktwin.plans.drawing.looks import Piece, Tint, hole_ends, look_of, solids_meet
from bricktwin.plans.geometry import Floats, Form, Solid, circle_sides
from bricktwin.plans.part import Part

_CHORD_ERROR = 0.3
"""Largest distance of a circle from the polygon that is drawn for it."""
_ON_AXIS = 1e-9
"""Radii of a profile below this lie on its axis, where triangles have no area."""
_SPREAD = 0.9
_OFFSET = 0.05
"""Sample points around a triangle: share of the way from its middle to its corners, and distance
from it, LDU."""
_DISC_OFFSET = 0.15
"""Offset of a hole's dark disc from the surface, for visibility."""


@dataclass(frozen=True)
class Surface:
    """Triangles [n, 3, 3], counter-clockwise from outside, and their tints [n]."""

    triangles: Floats
    tints: Floats


@functools.lru_cache(maxsize=1024)
def surface_of(part: Part) -> Surface:
    """The surface of a part in its own frame; holes are dark discs and crosses at their ends."""
    pieces = [
        *look_of(part),
        *(Piece(plug, Tint.DARK) for site in part.holes for plug in hole_ends(site, _DISC_OFFSET)),
    ]
    solids = [piece.solid for piece in pieces]
    visible = _without_hidden(solids, [_solid(solid) for solid in solids])
    tints = [
        np.full(len(triangles), int(piece.tint))
        for piece, triangles in zip(pieces, visible, strict=True)
    ]
    return Surface(np.concatenate(visible), np.concatenate(tints))


def _solid(solid: Solid) -> Floats:
    """Triangles [n, 3, 3] of a solid: a profile of (radius, height), each up to 1, all around its
    third axis."""
    sides = circle_sides(solid.half[0], _CHORD_ERROR)
    phase = 0.0
    scale = np.array([solid.half[0], solid.half[0], solid.half[2]])
    profile = [(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)]
    if solid.form is Form.BOX:
        sides = 4
        phase = math.pi / 4
        scale = np.array(solid.half) * [math.sqrt(2), math.sqrt(2), 1.0]
    elif solid.form is Form.RING:
        inner = solid.half[1] / solid.half[0]
        profile = [(inner, -1.0), (1.0, -1.0), (1.0, 1.0), (inner, 1.0), (inner, -1.0)]
    elif solid.form is Form.BALL:
        angles = [math.pi * step / 10 - math.pi / 2 for step in range(11)]
        profile = [(math.cos(angle), math.sin(angle)) for angle in angles]
    turns = phase + np.arange(sides + 1) * 2 * math.pi / sides
    rings = [
        np.column_stack([r * np.cos(turns), r * np.sin(turns), np.full(sides + 1, z)]) * scale
        for r, z in profile
    ]
    faces = []
    for (low, (low_radius, _)), (high, (high_radius, _)) in itertools.pairwise(
        zip(rings, profile, strict=True)
    ):
        if low_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        if high_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    triangles = np.concatenate(faces) @ np.array(solid.axes) + np.array(solid.centre)
    return np.asarray(triangles if np.linalg.det(solid.axes) > 0 else triangles[:, ::-1])


def _without_hidden(solids: Sequence[Solid], surfaces: list[Floats]) -> list[Floats]:
    """Triangles of each solid's surface [n, 3, 3] without those that others hide.

    A triangle is hidden if there is material on its outer side, or if it lies on the surface of an
    earlier solid.
    """
    visible = []
    for number, triangles in enumerate(surfaces):
        outer, inner = (
            offset_points(triangles, distance).reshape(-1, 3) for distance in (_OFFSET, -_OFFSET)
        )
        covered = np.zeros(len(outer), dtype=bool)
        duplicate = np.zeros(len(outer), dtype=bool)
        for other, solid in enumerate(solids):
            if not solids_meet(solids[number], solid):
                continue
            if other != number:
                covered |= solid.contains(outer, 0.0)
            if other < number:
                duplicate |= solid.contains(inner, 0.0)
        hidden = covered.reshape(-1, 4).all(axis=1) | duplicate.reshape(-1, 4).all(axis=1)
        visible.append(triangles[~hidden])
    return visible


def offset_points(triangles: Floats, distance: float) -> Floats:
    """Points [n, 4, 3] at a distance from triangles [n, 3, 3], on their outer side: over the
    middle, and near the corners."""
    centres = triangles.mean(axis=1, keepdims=True)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return (
        np.concatenate([centres, centres + _SPREAD * (triangles - centres)], axis=1)
        + distance * normals[:, None]
    )
