"""Worlds to drive through: squares, a maze, cans, ramps, a wall, a room."""

from bricktwin.twin.objects import Block, Field, Line, Object, Point, Ramp, Wall
from bricktwin.twin.scene import Scene

SQUARE_MM = 800.0
"""Side of the middle one of the squares."""
CELL_MM = 300.0
"""Side of a cell of the maze: the tile of RoboCupJunior's Rescue Maze (rules of 2024)."""
_MAZE_WALL_MM = 150.0
"""Height of its walls, the least that these rules allow."""
MAZE = """
+--+--+--+--+
|     |     |
+--+  +  +  +
|  |     |  |
+  +--+--+  +
|        |  |
+--+--+  +  +
            |
+--+--+--+--+
"""
"""Walls of the maze seen from above, north up; a robot starts at the gap in the west. A cell is
three characters wide and two high."""


def squares() -> Scene:
    """Three squares around one start, of 400, 800 and 1200 mm, to drive along by the gyroscope.

    A robot starts at the lower left corner of each, which is coloured, and looks along its side.
    """
    objects: list[Object] = []
    for side_mm in (400.0, SQUARE_MM, 1200.0):
        corners: tuple[Point, ...] = (
            (0.0, 0.0),
            (side_mm, 0.0),
            (side_mm, side_mm),
            (0.0, side_mm),
        )
        objects.append(
            Line(
                corners,
                12.0,
                "grey",
                closed=True,
            )
        )
        for corner, color in zip(corners[1:], ("red", "yellow", "blue"), strict=True):
            objects.append(Field(corner, (60.0, 60.0), color))
    objects.append(Field((0.0, 0.0), (60.0, 60.0), "green"))
    return Scene(objects=tuple(objects))


def maze() -> Scene:
    """A maze of 4 x 4 cells of 300 mm, from a gap in the west to a red cell.

    A robot starts in the gap and looks east, into the maze.
    """
    rows = MAZE.strip().splitlines()
    height = len(rows) // 2
    walls: list[Object] = []
    # The robot stands in the middle of the lowest cell, in front of the gap.
    west = -CELL_MM / 2
    south = -CELL_MM / 2
    for line, row in enumerate(rows):
        y_mm = south + CELL_MM * (height - line / 2)
        for column in range(0, len(row), 3):
            x_mm = west + CELL_MM * column / 3
            if line % 2 == 0 and row[column + 1 : column + 3] == "--":
                walls.append(_maze_wall((x_mm, y_mm), (x_mm + CELL_MM, y_mm)))
            if line % 2 == 1 and row[column] == "|":
                half = CELL_MM / 2
                walls.append(_maze_wall((x_mm, y_mm - half), (x_mm, y_mm + half)))
    goal = Field((0.0, 3 * CELL_MM), (CELL_MM - 40.0, CELL_MM - 40.0), "red")
    return Scene(objects=(goal, *walls))


def _maze_wall(start: Point, end: Point) -> Wall:
    return Wall(
        start,
        end,
        _MAZE_WALL_MM,
        color="light_grey",
    )


def cans() -> Scene:
    """Five cans in a row, 450 mm apart, to drive around in a slalom; they can be pushed over.

    A can is that of a drink: 66 mm wide, 115 mm high, 15 g when it is empty.
    """
    objects = []
    for number in range(5):
        color = ("red", "white")[number % 2]
        place = (450.0 + 450.0 * number, 0.0)
        can = Block(
            place,
            (66.0, 66.0, 115.0),
            color,
            mass_g=15.0,
            round=True,
        )
        objects.append(can)
    return Scene(objects=tuple(objects))


RAMP_MM = 500.0
"""Length of each ramp."""
_RISE_MM = 60.0


def ramps() -> Scene:
    """A ramp of 500 mm that rises by 60 mm (6.8 degrees), a bridge, and a ramp down."""
    bridge_mm = 300.0
    first = 250.0
    last = first + 2 * RAMP_MM + bridge_mm
    middle = (first + last) / 2
    return Scene(
        objects=(
            Ramp((first, 0.0), RAMP_MM, height_mm=_RISE_MM),
            Block((middle, 0.0), (bridge_mm, 300.0, _RISE_MM), "grey"),
            Ramp(
                (last, 0.0),
                RAMP_MM,
                height_mm=_RISE_MM,
                heading_deg=180.0,
            ),
        )
    )


def wall() -> Scene:
    """A wall of bricks, 500 to 900 mm in front of the robot, anew in each episode."""
    return Scene(wall_distance_mm=(500.0, 900.0))


def room() -> Scene:
    """A room of 2.4 x 1.8 m with a table of four legs, a box, a shelf and a cushion.

    The cushion is soft: an ultrasonic sensor hears it late, or not at all.
    """
    west = -600.0
    east = 1800.0
    south = -900.0
    north = 900.0
    corners: tuple[Point, ...] = ((west, south), (east, south), (east, north), (west, north))
    objects: list[Object] = []
    for start, end in zip(corners, (*corners[1:], corners[0]), strict=True):
        objects.append(
            Wall(
                start,
                end,
                200.0,
                color="light_grey",
            )
        )
    for x in (900.0, 1400.0):
        for y in (-600.0, -200.0):
            objects.append(
                Block(
                    (x, y),
                    (40.0, 40.0, 300.0),
                    "brown",
                    round=True,
                )
            )
    objects += [
        Block((1600.0, 650.0), (300.0, 400.0, 250.0), "blue"),
        Block((300.0, 800.0), (800.0, 180.0, 300.0), "brown"),
        Block(
            (-400.0, -650.0),
            (320.0, 320.0, 120.0),
            "purple",
            heading_deg=20.0,
            soft=True,
        ),
    ]
    return Scene(objects=tuple(objects))
