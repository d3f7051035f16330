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
"""Largest distance of a circle from its polygon, mm. This is less than a pixel of the cameras,
which are half a metre away."""
_SHARP = np.cos(np.radians(38.0))
"""Cosine of the smallest angle between two faces whose edge is drawn sharp."""
_MIN_AREA = 1e-6
"""Least area of a triangle whose normal means something, in twice the square of its unit."""

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

    def at(
        self,
        x: float,
        y: float,
        z: float,
    ) -> "Shape":
        """The shape, translated."""
        return Shape(self.points + np.array([x, y, z]), self.normals, self.faces)

    def turned(
        self,
        axis: Triple,
        angle_deg: float,
    ) -> "Shape":
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


# Most shapes below are grids of points, in the order that `_grid` needs: a row is a ring around z,
# and seen from outside rows go down and columns to the left.


def box(
    length: float,
    width: float,
    height: float,
    radius: float = 0.6,
    arc: int = 2,
) -> Shape:
    """Box along x, y, z with rounded edges, centred: a sphere whose octants are moved to the
    corners."""
    half = np.array([length, width, height]) / 2 - radius
    quarter = np.linspace(0.0, math.pi / 2, arc + 1)  # [arc + 1]
    quarters = [quarter + quadrant * math.pi / 2 for quadrant in range(4)]
    # The equator stands twice, and so does each meridian between two octants: each octant moves its
    # own copy to its corner.
    polar = np.concatenate([quarter, quarter + math.pi / 2])
    azimuth = np.concatenate(quarters)
    signs_z = np.repeat([1.0, -1.0], arc + 1)
    signs_x = np.repeat([1.0, -1.0, -1.0, 1.0], arc + 1)
    signs_y = np.repeat([1.0, 1.0, -1.0, -1.0], arc + 1)
    row_count = len(polar)
    column_count = len(azimuth)
    # Rounding a box moves the points of a sphere but not its normals, which are those of the box.
    across = np.sin(polar)[:, None]  # [rows, 1]
    normals = np.empty((row_count, column_count, 3))
    normals[..., 0] = across * np.cos(azimuth)
    normals[..., 1] = across * np.sin(azimuth)
    normals[..., 2] = np.cos(polar)[:, None]
    signs = np.broadcast_arrays(signs_x, signs_y, signs_z[:, None])
    corners = np.stack(signs, axis=-1)  # [rows, columns, 3]
    points = corners * half + radius * normals
    # The grid leaves the top and the bottom of the box open. At each pole its row is four different
    # points, which are the corners of that side.
    corner_columns = np.arange(4) * (arc + 1)
    last_row = (row_count - 1) * column_count
    sides = _grid(row_count, column_count)
    top = _fan(corner_columns)
    bottom = _fan(last_row + corner_columns[::-1])
    faces = np.concatenate([sides, top, bottom])
    return Shape(points.reshape(-1, 3), normals.reshape(-1, 3), faces)


def block(
    length: float,
    width: float,
    height: float,
) -> Shape:
    """Box along x, y, z with sharp edges, centred: for small parts, at a tenth of the faces of a
    rounded one."""
    square = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    lower = np.column_stack([square, np.full(4, -1.0)])
    upper = np.column_stack([square, np.full(4, 1.0)])
    corners = np.concatenate([lower, upper])  # [8, 3]
    sides = np.array(
        [
            [0, 3, 2, 1],
            [4, 5, 6, 7],
            [0, 1, 5, 4],
            [1, 2, 6, 5],
            [2, 3, 7, 6],
            [3, 0, 4, 7],
        ]
    )
    side_corners = corners[sides]  # [6, 4, 3]
    # The cube is 2 wide and centred, so the middle of a side is also its normal.
    normals = side_corners.mean(axis=1)
    size = np.array([length, width, height])
    points = side_corners.reshape(-1, 3) * size / 2
    faces = [_fan(np.arange(4) + 4 * side) for side in range(6)]
    return Shape(points, np.repeat(normals, 4, axis=0), np.concatenate(faces))


def turned(profile: Sequence[tuple[float, float]]) -> Shape:
    """Solid of revolution about z. ``profile``: (radius, z) from the top of the axis outwards and
    down to its bottom; all edges are sharp."""
    widest = max(radius for radius, _ in profile)
    segments = circle_sides(widest, _CHORD_ERROR_MM)
    angles = np.linspace(
        0.0,
        2 * math.pi,
        segments,
        endpoint=False,
    )
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # [segments, 2]
    # Each piece of the profile has its own points and normals, which keeps the edges between them
    # sharp.
    bands = [_band(start, end, rim) for start, end in itertools.pairwise(profile)]
    return merge(bands)


