"""Meshes of parts for moving robots: triangles of the solids of `looks`, without those that other solids hide. LDraw units."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bricktwin.plans.geometry import Floats, Form, Solid, circle_sides, frame_of
from bricktwin.plans.looks import Tint, look_of, solids_meet
from bricktwin.plans.part import Fit, Part, Site

_CHORD_ERROR = 0.3
"""Largest distance of a circle from the polygon that is drawn for it."""
_ON_AXIS = 1e-9
"""Radii of a profile below this lie on its axis, where triangles have no area."""
_SPREAD, _OFFSET = 0.9, 0.05
"""Sample points around a triangle: share of the way from its middle to its corners, and distance from it, LDU."""
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
    look = look_of(part)
    solids = [piece.solid for piece in look]
    pieces = list(zip(_without_hidden(solids, [_solid(solid) for solid in solids]), [piece.tint for piece in look], strict=True))
    pieces += [(_hole(site), Tint.DARK) for site in part.holes]
    triangles = np.concatenate([piece for piece, _ in pieces])
    return Surface(triangles, np.concatenate([np.full(len(piece), int(tint)) for piece, tint in pieces]))


def _solid(solid: Solid) -> Floats:
    sides = circle_sides(solid.half[0], _CHORD_ERROR)
    if solid.form is Form.BOX:
        local = _box(solid.half)
    elif solid.form is Form.CYLINDER:
        local = _revolved([(0, -1), (1, -1), (1, 1), (0, 1)], solid.half[0], solid.half[2], sides)
    elif solid.form is Form.RING:
        inner = solid.half[1] / solid.half[0]
        local = _revolved([(inner, -1), (1, -1), (1, 1), (inner, 1), (inner, -1)], solid.half[0], solid.half[2], sides)
    else:
        angles = [math.pi * step / 10 - math.pi / 2 for step in range(11)]
        local = _revolved([(math.cos(angle), math.sin(angle)) for angle in angles], solid.half[0], solid.half[0], sides)
    faces = _tube_outward(local, solid.half[0], solid.half[1]) if solid.form is Form.RING else _outward(local)
    return np.asarray(faces @ np.array(solid.axes) + np.array(solid.centre))


def _without_hidden(solids: Sequence[Solid], surfaces: list[Floats]) -> list[Floats]:
    """Triangles of each solid's surface [n, 3, 3] without those that others hide.

    A triangle is hidden if there is material on its outer side, or if it lies on the surface of an earlier solid.
    """
    visible = []
    for number, triangles in enumerate(surfaces):
        outer, inner = (offset_points(triangles, distance).reshape(-1, 3) for distance in (_OFFSET, -_OFFSET))
        covered, duplicate = np.zeros(len(outer), dtype=bool), np.zeros(len(outer), dtype=bool)
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
    """Points [n, 4, 3] at a distance from triangles [n, 3, 3], on their outer side: over the middle, and near the corners."""
    centres = triangles.mean(axis=1, keepdims=True)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return np.concatenate([centres, centres + _SPREAD * (triangles - centres)], axis=1) + distance * normals[:, None]


def _outward(triangles: Floats) -> Floats:
    """Triangles of a convex solid around the origin, turned counter-clockwise from outside."""
    return _facing(triangles, triangles.mean(axis=1))


def _tube_outward(triangles: Floats, outer: float, inner: float) -> Floats:
    """Triangles of a tube around the third axis, turned outwards: inside the tube, towards the axis."""
    centres = triangles.mean(axis=1)
    directions = centres * np.array([1.0, 1.0, 0.0])
    directions[np.hypot(centres[:, 0], centres[:, 1]) < (outer + inner) / 2] *= -1.0
    is_end = np.ptp(triangles[:, :, 2], axis=1) < 1e-9
    directions[is_end] = centres[is_end] * np.array([0.0, 0.0, 1.0])
    return _facing(triangles, directions)


def _facing(triangles: Floats, directions: Floats) -> Floats:
    """Triangles turned to face ``directions`` [n, 3]."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_turned = np.einsum("ij,ij->i", normals, directions) < 0.0
    return np.where(is_turned[:, None, None], triangles[:, ::-1], triangles)


def _box(half: tuple[float, float, float]) -> Floats:
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return _outward(np.array([corners[[a, b, c]] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]))


def _revolved(profile: list[tuple[float, float]], radius: float, half: float, sides: int) -> Floats:
    """Surface of revolution: a profile of (radius, height), each 0..1, around the third axis."""
    angles = np.arange(sides + 1) * 2 * math.pi / sides
    rings = [
        np.column_stack([r * radius * np.cos(angles), r * radius * np.sin(angles), np.full(sides + 1, z * half)])
        for r, z in profile
    ]
    faces = []
    for (low, (low_radius, _)), (high, (high_radius, _)) in itertools.pairwise(zip(rings, profile, strict=True)):
        if low_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        if high_radius > _ON_AXIS:
            faces.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    return np.concatenate(faces)


def _polygon(radius: float, height: float, sides: int) -> Floats:
    """Disc across the third axis."""
    angles = np.arange(sides) * 2 * math.pi / sides
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(sides, height)])
    return np.stack([np.broadcast_to(rim[0], (sides - 2, 3)), rim[1:-1], rim[2:]], axis=1)


def _placed(local: Floats, site_axis: tuple[float, float, float], centre: tuple[float, float, float]) -> Floats:
    return np.asarray(local @ np.array(frame_of(site_axis)) + np.array(centre))


def _hole(site: Site) -> Floats:
    """Dark shapes at both ends of a hole: discs for pins, crosses for axles."""
    half = site.length / 2 + _DISC_OFFSET
    if site.fit is Fit.HOLE:
        discs = [_polygon(6.0, z * half, circle_sides(6.0, _CHORD_ERROR)) for z in (-1.0, 1.0)]
        return _placed(_outward(np.concatenate(discs)), site.axis, site.centre)
    blades = np.concatenate([_box((6.0, 2.0, half)), _box((2.0, 6.0, half))])
    return _placed(blades, site.axis, site.centre)
