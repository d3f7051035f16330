"""Objects of a scene: lines, fields and pictures on the floor, walls, fixed and pushable blocks,
balls, ramps, lamps and infrared beacons.

Positions are millimetres on the floor, ``(x, y)``: a robot that starts at the origin with a heading
of 0 looks along x, y is to its left. Headings are degrees, clockwise seen from above. What
lies on the floor affects colour sensors only.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from brickhub.errors import TwinError, counted
from bricktwin.twin.floor_picture import Picture, read_picture

__all__ = [
    "COLORS",
    "Ball",
    "Beacon",
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
_Segment = tuple[float, float, float, float, float]
"""Start and direction of a line's segment, x and y each (mm), and what a product with the direction
is multiplied by for a share of the segment."""

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
_CELL_MM = 20.0
"""Side of the squares of the floor for which a line remembers its segments nearby."""


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
    def segments_mm(self) -> list[tuple[Point, Point]]:
        """Start and end of each segment."""
        corners = self.points_mm
        if self.closed:
            corners += corners[:1]
        return list(itertools.pairwise(corners))

    def beyond_mm(self, x_mm: float, y_mm: float) -> float:
        """How far a point is from it, negative on it, as of all marks."""
        cell = (x_mm // _CELL_MM, y_mm // _CELL_MM)
        near = self._segments_near.get(cell)
        if near is None:
            near = self._segments_near[cell] = self._nearest_to(cell)
        nearest = math.inf
        for start_x, start_y, along_x, along_y, per_square in near:
            offset_x = x_mm - start_x
            offset_y = y_mm - start_y
            # Where along the segment the nearest point is, from 0 to 1.
            share = (offset_x * along_x + offset_y * along_y) * per_square
            if share > 1.0:
                share = 1.0
            elif share < 0.0:
                share = 0.0
            across_x = offset_x - share * along_x
            across_y = offset_y - share * along_y
            square = across_x * across_x + across_y * across_y
            if square < nearest:
                nearest = square
        return math.sqrt(nearest) - self.width_mm / 2

    @cached_property
    def _segments_near(self) -> dict[tuple[float, float], list[_Segment]]:
        """What `_nearest_to` gave, by the cell: a sensor reads where it has read before."""
        return {}

    @cached_property
    def _segments(self) -> list[_Segment]:
        segments = []
        for (start_x, start_y), (end_x, end_y) in self.segments_mm:
            along_x = end_x - start_x
            along_y = end_y - start_y
            square = along_x**2 + along_y**2
            # Two equal points are a segment without a direction.
            per_square = 1.0 / square if square else 0.0
            segments.append((start_x, start_y, along_x, along_y, per_square))
        return segments

    def _nearest_to(self, cell: tuple[float, float]) -> list[_Segment]:
        """The segments that may be the nearest one of a point in a cell."""
        column, row = cell
        middle_x = (column + 0.5) * _CELL_MM
        middle_y = (row + 0.5) * _CELL_MM
        ranges = []
        for segment in self._segments:
            start_x, start_y, along_x, along_y, per_square = segment
            offset_x = middle_x - start_x
            offset_y = middle_y - start_y
            share = (offset_x * along_x + offset_y * along_y) * per_square
            share = min(max(share, 0.0), 1.0)
            distance_mm = math.hypot(offset_x - share * along_x, offset_y - share * along_y)
            ranges.append((distance_mm, segment))
        # From the middle to a corner a distance changes by half of the diagonal, for one segment
        # the one way and for another the other way.
        nearest_mm = min(distance_mm for distance_mm, _ in ranges)
        most_mm = nearest_mm + 1.5 * _CELL_MM
        return [segment for distance_mm, segment in ranges if distance_mm <= most_mm]


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

    def beyond_mm(self, x_mm: float, y_mm: float) -> float:
        """How far a point is from it, negative on it, as of all marks: at most the distance."""
        cosine, sine = self._heading
        at_x, at_y = self.at_mm
        offset_x = x_mm - at_x
        offset_y = y_mm - at_y
        # The point in the field's own frame.
        along = abs(offset_x * cosine - offset_y * sine)
        across = abs(offset_x * sine + offset_y * cosine)
        half_x = self.size_mm[0] / 2
        half_y = self.size_mm[1] / 2
        if self.round:
            radius = math.hypot(along / half_x, across / half_y)
            return (radius - 1.0) * min(half_x, half_y)
        return max(along - half_x, across - half_y)

    @cached_property
    def _heading(self) -> tuple[float, float]:
        """Cosine and sine of the heading."""
        heading = math.radians(self.heading_deg)
        return math.cos(heading), math.sin(heading)


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


@dataclass(frozen=True)
class Beacon:
    """Infrared beacon, such as the remote of an EV3, on channel 1; only infrared sensors of EV3 see
    it. Raises TwinError if a value is invalid.

    Attributes:
        at_mm: position and height.
    """

    at_mm: Size

    def __post_init__(self) -> None:
        if not _are_numbers(self.at_mm, 3):
            raise TwinError(f"scene: a beacon at {self.at_mm}; give a place (x, y, height) in mm")


_OVAL_POINTS = 25
"""Points of each end of an oval."""

Mark = Line | Field | Picture
Pushable = Block | Ball
Solid = Wall | Block | Ball | Ramp
Object = Mark | Solid | Lamp | Beacon


def oval(length_mm: float, width_mm: float) -> tuple[Point, ...]:
    """Points of a closed line with half circles as ends, of this total size, from the origin along
    x, then to the left."""
    radius = width_mm / 2
    straight = length_mm - width_mm
    if straight < 0 or radius <= 0:
        raise TwinError(
            f"scene: an oval of {length_mm} x {width_mm} mm; give a length of at least its width"
        )
    step = math.pi / (_OVAL_POINTS - 1)
    right = []
    for number in range(_OVAL_POINTS):
        angle = number * step - math.pi / 2
        x = straight / 2 + radius * math.cos(angle)
        y = radius + radius * math.sin(angle)
        right.append((x, y))
    # The other end is the same, turned by half a turn about the middle.
    left = [(-x, width_mm - y) for x, y in right]
    return ((0.0, 0.0), *right, *left)


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
