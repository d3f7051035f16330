"""Worlds with lines of black tape, to follow.

A robot starts with a sensor in front of its axle on the left edge of the line, which it follows
clockwise. Widths, markers and gaps are those of RoboCupJunior's Rescue Line (rules of 2024): tape
of 10 to 20 mm, green markers of 25 x 25 mm before a junction, gaps of at most 200 mm.
"""

from bricktwin.twin.objects import COLORS, Block, Field, Line, Object, Point
from bricktwin.twin.scene import Scene
from bricktwin.worlds.paths import pieces, rounded

_TAPE_MM = 20.0
_MARKER_MM = 25.0
_EDGE_MM = ((0.0, 0.0), (_TAPE_MM / 2, _TAPE_MM / 2))
"""Start beside the line, whose left edge is straight ahead."""

SIMPLE_MM = rounded(
    ((600.0, 0.0), (600.0, -800.0), (-600.0, -800.0), (-600.0, 0.0)),
    300.0,
    closed=True,
)
"""Path of the simple line."""
SHARP_MM: tuple[Point, ...] = (
    (500.0, 0.0),
    (500.0, -300.0),
    (800.0, -300.0),
    (500.0, -800.0),
    (200.0, -500.0),
    (0.0, -800.0),
    (-400.0, -800.0),
    (-400.0, 0.0),
)
"""Path of the line with sharp bends."""
_GAPS_MM = ((1300.0, 1400.0), (1560.0, 1660.0), (3010.0, 3110.0))
"""Gaps along the simple line, from its first point. A piece of tape is round, and half its width
longer at each end."""


def line_simple() -> Scene:
    """A closed line of 3.5 m with wide bends: a radius of 300 mm."""
    return Scene(objects=(Line(SIMPLE_MM, closed=True),), start_mm=_EDGE_MM)


def line_sharp() -> Scene:
    """A closed line of 4 m with corners of 90 degrees, and sharper: who is fast loses it."""
    return Scene(objects=(Line(SHARP_MM, closed=True),), start_mm=_EDGE_MM)


def line_junctions() -> Scene:
    """Lines that cross; a green marker before a crossing says where to turn, to the red goal.

    The marker is on the side to which the way goes. Without one it goes straight on.
    """
    east: tuple[Point, ...] = ((-200.0, 0.0), (1200.0, 0.0))
    first_north: tuple[Point, ...] = ((400.0, -400.0), (400.0, 400.0))
    second_north: tuple[Point, ...] = ((800.0, -700.0), (800.0, 400.0))
    south: tuple[Point, ...] = ((400.0, -400.0), (1200.0, -400.0))
    paths = (east, first_north, second_north, south)
    lines: list[Object] = [Line(path) for path in paths]
    beside_mm = (_TAPE_MM + _MARKER_MM) / 2
    size_mm = (_MARKER_MM, _MARKER_MM)
    # To the right of who comes from the west, and to the left of who comes from the north.
    to_the_south = Field((800.0 - beside_mm, -beside_mm), size_mm, "green")
    to_the_east = Field((800.0 + beside_mm, -400.0 + beside_mm), size_mm, "green")
    goal = Field((1200.0, -400.0), (120.0, 120.0), "red")
    return Scene(objects=(*lines, to_the_south, to_the_east, goal), start_mm=_EDGE_MM)


def line_gaps() -> Scene:
    """The simple line with three gaps of 80 mm in its long sides, where a robot has to drive on."""
    ring = (*SIMPLE_MM, SIMPLE_MM[0])
    parts: list[Object] = [Line(part) for part in pieces(ring, _GAPS_MM)]
    return Scene(objects=tuple(parts), start_mm=_EDGE_MM)


def line_obstacles() -> Scene:
    """The simple line with two blocks on it, as wide as a brick: a robot has to drive around."""
    obstacles: list[Object] = []
    for place in ((250.0, 0.0), (-100.0, -800.0)):
        obstacles.append(Block(place, (100.0, 100.0, 150.0), "red"))
    return Scene(objects=(Line(SIMPLE_MM, closed=True), *obstacles), start_mm=_EDGE_MM)


def colors() -> Scene:
    """Eleven fields in a row, 200 mm each, one of each color that a scene has, to drive across."""
    fields = []
    for number, color in enumerate(COLORS):
        fields.append(Field((250.0 + 200.0 * number, 0.0), (200.0, 400.0), color))
    return Scene(objects=tuple(fields))
