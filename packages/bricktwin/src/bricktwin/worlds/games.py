"""Worlds of games: sumo, football, blocks to sort, a table for mats."""

from bricktwin.twin.objects import Ball, Block, Field, Line, Object, Picture, Point, Wall
from bricktwin.twin.scene import Scene

DOHYO_MM = 770.0
"""Diameter of the ring of mini sumo with its border; the border is 25 mm wide, the starting lines
are 100 x 10 mm and 100 mm apart (rules of Robothon for mini sumo)."""
BORDER_MM = 25.0
FIELD_MM = (1830.0, 1220.0)
"""Length and width of the football field; goals are 450 mm wide, walls 140 mm high (RoboCupJunior,
rules of 2004 for two against two)."""
GOAL_MM = 450.0
TABLE_MM = (2362.0, 1143.0)
"""Inner length and width of the table of FIRST LEGO League, within 3 mm; its walls are 38 mm wide
and 64 to 90 mm high (its instructions for the table). The mats of World Robot Olympiad have this
size, too."""
_TABLE_WALL_MM = 77.0
_TABLE_WALL_WIDTH_MM = 38.0


def sumo() -> Scene:
    """A sumo ring, black with a white border, and an opponent of 500 g who does not move.

    The ring lies on the floor; a real one is 25 mm high. A robot starts behind its starting line; a
    second one takes the opponent's place, and looks at the first.
    """
    inner_mm = DOHYO_MM - 2 * BORDER_MM
    return Scene(
        objects=(
            Field(
                (0.0, 0.0),
                (DOHYO_MM, DOHYO_MM),
                "white",
                round=True,
            ),
            Field(
                (0.0, 0.0),
                (inner_mm, inner_mm),
                "black",
                round=True,
            ),
            Field((-50.0, 0.0), (10.0, 100.0), "brown"),
            Field((50.0, 0.0), (10.0, 100.0), "brown"),
            Block(
                (120.0, 0.0),
                (100.0, 100.0, 80.0),
                "red",
                mass_g=500.0,
                spread_mm=(20.0, 80.0),
            ),
        ),
        start_mm=((-170.0, -170.0), (0.0, 0.0)),
        others_start=((170.0, 0.0, 180.0),),
    )


def football() -> Scene:
    """A football field with two goals, and a ball in the middle that rolls.

    A robot starts in its half and looks at the goal in the east; a second one in the other half,
    two more behind them.
    """
    length_mm, width_mm = FIELD_MM
    east = length_mm / 2
    north = width_mm / 2
    post = GOAL_MM / 2
    depth = 80.0
    objects: list[Object] = [
        Field((0.0, 0.0), FIELD_MM, "green"),
        Line(((0.0, -north), (0.0, north)), 15.0, "white"),
        Field(
            (0.0, 0.0),
            (40.0, 40.0),
            "black",
            round=True,
        ),
        Field((east + depth / 2, 0.0), (depth, GOAL_MM), "yellow"),
        Field((-east - depth / 2, 0.0), (depth, GOAL_MM), "blue"),
    ]
    for side in (1.0, -1.0):
        objects.append(_field_wall((-east, side * north), (east, side * north)))
        x = side * east
        back = side * (east + depth)
        objects.append(_field_wall((back, -post), (back, post)))
        for end in (post, -post):
            outer = north if end > 0 else -north
            objects.append(_field_wall((x, end), (x, outer)))
            objects.append(_field_wall((x, end), (back, end)))
    objects.append(Ball((0.0, 0.0), spread_mm=(0.0, 30.0)))
    return Scene(
        objects=tuple(objects),
        start_mm=((-500.0, -500.0), (0.0, 0.0)),
        others_start=((500.0, 0.0, 180.0), (-650.0, 300.0, 0.0), (650.0, -300.0, 180.0)),
    )


def _field_wall(start: Point, end: Point) -> Wall:
    return Wall(
        start,
        end,
        140.0,
        color="black",
    )


def blocks() -> Scene:
    """Six blocks of 64 mm and 40 g in three colors, to push into the fields of their colors."""
    objects: list[Object] = []
    for number, color in enumerate(("red", "yellow", "blue")):
        y_mm = 350.0 * (number - 1)
        objects.append(Field((1100.0, y_mm), (300.0, 300.0), color))
        for x_mm in (350.0, 600.0):
            block = Block(
                (x_mm, -y_mm if x_mm > 500.0 else y_mm),
                color=color,
                mass_g=40.0,
                spread_mm=(15.0, 15.0),
            )
            objects.append(block)
    return Scene(objects=tuple(objects))


def table(mat: Picture | None = None) -> Scene:
    """A table of FIRST LEGO League, 2362 x 1143 mm, white or with a mat.

    A robot starts in the lower left corner and looks along the long side. With a mat it is that of
    ``--scene mat.png:fll``.
    """
    half_x, half_y = (side / 2 for side in TABLE_MM)
    floor: Object = mat or Field((0.0, 0.0), TABLE_MM, "white")
    # The walls stand around the mat.
    x = half_x + _TABLE_WALL_WIDTH_MM / 2
    y = half_y + _TABLE_WALL_WIDTH_MM / 2
    corners: tuple[Point, ...] = ((-x, -y), (x, -y), (x, y), (-x, y))
    walls: list[Object] = []
    for start, end in zip(corners, (*corners[1:], corners[0]), strict=True):
        wall = Wall(
            start,
            end,
            _TABLE_WALL_MM,
            _TABLE_WALL_WIDTH_MM,
            "black",
        )
        walls.append(wall)
    corner_x = -half_x + 180.0
    corner_y = -half_y + 180.0
    return Scene(
        objects=(floor, *walls),
        start_mm=((corner_x, corner_x), (corner_y, corner_y)),
    )
