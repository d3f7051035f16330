"""Solids and directions in LDraw units (LDU): 0.4 mm, y downwards. A module, the distance between
holes, is 20 LDU."""

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Triple = tuple[float, float, float]

MM_PER_LDU = 0.4
M_PER_LDU = MM_PER_LDU / 1000
_MIN_SIDES = 10
AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def circle_sides(radius: float, chord_error: float) -> int:
    """Sides of the polygon that is drawn for a circle: at most ``chord_error`` away from it, and
    enough to look round when shaded. A segment's height is r (1 - cos(pi / sides))."""
    return max(_MIN_SIDES, math.ceil(math.pi / math.acos(1.0 - min(chord_error / radius, 1.0))))


def rotation(axis: Triple | Floats, angle: float) -> Floats:
    """Rotation matrix [3, 3] about a unit axis by an angle in radians (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


def lines_coincide(
    point: Floats, axis: Floats, other: Floats, other_axis: Floats, *, offset: float, sine: float
) -> bool:
    """Whether two lines, each a point [3] and a unit direction [3], are closer and more parallel
    than these limits."""
    distance = np.linalg.norm(np.cross(other - point, axis))
    return bool(distance < offset and np.linalg.norm(np.cross(axis, other_axis)) < sine)


class Form(enum.Enum):
    """Kinds of solids."""

    BOX = "box"
    CYLINDER = "cylinder"
    BALL = "ball"
    RING = "ring"


@dataclass(frozen=True)
class Solid:
    """A convex solid of a part.

    Attributes:
        centre: midpoint.
        half: half sizes along ``axes``: cylinder (radius, radius, half length), ball (radius,) * 3,
            ring (outer radius, inner radius, half length).
        axes: rows of length 1; the third is the axis of a cylinder.
    """

    form: Form
    centre: Triple
    half: Triple
    axes: tuple[Triple, Triple, Triple] = (AXES["x"], AXES["y"], AXES["z"])

    def contains(self, points: Floats, margin: float) -> Bools:
        """Whether points [n, 3] are deeper than ``margin`` below the surface [n]."""
        local = (points - np.array(self.centre)) @ np.array(self.axes).T
        half = np.array(self.half) - margin
        if self.form is Form.RING:
            radius = np.hypot(local[:, 0], local[:, 1])
            within = (radius < half[0]) & (radius > self.half[1] + margin)
            return np.asarray(within & (np.abs(local[:, 2]) < half[2]))
        if np.any(half <= 0):
            return np.zeros(len(points), dtype=bool)
        if self.form is Form.BOX:
            return np.asarray((np.abs(local) < half).all(axis=1))
        if self.form is Form.CYLINDER:
            return np.asarray(
                (np.hypot(local[:, 0], local[:, 1]) < half[0]) & (np.abs(local[:, 2]) < half[2])
            )
        return np.asarray(np.linalg.norm(local, axis=1) < half[0])

    def normals(self, points: Floats) -> Floats:
        """Outward normals [n, 3] at points [n, 3] on the surface: of the face that is nearest."""
        axes = np.array(self.axes)
        local = (points - np.array(self.centre)) @ axes.T
        if self.form is Form.BALL:
            return np.asarray(
                local @ axes / np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-9)
            )
        normals = np.zeros_like(local)
        rows = np.arange(len(local))
        if self.form is Form.BOX:
            face = np.argmin(np.array(self.half) - np.abs(local), axis=1)
            normals[rows, face] = np.sign(local[rows, face])
            return np.asarray(normals @ axes)
        radius = np.maximum(np.hypot(local[:, 0], local[:, 1]), 1e-9)
        gaps = [np.abs(self.half[2] - np.abs(local[:, 2])), np.abs(self.half[0] - radius)]
        face = np.argmin(
            [*gaps, np.abs(radius - self.half[1])] if self.form is Form.RING else gaps, axis=0
        )
        sides = local[:, :2] / radius[:, None] * np.where(face == 2, -1.0, 1.0)[:, None]
        normals[:, :2], normals[:, 2] = (
            np.where((face == 0)[:, None], 0.0, sides),
            np.where(face == 0, np.sign(local[:, 2]), 0.0),
        )
        return np.asarray(normals @ axes)

    def samples(self, spacing: float, depth: float) -> Floats:
        """Points [n, 3] that fill the solid up to ``depth`` below its surface."""
        half = np.maximum(np.array(self.half) - depth, 0.0)
        counts = np.maximum(2, np.ceil(2 * half / spacing).astype(int) + 1)
        lines = [
            np.linspace(-size, size, count) if size > 0.25 else np.zeros(1)
            for size, count in zip(half, counts, strict=True)
        ]
        if self.form is Form.BOX:
            local = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        else:
            inner = self.half[1] + depth if self.form is Form.RING else 0.0
            local = _round_samples(half, inner, lines[2], spacing, is_ball=self.form is Form.BALL)
        return np.asarray(local @ np.array(self.axes) + np.array(self.centre))

    def corners(self) -> Floats:
        """Corners [8, 3] of the bounding box along ``axes``."""
        signs = np.array(
            [[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float
        )
        half = np.array(
            self.half if self.form is not Form.RING else (self.half[0], self.half[0], self.half[2])
        )
        return np.asarray((signs * half) @ np.array(self.axes) + np.array(self.centre))


def _round_samples(
    half: Floats, inner: float, heights: Floats, spacing: float, *, is_ball: bool
) -> Floats:
    """Rings of points around the third axis, none closer to it than ``inner`` [n, 3]."""
    rows = []
    for height in heights:
        radius = float(np.sqrt(max(half[0] ** 2 - height**2, 0.0))) if is_ball else float(half[0])
        layers = max(2, int(np.ceil((radius - inner) / spacing)) + 1) if radius >= inner else 0
        for ring in np.linspace(radius, inner, layers):
            angles = (
                np.arange(max(1, round(2 * np.pi * ring / spacing))) * spacing / max(ring, 1e-9)
            )
            rows.append(
                np.column_stack(
                    [ring * np.cos(angles), ring * np.sin(angles), np.full(len(angles), height)]
                )
            )
    return np.concatenate(rows) if rows else np.zeros((0, 3))


def frame_of(axis: Triple) -> tuple[Triple, Triple, Triple]:
    """Right-handed orthonormal axes; the third is along ``axis``."""
    third = np.array(axis) / np.linalg.norm(axis)
    helper = np.array(AXES["x"] if abs(third[0]) < 0.9 else AXES["y"])
    first = helper - (helper @ third) * third
    first /= np.linalg.norm(first)
    second = np.cross(third, first)
    return triple(first), triple(second), triple(third)


def triple(values: Floats) -> Triple:
    """An array [3] as a tuple."""
    return float(values[0]), float(values[1]), float(values[2])


def box(centre: Triple, size: Triple) -> Solid:
    """An axis-aligned box; ``size`` is the full size."""
    return Solid(Form.BOX, centre, (size[0] / 2, size[1] / 2, size[2] / 2))


def cylinder(centre: Triple, axis: Triple, length: float, radius: float) -> Solid:
    """A cylinder around ``axis``."""
    return Solid(Form.CYLINDER, centre, (radius, radius, length / 2), frame_of(axis))


def ring(centre: Triple, axis: Triple, length: float, outer: float, inner: float) -> Solid:
    """A tube around ``axis``."""
    return Solid(Form.RING, centre, (outer, inner, length / 2), frame_of(axis))


def ball(centre: Triple, radius: float) -> Solid:
    """A ball."""
    return Solid(Form.BALL, centre, (radius, radius, radius))


def bar(start: Triple, end: Triple, normal: Triple, width: float, thickness: float) -> Solid:
    """A box from ``start`` to ``end``; ``normal`` is the direction of its thickness."""
    a = np.array(start)
    b = np.array(end)
    up = np.array(normal)
    along = (b - a) / np.linalg.norm(b - a)
    half = (float(np.linalg.norm(b - a)) / 2, width / 2, thickness / 2)
    return Solid(
        Form.BOX,
        triple((a + b) / 2),
        half,
        (triple(along), triple(np.cross(up, along)), triple(up)),
    )
