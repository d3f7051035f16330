"""Measures of the worlds, by the rules of their games: where each thing is, and how large."""

from __future__ import annotations

import itertools
from collections import Counter

import pytest

from bricktwin.twin.objects import Ball, Block, Field, Line, Picture, Point, Ramp, Wall
from bricktwin.twin.scene import Scene
from bricktwin.worlds import courses, games

FIXED = 0.0
"""Mass of what cannot be pushed."""


def of_kind(scene: Scene, kind: type) -> list:  # type: ignore[type-arg]
    return [item for item in scene.objects if isinstance(item, kind)]


def segments(scene: Scene) -> Counter[frozenset[Point]]:
    """The walls, whichever way around they are drawn."""
    return Counter(frozenset((wall.from_mm, wall.to_mm)) for wall in of_kind(scene, Wall))


def test_squares_of_400_800_and_1200_mm_share_a_corner() -> None:
    scene = courses.squares()
    lines = of_kind(scene, Line)
    assert [line.points_mm for line in lines] == [
        ((0.0, 0.0), (side, 0.0), (side, side), (0.0, side)) for side in (400.0, 800.0, 1200.0)
    ]
    assert all(line.closed and line.width_mm == 12.0 and line.color == "grey" for line in lines)
    assert {field.size_mm for field in of_kind(scene, Field)} == {(60.0, 60.0)}
    assert len(scene.objects) == 3 + 3 * 3 + 1


def test_the_maze_has_the_walls_that_are_drawn() -> None:
    """A wall is -- between two crosses or | between two cells; cells are 300 mm wide and high."""
    scene = courses.maze()
    rows = courses.MAZE.strip().splitlines()
    expected = set()
    for number, row in enumerate(rows):
        if number % 2 == 0:
            # North is up, and the lowest row of crosses is half a cell below the robot.
            y = 300.0 * (len(rows) - 1 - number) / 2 - 150.0
            for cell, part in enumerate(row[3 * n + 1 : 3 * n + 3] for n in range(4)):
                if part == "--":
                    x = 300.0 * cell - 150.0
                    expected.add(frozenset(((x, y), (x + 300.0, y))))
        else:
            low = 300.0 * (len(rows) - 2 - number) / 2 - 150.0
            for cell, sign in enumerate(row[::3]):
                if sign == "|":
                    x = 300.0 * cell - 150.0
                    expected.add(frozenset(((x, low), (x, low + 300.0))))
    assert segments(scene) == Counter(expected)
    assert len(expected) == 24
    assert {wall.height_mm for wall in of_kind(scene, Wall)} == {150.0}
    # The robot's own cell has a gap in the west, where it starts.
    assert frozenset(((-150.0, -150.0), (-150.0, 150.0))) not in expected
    (goal,) = of_kind(scene, Field)
    assert goal == Field((0.0, 900.0), (260.0, 260.0), "red")


def test_five_cans_of_a_drink_stand_in_a_row() -> None:
    cans = of_kind(courses.cans(), Block)
    assert [can.at_mm for can in cans] == [
        (450.0, 0.0),
        (900.0, 0.0),
        (1350.0, 0.0),
        (1800.0, 0.0),
        (2250.0, 0.0),
    ]
    assert {can.size_mm for can in cans} == {(66.0, 66.0, 115.0)}
    assert [can.color for can in cans] == ["red", "white", "red", "white", "red"]
    assert all(can.round and can.mass_g == 15.0 for can in cans)


def test_ramps_and_bridge_are_one_way_up_and_down() -> None:
    up, bridge, down = courses.ramps().objects
    assert isinstance(up, Ramp) and isinstance(bridge, Block) and isinstance(down, Ramp)
    assert up.height_mm == down.height_mm == bridge.size_mm[2] == 60.0
    assert up.length_mm == down.length_mm == 500.0
    # A ramp begins at its lower edge; the second one rises towards the first.
    assert up.at_mm == (250.0, 0.0) and up.heading_deg == 0.0
    assert bridge.at_mm[0] - bridge.size_mm[0] / 2 == up.at_mm[0] + 500.0
    assert bridge.at_mm[0] + bridge.size_mm[0] / 2 == down.at_mm[0] - 500.0
    assert down.heading_deg == 180.0 and down.at_mm == (1550.0, 0.0)
    assert bridge.size_mm[1] == 300.0 and bridge.at_mm[1] == 0.0 and not bridge.mass_g


def test_a_wall_is_half_a_metre_ahead_or_almost_one() -> None:
    scene = courses.wall()
    assert scene.wall_distance_mm == (500.0, 900.0) and scene.objects == ()


def test_a_room_is_closed_and_has_what_stands_in_it() -> None:
    scene = courses.room()
    corners = [(-600.0, -900.0), (1800.0, -900.0), (1800.0, 900.0), (-600.0, 900.0)]
    around = itertools.pairwise([*corners, corners[0]])
    assert segments(scene) == Counter(frozenset(pair) for pair in around)
    assert {wall.height_mm for wall in of_kind(scene, Wall)} == {200.0}
    blocks = of_kind(scene, Block)
    legs = [block for block in blocks if block.round]
    # A table of 50 x 40 cm.
    assert {leg.at_mm for leg in legs} == set(itertools.product((900.0, 1400.0), (-600.0, -200.0)))
    assert {leg.size_mm for leg in legs} == {(40.0, 40.0, 300.0)}
    others = [block for block in blocks if not block.round]
    assert [block.color for block in others] == ["blue", "brown", "purple"]
    for block in others:
        reach_x, reach_y = block.size_mm[0] / 2, block.size_mm[1] / 2
        assert block.at_mm[0] - reach_x > -600.0 and block.at_mm[0] + reach_x < 1800.0
        assert block.at_mm[1] - reach_y > -900.0 and block.at_mm[1] + reach_y < 900.0
    # Only the cushion, the flattest of them, is soft; nothing can be pushed.
    assert [block.soft for block in others] == [False, False, True]
    assert others[2].heading_deg == 20.0 and others[2].size_mm == (320.0, 320.0, 120.0)
    assert not any(block.mass_g for block in blocks)
    # A robot that starts in the origin has half a metre around it.
    assert min(max(abs(block.at_mm[0]), abs(block.at_mm[1])) for block in blocks) > 500.0