def _band(
    start: tuple[float, float],
    end: tuple[float, float],
    rim: Floats,
) -> Shape:
    """One piece of a profile, from one (radius, z) to the next, around z along a rim [n, 2] of
    radius 1."""
    segments = len(rim)
    radius_0, z_0 = start
    radius_1, z_1 = end
    # The normal is across the piece, on its outer side. The limit keeps that of a piece without a
    # length at 0.
    slope = np.array([z_0 - z_1, radius_1 - radius_0])
    across, up = slope / max(float(np.hypot(*slope)), 1e-9)
    points = np.empty((2, segments, 3))
    for row, (radius, z) in enumerate((start, end)):
        points[row, :, :2] = radius * rim
        points[row, :, 2] = z
    normals = np.empty((2, segments, 3))
    normals[..., :2] = across * rim
    normals[..., 2] = up
    left, right = np.split(_grid(2, segments), 2)
    # A triangle with two corners on the axis has no area and is left out.
    faces = []
    if radius_1 > 0:
        faces.append(left)
    if radius_0 > 0:
        faces.append(right)
    return Shape(points.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(faces))


def cylinder(
    radius: float,
    length: float,
    bevel: float = 0.0,
) -> Shape:
    """Disc or rod along z, centred."""
    half = length / 2
    edge = _bevelled(radius, half, bevel)
    if not bevel:
        # Without a bevel, the four points of the edge are two pairs of equal ones.
        edge = [edge[0], edge[2]]
    return turned([(0.0, half), *edge, (0.0, -half)])


def _bevelled(
    radius: float,
    half: float,
    bevel: float,
) -> list[tuple[float, float]]:
    """The outside of a profile, (radius, z) from the top down, with bevels at both edges."""
    return [
        (radius - bevel, half),
        (radius, half - bevel),
        (radius, bevel - half),
        (radius - bevel, -half),
    ]


def discs(
    radius: float,
    distance: float,
    segments: int = 10,
) -> Shape:
    """The two ends of a cylinder along z, centred: the visible part of a hole."""
    angles = np.linspace(
        0.0,
        2 * math.pi,
        segments,
        endpoint=False,
    )
    ends = []
    for up in (1.0, -1.0):
        x = radius * np.cos(angles)
        # Faces are counter-clockwise seen from outside, so the lower end goes round the other way.
        y = up * radius * np.sin(angles)
        z = np.full(segments, up * distance / 2)
        points = np.stack([x, y, z], axis=-1)
        normals = np.tile((0.0, 0.0, up), (segments, 1))
        ends.append(Shape(points, normals, _fan(np.arange(segments))))
    return merge(ends)


def ring(
    outer: float,
    inner: float,
    length: float,
) -> Shape:
    """Flat ring along z, centred."""
    half = length / 2
    # The bevels of a thin ring are made smaller, so that they do not meet.
    bevel = min(0.6, length / 4)
    edge = _bevelled(outer, half, bevel)
    return turned([(inner, -half), (inner, half), *edge, (inner, -half)])


def extruded(
    outline: Floats,
    height: float,
    bevel: float = 0.4,
) -> Shape:
    """Convex outline [n, 2] in x, y, counter-clockwise, extruded along z, centred, with bevelled
    edges."""
    # The normal at a corner is across the line between its two neighbours.
    following = np.roll(outline, -1, axis=0)
    preceding = np.roll(outline, 1, axis=0)
    edges = following - preceding  # [n, 2]
    outwards = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    inner = outline - bevel * outwards
    half = height / 2
    count = len(outline)
    rings = [(inner, half), (outline, half - bevel), (outline, bevel - half), (inner, -half)]
    rows = [np.column_stack([points, np.full(count, z)]) for points, z in rings]
    levels = np.stack(rows)  # [4, n, 3]
    side = np.column_stack([outwards, np.zeros(count)])  # [n, 3]
    shapes = []
    # The levels run from the top down: a bevel at 45 degrees, the side, a bevel. Each has its own
    # points, so that its edges are sharp.
    for row, tilt in ((0, 1.0), (1, 0.0), (2, -1.0)):
        leaning = side + np.array([0.0, 0.0, tilt])
        normals = leaning / math.hypot(1.0, tilt)
        points = levels[row : row + 2].reshape(-1, 3)
        both_normals = np.concatenate([normals, normals])
        shapes.append(Shape(points, both_normals, _grid(2, count)))
    upwards = np.tile((0.0, 0.0, 1.0), (count, 1))
    downwards = np.tile((0.0, 0.0, -1.0), (count, 1))
    order = np.arange(count)
    shapes.append(Shape(levels[0], upwards, _fan(order)))
    # Seen from below the outline goes round the other way, so its order is reversed.
    shapes.append(Shape(levels[3], downwards, _fan(order[::-1])))
    return merge(shapes)


