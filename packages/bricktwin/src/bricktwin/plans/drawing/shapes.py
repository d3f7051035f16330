"""Shapes: triangle meshes with smooth normals, of primitives and of the triangles of solids. No
MuJoCo, no OpenGL."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.geometry import Floats, Triple, circle_sides, rotation

_CHORD_ERROR_MM = 0.12
"""Less than a pixel of the cameras, which are half a metre away."""
_SHARP = np.cos(np.radians(38.0))
"""Cosine of the smallest angle between two faces whose edge is drawn sharp."""

X_AXIS = (1.0, 0.0, 0.0)
Y_AXIS = (0.0, 1.0, 0.0)
Z_AXIS = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Shape:
    """Triangle mesh with smooth normals.

    Attributes:
        points: [n, 3] in mm.
        normals: [n, 3], of length 1.
        faces: [m, 3] indices of points, counter-clockwise seen from outside.
    """

    points: Floats
    normals: Floats
    faces: NDArray[np.int32]

    def at(self, x: float, y: float, z: float) -> "Shape":
        """The shape, translated."""
        return Shape(self.points + np.array([x, y, z]), self.normals, self.faces)

    def turned(self, axis: Triple, angle_deg: float) -> "Shape":
        """The shape, rotated about an axis through the origin."""
        turn = rotation(axis, math.radians(angle_deg))
        return Shape(self.points @ turn.T, self.normals @ turn.T, self.faces)

    def along(self, axis: Triple) -> "Shape":
        """The shape, rotated so that its z axis points along another axis."""
        if axis == X_AXIS:
            return self.turned(Y_AXIS, 90.0)
        if axis == Y_AXIS:
            return self.turned(X_AXIS, -90.0)
        return self


def box(length: float, width: float, height: float, radius: float = 0.6, arc: int = 2) -> Shape:
    """Box along x, y, z with rounded edges, centred: a sphere whose octants are moved to the
    corners."""
    half = np.array([length, width, height]) / 2 - radius
    quarter = np.linspace(0.0, math.pi / 2, arc + 1)
    polar = np.concatenate([quarter, quarter + math.pi / 2])
    azimuth = np.concatenate([quarter + quadrant * math.pi / 2 for quadrant in range(4)])
    signs_z = np.repeat([1.0, -1.0], arc + 1)
    signs_x = np.repeat([1.0, -1.0, -1.0, 1.0], arc + 1)
    signs_y = np.repeat([1.0, 1.0, -1.0, -1.0], arc + 1)
    rows = len(polar)
    columns = len(azimuth)
    normals = np.empty((rows, columns, 3))
    normals[..., 0] = np.sin(polar)[:, None] * np.cos(azimuth)
    normals[..., 1] = np.sin(polar)[:, None] * np.sin(azimuth)
    normals[..., 2] = np.cos(polar)[:, None]
    corners = np.stack(np.broadcast_arrays(signs_x, signs_y, signs_z[:, None]), axis=-1)
    points = corners * half + radius * normals
    corner_columns = np.arange(4) * (arc + 1)
    caps = [_fan(corner_columns), _fan((rows - 1) * columns + corner_columns[::-1])]
    return Shape(
        points.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate([_grid(rows, columns), *caps])
    )


def block(length: float, width: float, height: float) -> Shape:
    """Box along x, y, z with sharp edges, centred: for small parts, at a tenth of the faces of a
    rounded one."""
    corners = np.array(
        [
            [x, y, z]
            for z in (-1.0, 1.0)
            for x, y in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
        ]
    )
    sides = np.array(
        [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    )
    normals = corners[sides].mean(axis=1)
    faces = np.concatenate([_fan(np.arange(4) + 4 * side) for side in range(6)])
    return Shape(
        corners[sides].reshape(-1, 3) * np.array([length, width, height]) / 2,
        np.repeat(normals, 4, axis=0),
        faces,
    )


def turned(profile: Sequence[tuple[float, float]]) -> Shape:
    """Solid of revolution about z. ``profile``: (radius, z) from the top of the axis outwards and
    down to its bottom; all edges are sharp."""
    segments = circle_sides(max(radius for radius, _ in profile), _CHORD_ERROR_MM)
    parts = []
    angles = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    for (radius_0, z_0), (radius_1, z_1) in itertools.pairwise(profile):
        slope = np.array([z_0 - z_1, radius_1 - radius_0])
        across, up = slope / max(float(np.hypot(*slope)), 1e-9)
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        points = np.empty((2, segments, 3))
        normals = np.empty((2, segments, 3))
        for row, (radius, z) in enumerate(((radius_0, z_0), (radius_1, z_1))):
            points[row, :, :2] = radius * rim
            points[row, :, 2] = z
        normals[..., :2] = across * rim
        normals[..., 2] = up
        left, right = np.split(_grid(2, segments), 2)
        # on the axis, triangles have no area
        faces = [left] * (radius_1 > 0) + [right] * (radius_0 > 0)
        parts.append(Shape(points.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(faces)))
    return merge(parts)


def cylinder(radius: float, length: float, bevel: float = 0.0) -> Shape:
    """Disc or rod along z, centred."""
    half = length / 2
    edge = [
        (radius - bevel, half),
        (radius, half - bevel),
        (radius, bevel - half),
        (radius - bevel, -half),
    ]
    return turned([(0.0, half), *(edge if bevel else [edge[0], edge[2]]), (0.0, -half)])


def discs(radius: float, distance: float, segments: int = 10) -> Shape:
    """The two ends of a cylinder along z, centred: the visible part of a hole."""
    angles = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    ends = []
    for up in (1.0, -1.0):
        points = np.stack(
            [
                radius * np.cos(angles),
                up * radius * np.sin(angles),
                np.full(segments, up * distance / 2),
            ],
            axis=-1,
        )
        ends.append(
            Shape(points, np.tile((0.0, 0.0, up), (segments, 1)), _fan(np.arange(segments)))
        )
    return merge(ends)


def ring(outer: float, inner: float, length: float) -> Shape:
    """Flat ring along z, centred."""
    half = length / 2
    bevel = min(0.6, length / 4)
    edge = [
        (outer - bevel, half),
        (outer, half - bevel),
        (outer, bevel - half),
        (outer - bevel, -half),
    ]
    return turned([(inner, -half), (inner, half), *edge, (inner, -half)])


def extruded(outline: Floats, height: float, bevel: float = 0.4) -> Shape:
    """Convex outline [n, 2] in x, y, counter-clockwise, extruded along z, centred, with bevelled
    edges."""
    edges = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    outwards = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    inner = outline - bevel * outwards
    half = height / 2
    count = len(outline)
    rings = [(inner, half), (outline, half - bevel), (outline, bevel - half), (inner, -half)]
    levels = np.stack([np.column_stack([points, np.full(count, z)]) for points, z in rings])
    side = np.column_stack([outwards, np.zeros(count)])
    shapes = []
    for row, tilt in ((0, 1.0), (1, 0.0), (2, -1.0)):
        normal = (side + np.array([0.0, 0.0, tilt])) / math.hypot(1.0, tilt)
        shapes.append(
            Shape(
                levels[row : row + 2].reshape(-1, 3),
                np.concatenate([normal, normal]),
                _grid(2, count),
            )
        )
    for row, up in ((0, 1.0), (3, -1.0)):
        order = np.arange(count) if up > 0 else np.arange(count)[::-1]
        shapes.append(Shape(levels[row], np.tile((0.0, 0.0, up), (count, 1)), _fan(order)))
    return merge(shapes)


def rounded_rectangle(length: float, width: float, radius: float) -> Floats:
    """Outline [n, 2] of a rectangle along x, y with round corners, counter-clockwise."""
    arc = -(-circle_sides(radius, _CHORD_ERROR_MM) // 4)
    angles = np.concatenate(
        [np.linspace(0.0, math.pi / 2, arc + 1) + quadrant * math.pi / 2 for quadrant in range(4)]
    )
    signs = np.repeat([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)], arc + 1, axis=0)
    corners = signs * np.array([length / 2 - radius, width / 2 - radius])
    outline: Floats = corners + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return outline


def tube(points: Sequence[Triple], radius: float, steps: int = 14, segments: int = 8) -> Shape:
    """Tube along a Bezier curve with these control points."""
    order = len(points) - 1
    t = np.linspace(0.0, 1.0, steps)[:, None]
    path = sum(
        math.comb(order, i) * t**i * (1 - t) ** (order - i) * np.array(point)
        for i, point in enumerate(points)
    )
    direction = np.gradient(np.asarray(path), axis=0)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    first = np.empty_like(direction)
    across = np.cross(direction[0], Z_AXIS if abs(direction[0, 2]) < 0.9 else X_AXIS)
    for step, ahead in enumerate(direction):  # the section must not turn about the path
        across = across - (across @ ahead) * ahead
        first[step] = across = across / np.linalg.norm(across)
    second = np.cross(direction, first)
    angles = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    normals = (
        np.cos(angles)[None, :, None] * first[:, None]
        + np.sin(angles)[None, :, None] * second[:, None]
    )
    surface = np.asarray(path)[:, None] + radius * normals
    return Shape(surface.reshape(-1, 3), normals.reshape(-1, 3), _grid(steps, segments)[:, ::-1])


def merge(shapes: Sequence[Shape]) -> Shape:
    """Merge several shapes into one."""
    offsets = np.cumsum([0, *(len(shape.points) for shape in shapes[:-1])])
    return Shape(
        np.concatenate([shape.points for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
        np.concatenate(
            [shape.faces + offset for shape, offset in zip(shapes, offsets, strict=True)]
        ).astype(np.int32),
    )


def shape_of(triangles: Floats) -> Shape | None:
    """Mesh of triangles [n, 3, 3], smooth where they meet at small angles; ``None`` if none has an
    area."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(cross, axis=1)
    triangles = triangles[area > 1e-6]
    cross = cross[area > 1e-6]
    area = area[area > 1e-6]
    if not len(triangles):
        return None
    points = triangles.reshape(-1, 3)
    flat = np.repeat(cross / area[:, None], 3, axis=0)
    _, corner = np.unique(np.round(points, 3), axis=0, return_inverse=True)
    mean = np.zeros((corner.max() + 1, 3))
    np.add.at(mean, corner.ravel(), np.repeat(cross, 3, axis=0))
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    smooth = (mean / np.maximum(length, 1e-12))[corner.ravel()]
    is_smooth = np.einsum("ij,ij->i", smooth, flat) > _SHARP
    faces: NDArray[np.int32] = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Shape(points, np.where(is_smooth[:, None], smooth, flat), faces)


def _grid(rows: int, columns: int) -> NDArray[np.int32]:
    """Faces of a grid of points whose columns form a closed ring; seen from outside, rows go down
    and columns to the left."""
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a = (row * columns + column).ravel()
    b = (row * columns + (column + 1) % columns).ravel()
    c = a + columns
    d = b + columns
    return np.concatenate([np.stack([a, c, d], -1), np.stack([a, d, b], -1)]).astype(np.int32)


def _fan(indices: NDArray[np.intp]) -> NDArray[np.int32]:
    """Faces of a convex polygon."""
    first = np.full(len(indices) - 2, indices[0])
    return np.stack([first, indices[1:-1], indices[2:]], -1).astype(np.int32)
