"""Solids and directions in LDraw units (LDU): 0.4 mm, y downwards. A module, the distance between
holes, is 20 LDU."""

import enum
import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Triple = tuple[float, float, float]

MM_PER_LDU = 0.4
M_PER_LDU = MM_PER_LDU / 1000
_MIN_SIDES = 10
"""Sides of the coarsest polygon that looks round when it is shaded."""
_MIN_SAMPLED_HALF = 0.25
"""Half size (LDU) up to which a solid is filled by a single layer of points."""
_BOX_SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Signs [8, 3] of the corners of a box; the last axis runs fastest."""
AXES: dict[str, Triple] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def circle_sides(radius: float, chord_error: float) -> int:
    """Sides of the polygon that is drawn for a circle: at most ``chord_error`` away from it, and
    enough to look round when shaded."""
    # Half an angle a of a chord leaves a gap of r (1 - cos a), solved here for the sides. The share
    # ends at 1, because a circle smaller than the error has no such angle.
    share = min(chord_error / radius, 1.0)
    half_angle = math.acos(1.0 - share)
    sides = math.ceil(math.pi / half_angle)
    return max(_MIN_SIDES, sides)


def rotation(axis: Triple | Floats, angle: float) -> Floats:
    """Rotation matrix [3, 3] about a unit axis by an angle in radians (Rodrigues)."""
    x, y, z = axis
    # Multiplying by this matrix is the cross product with the axis.
    cross = np.array(
        [
            [0.0, -z, y],
            [z, 0.0, -x],
            [-y, x, 0.0],
        ]
    )
    sine = math.sin(angle)
    versine = 1.0 - math.cos(angle)
    return np.asarray(np.eye(3) + sine * cross + versine * cross @ cross)


def lines_coincide(
    point: Floats,
    axis: Floats,
    other: Floats,
    other_axis: Floats,
    *,
    offset: float,
    sine: float,
) -> bool:
    """Whether two lines, each a point [3] and a unit direction [3], are closer and more parallel
    than these limits."""
    distance = np.linalg.norm(np.cross(other - point, axis))
    tilt = np.linalg.norm(np.cross(axis, other_axis))
    return bool(distance < offset and tilt < sine)


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

    def contains(
        self,
        points: Floats,
        margin: float,
    ) -> Bools:
        """Whether points [n, 3] are deeper than ``margin`` below the surface [n]."""
        offset = points - np.array(self.centre)
        local = offset @ np.array(self.axes).T
        half = np.array(self.half) - margin
        # Rings are tested before thin solids are: the second half size of a ring is its bore, which
        # may be smaller than the margin.
        if self.form is Form.RING:
            radius = np.hypot(local[:, 0], local[:, 1])
            is_in_wall = (radius < half[0]) & (radius > self.half[1] + margin)
            is_between_ends = np.abs(local[:, 2]) < half[2]
            return np.asarray(is_in_wall & is_between_ends)
        if np.any(half <= 0):
            return np.zeros(len(points), dtype=bool)
        if self.form is Form.BOX:
            is_between_faces = np.abs(local) < half  # [n, 3]
            return np.asarray(is_between_faces.all(axis=1))
        if self.form is Form.CYLINDER:
            is_in_circle = np.hypot(local[:, 0], local[:, 1]) < half[0]
            is_between_ends = np.abs(local[:, 2]) < half[2]
            return np.asarray(is_in_circle & is_between_ends)
        distance = np.linalg.norm(local, axis=1)
        return np.asarray(distance < half[0])

    def samples(
        self,
        spacing: float,
        depth: float,
    ) -> Floats:
        """Points [n, 3] that fill the solid up to ``depth`` below its surface."""
        half = np.maximum(np.array(self.half) - depth, 0.0)
        # Points along each axis include both ends, and none are further apart than the spacing.
        gaps = np.ceil(2 * half / spacing).astype(int)
        counts = np.maximum(2, gaps + 1)
        lines: list[Floats] = []
        for size, count in zip(half, counts, strict=True):
            is_thick = size > _MIN_SAMPLED_HALF
            lines.append(np.linspace(-size, size, count) if is_thick else np.zeros(1))
        if self.form is Form.BOX:
            grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)  # [i, j, k, 3]
            local = grid.reshape(-1, 3)
        else:
            inner = self.half[1] + depth if self.form is Form.RING else 0.0
            local = _round_samples(
                half,
                inner,
                lines[2],
                spacing,
                is_ball=self.form is Form.BALL,
            )
        return np.asarray(local @ np.array(self.axes) + np.array(self.centre))

    @cached_property
    def frame(self) -> Floats:
        """The rows of ``axes`` as a matrix [3, 3]."""
        return np.array(self.axes)

    @cached_property
    def offset(self) -> Floats:
        """The centre along its own axes [3]."""
        return np.asarray(self.frame @ np.array(self.centre))

    def corners(self) -> Floats:
        """Corners [8, 3] of the bounding box along ``axes``."""
        return self._corners.copy()

    @cached_property
    def _corners(self) -> Floats:
        half = np.array(self.half)
        if self.form is Form.RING:
            # The second size of a ring is its bore, so the first one is used for both directions.
            half = np.array((self.half[0], self.half[0], self.half[2]))
        local = _BOX_SIGNS * half  # [8, 3]
        return np.asarray(local @ self.frame + np.array(self.centre))


def _round_samples(
    half: Floats,
    inner: float,
    heights: Floats,
    spacing: float,
    *,
    is_ball: bool,
) -> Floats:
    """Rings of points around the third axis, none closer to it than ``inner`` [n, 3]."""
    rings = []
    for height in heights:
        radius = float(half[0])
        if is_ball:
            radius = float(np.sqrt(max(half[0] ** 2 - height**2, 0.0)))
        # A wall that is thinner than twice the depth has no points inside.
        layers = 0
        if radius >= inner:
            layers = max(2, int(np.ceil((radius - inner) / spacing)) + 1)
        for ring_radius in np.linspace(radius, inner, layers):
            count = max(1, round(2 * np.pi * ring_radius / spacing))
            angles = np.arange(count) * spacing / max(ring_radius, 1e-9)
            x = ring_radius * np.cos(angles)
            y = ring_radius * np.sin(angles)
            z = np.full(len(angles), height)
            rings.append(np.column_stack([x, y, z]))
    return np.concatenate(rings) if rings else np.zeros((0, 3))


def frame_of(axis: Triple) -> tuple[Triple, Triple, Triple]:
    """Right-handed orthonormal axes; the third is along ``axis``."""
    third = np.array(axis) / np.linalg.norm(axis)
    # Gram-Schmidt makes x square to the axis, or y where the axis is so near to x that little would
    # be left of it.
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


def cylinder(
    centre: Triple,
    axis: Triple,
    length: float,
    radius: float,
) -> Solid:
    """A cylinder around ``axis``."""
    return Solid(
        Form.CYLINDER,
        centre,
        (radius, radius, length / 2),
        frame_of(axis),
    )


def ring(
    centre: Triple,
    axis: Triple,
    length: float,
    outer: float,
    inner: float,
) -> Solid:
    """A tube around ``axis``."""
    return Solid(
        Form.RING,
        centre,
        (outer, inner, length / 2),
        frame_of(axis),
    )


def ball(centre: Triple, radius: float) -> Solid:
    """A ball."""
    return Solid(Form.BALL, centre, (radius, radius, radius))


def bar(
    start: Triple,
    end: Triple,
    normal: Triple,
    width: float,
    thickness: float,
) -> Solid:
    """A box from ``start`` to ``end``; ``normal`` is the direction of its thickness."""
    start_point = np.array(start)
    end_point = np.array(end)
    up = np.array(normal)
    way = end_point - start_point
    length = np.linalg.norm(way)
    along = way / length
    across = np.cross(up, along)
    middle = (start_point + end_point) / 2
    half = (float(length) / 2, width / 2, thickness / 2)
    axes = (triple(along), triple(across), triple(up))
    return Solid(
        Form.BOX,
        triple(middle),
        half,
        axes,
    )