def test_a_sumo_ring_is_that_of_the_rules() -> None:
    scene = games.sumo()
    ring, inner, *starts = of_kind(scene, Field)
    assert ring == Field((0.0, 0.0), (770.0, 770.0), "white", round=True)
    # A border of 25 mm.
    assert inner == Field((0.0, 0.0), (720.0, 720.0), "black", round=True)
    # Lines of 100 x 10 mm, 100 mm from middle to middle.
    assert starts == [
        Field((-50.0, 0.0), (10.0, 100.0), "brown"),
        Field((50.0, 0.0), (10.0, 100.0), "brown"),
    ]
    (opponent,) = of_kind(scene, Block)
    assert opponent.mass_g == 500.0 and opponent.color == "red"
    assert opponent.size_mm == (100.0, 100.0, 80.0)
    # Wherever it is put, it is behind its line and inside of the border.
    spread_x, spread_y = opponent.spread_mm
    assert opponent.at_mm == (120.0, 0.0) and (spread_x, spread_y) == (20.0, 80.0)
    assert opponent.at_mm[0] - spread_x - 50.0 >= 50.0
    # Robots start as far from the middle, and look at each other.
    assert scene.start_mm == ((-170.0, -170.0), (0.0, 0.0))
    assert scene.others_start == ((170.0, 0.0, 180.0),)


def test_a_football_field_has_walls_all_around_and_a_goal_at_both_ends() -> None:
    scene = games.football()
    east, north, post, back = 915.0, 610.0, 225.0, 995.0
    around = {
        *(((-east, side * north), (east, side * north)) for side in (1, -1)),
        *(((end * back, -post), (end * back, post)) for end in (1, -1)),
        *(
            ((end * east, side * post), (end * east, side * north))
            for end, side in itertools.product((1, -1), repeat=2)
        ),
        *(
            ((end * east, side * post), (end * back, side * post))
            for end, side in itertools.product((1, -1), repeat=2)
        ),
    }
    assert segments(scene) == Counter(frozenset(pair) for pair in around)
    walls = of_kind(scene, Wall)
    assert {wall.height_mm for wall in walls} == {140.0}
    assert {wall.color for wall in walls} == {"black"}
    field, spot, ahead, behind = of_kind(scene, Field)
    assert field == Field((0.0, 0.0), (1830.0, 1220.0), "green")
    assert spot == Field((0.0, 0.0), (40.0, 40.0), "black", round=True)
    # Their floors are 80 mm deep, and as wide as the goals.
    assert ahead == Field((955.0, 0.0), (80.0, 450.0), "yellow")
    assert behind == Field((-955.0, 0.0), (80.0, 450.0), "blue")
    (middle,) = of_kind(scene, Line)
    assert middle == Line(((0.0, -610.0), (0.0, 610.0)), 15.0, "white")
    (ball,) = of_kind(scene, Ball)
    assert ball.at_mm == (0.0, 0.0) and ball.spread_mm == (0.0, 30.0)
    assert scene.start_mm == ((-500.0, -500.0), (0.0, 0.0))
    assert scene.others_start == (
        (500.0, 0.0, 180.0),
        (-650.0, 300.0, 0.0),
        (650.0, -300.0, 180.0),
    )


def test_six_blocks_lie_before_the_fields_of_their_colors() -> None:
    scene = games.blocks()
    fields = of_kind(scene, Field)
    assert [(field.color, field.at_mm, field.size_mm) for field in fields] == [
        ("red", (1100.0, -350.0), (300.0, 300.0)),
        ("yellow", (1100.0, 0.0), (300.0, 300.0)),
        ("blue", (1100.0, 350.0), (300.0, 300.0)),
    ]
    blocks = of_kind(scene, Block)
    assert [(block.color, block.at_mm) for block in blocks] == [
        ("red", (350.0, -350.0)),
        ("red", (600.0, 350.0)),
        ("yellow", (350.0, 0.0)),
        ("yellow", (600.0, 0.0)),
        ("blue", (350.0, 350.0)),
        ("blue", (600.0, -350.0)),
    ]
    assert {block.mass_g for block in blocks} == {40.0}
    assert {block.spread_mm for block in blocks} == {(15.0, 15.0)}
    # Of eight modules.
    assert {block.size_mm[:2] for block in blocks} == {(64.0, 64.0)}


@pytest.mark.parametrize("mat", [None, Picture(bytes(6), 2, (2362.0, 1143.0))])
def test_walls_of_a_table_stand_around_its_mat(mat: Picture | None) -> None:
    scene = games.table(mat)
    floor, *walls = scene.objects
    assert floor == (mat or Field((0.0, 0.0), (2362.0, 1143.0), "white"))
    # Their middles are half of 38 mm outside of it.
    x, y = 1181.0 + 19.0, 571.5 + 19.0
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    around = itertools.pairwise([*corners, corners[0]])
    assert segments(scene) == Counter(frozenset(pair) for pair in around)
    for wall in walls:
        assert isinstance(wall, Wall)
        assert (wall.height_mm, wall.thickness_mm, wall.color) == (77.0, 38.0, "black")
    # A robot starts in its lower left corner, 18 cm from both walls.
    assert scene.start_mm == ((-1001.0, -1001.0), (-391.5, -391.5))
