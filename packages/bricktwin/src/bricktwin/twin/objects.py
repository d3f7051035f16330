"""Objects of a scene: lines, fields and pictures on the floor, walls, fixed and pushable blocks,
balls, ramps and lamps.

Positions are millimetres on the floor, ``(x, y)``: a robot that starts at the origin with a heading
of 0 looks along x, y is to its left. Headings are degrees, clockwise seen from above. What
lies on the floor affects colour sensors only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError, counted
from bricktwin.plans.geometry import Floats
from bricktwin.twin.picture import Picture, read_picture

__all__ = [
    "COLORS",
    "Ball",
    "Block",
    "Field",
    "Lamp",
    "Line",
    "Mark",
    "Object",
    "Picture",
    "Point",
    "Pushable",
    "Ramp",
    "Size",
    "Solid",
    "Wall",
    "oval",
    "read_picture",
]

Point = tuple[float, float]
Size = tuple[float, float, float]

COLORS: dict[str, Size] = {
    "white": (0.93, 0.93, 0.93),
    "light_grey": (0.70, 0.70, 0.72),
    "grey": (0.40, 0.40, 0.42),
    "black": (0.07, 0.07, 0.08),
    "red": (0.80, 0.06, 0.08),
    "orange": (0.95, 0.45, 0.08),
    "yellow": (0.96, 0.80, 0.12),
    "green": (0.08, 0.55, 0.22),
    "blue": (0.08, 0.30, 0.75),
    "purple": (0.45, 0.18, 0.62),
    "brown": (0.42, 0.26, 0.14),
}
"""Reflectance of red, green and blue light, by colour name."""
_COMPLEX = np.array((1.0, 1.0j))
"""Points times this are complex numbers, which NumPy adds and multiplies faster than pairs."""
_ROUNDING_MM = 1e-6
"""More than the rounding error of a distance on the floor."""


@dataclass(frozen=True)
class Line:
    """Line on the floor, such as tape. Raises TwinError if a value is invalid.

    Attributes:
        points_mm: corners of the polyline.
        width_mm: width from edge to edge.
        closed: whether the last point is connected to the first.
    """

    points_mm: tuple[Point, ...]
    width_mm: float = 20.0
    color: str = "black"
    closed: bool = False

    def __post_init__(self) -> None:
        _check(
            self.color,
            "a line",
            (self.width_mm,),
            1,
            self.points_mm,
        )
        # lists are welcome
        object.__setattr__(self, "points_mm", tuple(map(tuple, self.points_mm)))
        if len(self.points_mm) < 2:
            raise TwinError(
                f"scene: a line of {counted(len(self.points_mm), 'point')}; give two or more"
            )

    @property
    def ends_mm(self) -> tuple[Floats, Floats]:
        """Start and end of each segment, ``[n, 2]`` each."""
        corners = self.points_mm
        if self.closed:
            corners += corners[:1]
        points = np.array(corners, dtype=np.float64)
        return points[:-1], points[1:]

    @cached_property
    def _segments(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128], Floats]:
        """Start, rotation to the x axis, and length of each segment as complex numbers, ``[3, n]``,
        its middle, and how far from there it covers something, ``[n]`` each."""
        starts, ends = (points @ _COMPLEX for points in self.ends_mm)
        along = ends - starts
        lengths = np.abs(along)
        turns = np.exp(-1j * np.angle(along))
        segments = np.stack([starts, turns, lengths])
        middles = (starts + ends) / 2
        reaches = (lengths + self.width_mm) / 2 + _ROUNDING_MM
        return segments, middles, reaches

    def covers(self, points_mm: Floats) -> NDArray[np.bool_]:
        """Whether points ``[n, 2]`` are on it; ``[n]``. Only segments that may reach the points are
        looked at closely."""
        segments, middles, reaches = self._segments
        points = points_mm @ _COMPLEX
        # All points are within this distance of the first one.
        first = points[0]
        spread_mm = np.maximum.reduce(np.abs(points - first))
        is_near = np.abs(middles - first) <= reaches + spread_mm
        starts, turns, lengths = segments[:, is_near]
        # In the frame of each segment, which lies along the real axis: [points, segments].
        offsets = (points[:, None] - starts) * turns
        after_start = np.maximum(offsets.real, 0.0)
        nearest = np.minimum(after_start, lengths.real)
        is_on_segment = np.abs(offsets - nearest) <= self.width_mm / 2
        # `reduce`, as `any` takes longer for so few values, and a sensor reads often.
        covered: NDArray[np.bool_] = np.logical_or.reduce(is_on_segment, 1)
        return covered


@dataclass(frozen=True)
class Field:
    """Coloured rectangle or ellipse on the floor. Raises TwinError if a value is invalid.

    Attributes:
        at_mm: its centre.
        size_mm: size along x and y, before rotation.
        round: whether it is an ellipse of that size.
    """

    at_mm: Point
    size_mm: Point
    color: str = "red"
    heading_deg: float = 0.0
    round: bool = False

    def __post_init__(self) -> None:
        _check(
            self.color,
            "a field",
            self.size_mm,
            2,
            (self.at_mm, (self.heading_deg, 0.0)),
        )

    def covers(self, points_mm: Floats) -> NDArray[np.bool_]:
        """Whether points ``[n, 2]`` are on it; ``[n]``."""
        yaw = -math.radians(self.heading_deg)
        cosine = math.cos(yaw)
        sine = math.sin(yaw)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        # Points in the field's own frame, where its edges are at 1.
        offsets_mm = (points_mm - np.array(self.at_mm)) @ turn
        half_mm = np.array(self.size_mm) / 2
        scaled = np.abs(offsets_mm) / half_mm
        covered: NDArray[np.bool_]
        if self.round:
            radii = (scaled**2).sum(-1)
            covered = radii <= 1.0
            return covered
        covered = scaled.max(-1) <= 1.0
        return covered


@dataclass(frozen=True)
class Wall:
    """Wall between two points; a soft one, such as a curtain, swallows ultrasound. Raises TwinError
    if a value is invalid."""

    from_mm: Point
    to_mm: Point
    height_mm: float = 100.0
    thickness_mm: float = 16.0
    color: str = "red"
    soft: bool = False

    def __post_init__(self) -> None:
        sizes = (self.height_mm, self.thickness_mm)
        _check(
            self.color,
            "a wall",
            sizes,
            2,
            (self.from_mm, self.to_mm),
        )
        if self.from_mm == self.to_mm:
            raise TwinError(f"scene: a wall from {self.from_mm} to the same point; give two")


@dataclass(frozen=True)
class Block:
    """Block, or with ``round`` an upright cylinder, that is fixed or, with a mass, can be pushed.
    Raises TwinError if a value is invalid.

    Attributes:
        at_mm: its centre.
        size_mm: size along x and y, before rotation, and height.
        mass_g: mass; ``None`` for a fixed block.
        spread_mm: maximum random shift along x and y at the start of each episode; only with a
            mass.
        soft: whether it swallows ultrasound, as a cushion or a person does.
    """

    at_mm: Point
    size_mm: Size = (64.0, 64.0, 64.0)
    color: str = "blue"
    heading_deg: float = 0.0
    mass_g: float | None = None
    round: bool = False
    spread_mm: Point = (0.0, 0.0)
    soft: bool = False

    def __post_init__(self) -> None:
        # A heading is checked as one of a pair, as it has to be finite, too.
        points = (self.at_mm, self.spread_mm, (self.heading_deg, 0.0))
        _check(
            self.color,
            "a block",
            self.size_mm,
            3,
            points,
        )
        is_mass = self.mass_g is None or (math.isfinite(self.mass_g) and self.mass_g > 0)
        if not is_mass:
            raise TwinError(
                f"scene: a block of {self.mass_g} g; give a positive mass, or None for one that "
                "stands still"
            )
        is_fixed = self.mass_g is None
        if min(self.spread_mm) < 0 or (is_fixed and any(self.spread_mm)):
            raise TwinError(
                f"scene: a spread of {self.spread_mm} mm; give 0 or more, and a mass to what is "
                "to be moved"
            )


@dataclass(frozen=True)
class Ball:
    """Ball that rolls. Raises TwinError if a value is invalid.

    Attributes:
        at_mm: where it lies on the floor.
        spread_mm: as of a block.
    """

    at_mm: Point
    diameter_mm: float = 74.0
    color: str = "orange"
    mass_g: float = 60.0
    spread_mm: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        _check(
            self.color,
            "a ball",
            (self.diameter_mm,),
            1,
            (self.at_mm, self.spread_mm),
        )
        if not (math.isfinite(self.mass_g) and self.mass_g > 0):
            raise TwinError(f"scene: a ball of {self.mass_g} g; give a positive mass")
        if min(self.spread_mm) < 0:
            raise TwinError(f"scene: a spread of {self.spread_mm} mm; give 0 or more")

    @property
    def soft(self) -> bool:
        """Whether it swallows ultrasound; it does not."""
        return False


@dataclass(frozen=True)
class Ramp:
    """Ramp that begins at the floor. Raises TwinError if a value is invalid.

    Attributes:
        at_mm: middle of its lower edge.
        heading_deg: direction in which it rises.
        length_mm: length on the floor; ``height_mm`` is that of its upper end.
        soft: as of a block.
    """

    at_mm: Point
    length_mm: float = 400.0
    width_mm: float = 300.0
    height_mm: float = 60.0
    heading_deg: float = 0.0
    color: str = "light_grey"
    soft: bool = False

    def __post_init__(self) -> None:
        size = (self.length_mm, self.width_mm, self.height_mm)
        _check(
            self.color,
            "a ramp",
            size,
            3,
            (self.at_mm, (self.heading_deg, 0.0)),
        )


@dataclass(frozen=True)
class Lamp:
    """Lamp, detected by ambient light sensors. Raises TwinError if a value is invalid.

    Attributes:
        at_mm: position and height.
        light_pct: reading of a sensor that faces it from 300 mm away.
    """

    at_mm: Size
    light_pct: float = 80.0

    def __post_init__(self) -> None:
        if not _are_numbers(self.at_mm, 3) or not 0.0 < self.light_pct <= 100.0:
            raise TwinError(
                f"scene: a lamp at {self.at_mm} of {self.light_pct} %; give a place (x, y, "
                "height) in mm, and up to 100 %"
            )


Mark = Line | Field | Picture
Pushable = Block | Ball
Solid = Wall | Block | Ball | Ramp
Object = Mark | Solid | Lamp


def oval(length_mm: float, width_mm: float) -> tuple[Point, ...]:
    """Points of a closed line with half circles as ends, of this total size, from the origin along
    x, then to the left."""
    radius = width_mm / 2
    straight = length_mm - width_mm
    if straight < 0 or radius <= 0:
        raise TwinError(
            f"scene: an oval of {length_mm} x {width_mm} mm; give a length of at least its width"
        )
    quarter = math.pi / 2
    angles = np.linspace(-quarter, quarter, 25)
    x = straight / 2 + radius * np.cos(angles)
    y = radius + radius * np.sin(angles)
    right = np.stack([x, y], -1)  # [25, 2]
    # The other end is the same, turned by half a turn about the middle.
    left = right * (-1.0, -1.0) + (0.0, width_mm)
    points = np.concatenate([[(0.0, 0.0)], right, left])
    return tuple((float(x), float(y)) for x, y in points)


def _check(
    color: str,
    noun: str,
    sizes: tuple[float, ...],
    count: int,
    points: tuple[Point, ...],
) -> None:
    """Raise TwinError unless there is such a color, and so many positive sizes, and the points are
    pairs of numbers."""
    if not isinstance(color, str) or color not in COLORS:
        raise TwinError(f"scene: there is no color '{color}'; choose {', '.join(COLORS)}")
    if not _are_numbers(sizes, count) or min(sizes) <= 0:
        shown = ", ".join(map(str, sizes)) if isinstance(sizes, tuple | list) else sizes
        raise TwinError(f"scene: {noun} of {shown} mm; give {counted(count, 'positive size')}")
    is_sequence = isinstance(points, tuple | list)
    if not is_sequence or not all(_are_numbers(point, 2) for point in points):
        raise TwinError(
            f"scene: {noun} at {points}; give places (x, y) in mm and headings in degrees, "
            "all finite"
        )


def _are_numbers(values: Sequence[float], count: int) -> bool:
    """Whether these are so many finite numbers, as a user's values may be of any type."""
    try:
        return len(values) == count and all(math.isfinite(value) for value in values)
    except TypeError:
        return False
