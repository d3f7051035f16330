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
"""Share of the way from a triangle's middle to its corners at which it is sampled."""
_OFFSET = 0.05
"""Distance of the sample points from their triangle, LDU."""
_BALL_ANGLES = [math.pi * step / 10 - math.pi / 2 for step in range(11)]
"""Latitudes of a ball's rings, from pole to pole."""
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
    pieces = [*look_of(part)]
    for site in part.holes:
        for plug in hole_ends(site, _DISC_OFFSET):
            pieces.append(Piece(plug, Tint.DARK))
    solids = [piece.solid for piece in pieces]
    surfaces = [_solid(solid) for solid in solids]
    visible = _without_hidden(solids, surfaces)
    tints = []
    for piece, triangles in zip(pieces, visible, strict=True):
        tints.append(np.full(len(triangles), int(piece.tint)))
    return Surface(np.concatenate(visible), np.concatenate(tints))


def _solid(solid: Solid) -> Floats:
    """Triangles [n, 3, 3] of a solid: a profile of (radius, height), each up to 1, all around its
    third axis."""
    radius, bore, half_length = solid.half
    sides = circle_sides(radius, _CHORD_ERROR)
    phase = 0.0
    scale = np.array([radius, radius, half_length])
    profile = [(0.0, -1.0), (1.0, -1.0), (1.0, 1.0), (0.0, 1.0)]
    if solid.form is Form.BOX:
        # A box is drawn as a cylinder with four sides, whose corners are at radius 1; its sides are
        # nearer.
        sides = 4
        phase = math.pi / 4
        scale = np.array(solid.half) * [math.sqrt(2), math.sqrt(2), 1.0]
    elif solid.form is Form.RING:
        inner = bore / radius
        profile = [(inner, -1.0), (1.0, -1.0), (1.0, 1.0), (inner, 1.0), (inner, -1.0)]
    elif solid.form is Form.BALL:
        profile = [(math.cos(angle), math.sin(angle)) for angle in _BALL_ANGLES]
    local = _revolved(profile, sides, phase, scale)  # [n, 3, 3] in the solid's axes
    axes = np.array(solid.axes)
    triangles = local @ axes + np.array(solid.centre)
    # Left-handed axes turn each triangle inside out, so its corners are reversed.
    if np.linalg.det(solid.axes) <= 0:
        triangles = triangles[:, ::-1]
    return np.asarray(triangles)


def _revolved(
    profile: Sequence[tuple[float, float]],
    sides: int,
    phase: float,
    scale: Floats,
) -> Floats:
    """Triangles [n, 3, 3] of a profile of (radius, height) that goes round the third axis."""
    turns = phase + np.arange(sides + 1) * 2 * math.pi / sides
    # Each ring is [sides + 1, 3], and its last point is its first one, which closes it.
    rings = []
    for radius, height in profile:
        x = radius * np.cos(turns)
        y = radius * np.sin(turns)
        points = np.column_stack([x, y, np.full(sides + 1, height)])
        rings.append(points * scale)
    faces = []
    radii = [radius for radius, _ in profile]
    bands = zip(itertools.pairwise(rings), itertools.pairwise(radii), strict=True)
    for (low, high), (low_radius, high_radius) in bands:
        # A ring on the axis is one point, so only one of the two triangles has an area.
        if low_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        if high_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return np.concatenate(faces)


def _without_hidden(solids: Sequence[Solid], surfaces: list[Floats]) -> list[Floats]:
    """Triangles of each solid's surface [n, 3, 3] without those that others hide.

    A triangle is hidden if there is material on its outer side, or if it lies on the surface of an
    earlier solid.
    """
    visible = []
    for number, triangles in enumerate(surfaces):
        outer = offset_points(triangles, _OFFSET).reshape(-1, 3)  # [4 n, 3]
        inner = offset_points(triangles, -_OFFSET).reshape(-1, 3)  # [4 n, 3]
        covered = np.zeros(len(outer), dtype=bool)  # [4 n]
        duplicate = np.zeros(len(outer), dtype=bool)  # [4 n]
        for other, solid in enumerate(solids):
            # The boxes of most pairs do not meet, which costs much less to find out than testing
            # points.
            if not solids_meet(solids[number], solid):
                continue
            if other != number:
                covered |= solid.contains(outer, 0.0)
            # The earlier solid keeps its surface where two coincide, because drawing both would
            # flicker.
            if other < number:
                duplicate |= solid.contains(inner, 0.0)
        # A triangle is removed only if all four of its points are hidden, because triangles are
        # never cut.
        is_covered = covered.reshape(-1, 4).all(axis=1)
        is_duplicate = duplicate.reshape(-1, 4).all(axis=1)
        visible.append(triangles[~(is_covered | is_duplicate)])
    return visible


def offset_points(triangles: Floats, distance: float) -> Floats:
    """Points [n, 4, 3] at a distance from triangles [n, 3, 3], on their outer side: over the
    middle, and near the corners."""
    centres = triangles.mean(axis=1, keepdims=True)  # [n, 1, 3]
    along = triangles[:, 1] - triangles[:, 0]
    across = triangles[:, 2] - triangles[:, 0]
    normals = np.cross(along, across)  # [n, 3]
    # The limit keeps the normal of a triangle without an area at 0, instead of dividing by 0; its
    # samples lie on it.
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)  # [n, 1]
    normals /= np.maximum(lengths, 1e-12)
    near_corners = centres + _SPREAD * (triangles - centres)  # [n, 3, 3]
    samples = np.concatenate([centres, near_corners], axis=1)  # [n, 4, 3]
    return np.asarray(samples + distance * normals[:, None])