def rounded_rectangle(
    length: float,
    width: float,
    radius: float,
) -> Floats:
    """Outline [n, 2] of a rectangle along x, y with round corners, counter-clockwise."""
    # All four quarters must be equal, so the pieces of a quarter are rounded up.
    arc = -(-circle_sides(radius, _CHORD_ERROR_MM) // 4)
    quarter = np.linspace(0.0, math.pi / 2, arc + 1)
    quarters = [quarter + quadrant * math.pi / 2 for quadrant in range(4)]
    angles = np.concatenate(quarters)  # [n]
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # [n, 2]
    corner_signs = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
    signs = np.repeat(corner_signs, arc + 1, axis=0)
    corners = signs * np.array([length / 2 - radius, width / 2 - radius])  # [n, 2]
    outline: Floats = corners + radius * circle
    return outline


def tube(
    points: Sequence[Triple],
    radius: float,
    steps: int = 14,
    segments: int = 8,
) -> Shape:
    """Tube along a Bezier curve with these control points."""
    path = _bezier(points, steps)
    direction = np.gradient(path, axis=0)  # [steps, 3]
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    # `first` and `second` are two directions across the path at each step. The section must not
    # turn about the path, which would twist the tube, so each first direction is the one before it,
    # made square to the path.
    first = np.empty_like(direction)
    across = np.cross(direction[0], Z_AXIS if abs(direction[0, 2]) < 0.9 else X_AXIS)
    for step, ahead in enumerate(direction):
        across = across - (across @ ahead) * ahead
        across = across / np.linalg.norm(across)
        first[step] = across
    second = np.cross(direction, first)
    angles = np.linspace(
        0.0,
        2 * math.pi,
        segments,
        endpoint=False,
    )
    cosines = np.cos(angles)[None, :, None]
    sines = np.sin(angles)[None, :, None]
    normals = cosines * first[:, None] + sines * second[:, None]  # [steps, segments, 3]
    surface = path[:, None] + radius * normals
    # Seen from outside the columns go to the right here, the reverse of what `_grid` expects, so
    # each face is turned over.
    faces = _grid(steps, segments)[:, ::-1]
    return Shape(surface.reshape(-1, 3), normals.reshape(-1, 3), faces)


def _bezier(points: Sequence[Triple], steps: int) -> Floats:
    """Points [steps, 3] of a Bezier curve: control points, weighted by Bernstein polynomials."""
    order = len(points) - 1
    t = np.linspace(0.0, 1.0, steps)[:, None]  # [steps, 1]
    path = np.zeros((steps, 3))
    for i, point in enumerate(points):
        weights = math.comb(order, i) * t**i * (1 - t) ** (order - i)  # [steps, 1]
        path = path + weights * np.array(point)
    return path


def merge(shapes: Sequence[Shape]) -> Shape:
    """Merge several shapes into one."""
    # Faces of each shape are moved by the number of points before it.
    counts = [len(shape.points) for shape in shapes]
    offsets = np.cumsum([0, *counts[:-1]])
    moved = [shape.faces + offset for shape, offset in zip(shapes, offsets, strict=True)]
    points = np.concatenate([shape.points for shape in shapes])
    normals = np.concatenate([shape.normals for shape in shapes])
    return Shape(points, normals, np.concatenate(moved).astype(np.int32))


def shape_of(triangles: Floats) -> Shape | None:
    """Mesh of triangles [n, 3, 3], smooth where they meet at small angles; ``None`` if none has an
    area."""
    along = triangles[:, 1] - triangles[:, 0]
    across = triangles[:, 2] - triangles[:, 0]
    cross = np.cross(along, across)  # [n, 3], of twice the triangle's area
    area = np.linalg.norm(cross, axis=1)
    has_area = area > _MIN_AREA
    triangles = triangles[has_area]
    cross = cross[has_area]
    area = area[has_area]
    if not len(triangles):
        return None
    points = triangles.reshape(-1, 3)  # [3 n, 3]
    flat = np.repeat(cross / area[:, None], 3, axis=0)  # [3 n, 3]
    # Corners that agree to a thousandth are one point. The sum of the cross products of its
    # triangles is a mean normal in which large triangles count more.
    rounded = np.round(points, 3)
    _, inverse = np.unique(rounded, axis=0, return_inverse=True)
    corner = inverse.ravel()  # [3 n]
    mean = np.zeros((corner.max() + 1, 3))
    np.add.at(mean, corner, np.repeat(cross, 3, axis=0))
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    unit_mean = mean / np.maximum(length, 1e-12)
    smooth = unit_mean[corner]  # [3 n, 3]
    # Where a triangle's own normal is far from the mean, there is an edge, which is drawn flat.
    cosine = np.einsum("ij,ij->i", smooth, flat)  # [3 n]
    is_smooth = cosine > _SHARP
    normals = np.where(is_smooth[:, None], smooth, flat)
    faces: NDArray[np.int32] = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return Shape(points, normals, faces)


def _grid(rows: int, columns: int) -> NDArray[np.int32]:
    """Faces of a grid of points whose columns form a closed ring; seen from outside, rows go down
    and columns to the left."""
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    # Seen from outside, a cell has the corners a and to its left b, and below them c and d. Their
    # order makes faces counter-clockwise.
    a = (row * columns + column).ravel()
    b = (row * columns + (column + 1) % columns).ravel()
    c = a + columns
    d = b + columns
    # The first halves of all cells come before all second halves, because `_band` splits them
    # there.
    first_halves = np.stack([a, c, d], -1)
    second_halves = np.stack([a, d, b], -1)
    return np.concatenate([first_halves, second_halves]).astype(np.int32)


def _fan(indices: NDArray[np.intp]) -> NDArray[np.int32]:
    """Faces of a convex polygon."""
    first = np.full(len(indices) - 2, indices[0])
    return np.stack([first, indices[1:-1], indices[2:]], -1).astype(np.int32)
