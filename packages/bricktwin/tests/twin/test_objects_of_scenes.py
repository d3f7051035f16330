"""Objects of scenes: distances to what lies on the floor, shapes, and limits of their values."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from typing import Any

import pytest
from limits import assert_kept
from PIL import Image

from brickhub.errors import TwinError
from brickhub.robot import HubKind, Motor, Robot
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.floor_picture import Picture, faults_of_picture, read_picture
from bricktwin.twin.objects import (
    Ball,
    Beacon,
    Block,
    Field,
    Lamp,
    Line,
    Point,
    Ramp,
    Wall,
    oval,
)
from bricktwin.twin.physics import RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.worlds import games

TINY = 1e-6


def way_to(segment: tuple[Point, Point], point: Point) -> float:
    """Distance to a segment: to the nearest of many points of it."""
    (start_x, start_y), (end_x, end_y) = segment
    shares = [number / 2000 for number in range(2001)]
    return min(
        math.dist(point, (start_x + share * (end_x - start_x), start_y + share * (end_y - start_y)))
        for share in shares
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_line_is_as_far_as_its_nearest_segment(seed: int) -> None:
    rng = random.Random(seed)
    corners = tuple((rng.uniform(-80, 80), rng.uniform(-80, 80)) for _ in range(4))
    # Twice the same corner is a segment without a direction.
    corners += corners[-1:]
    line = Line(corners, width_mm=7.0, closed=seed == 1)
    pairs = list(itertools.pairwise((*corners, *(corners[:1] if seed == 1 else ()))))
    assert line.segments_mm == pairs
    for _ in range(25):
        point = rng.uniform(-150, 150), rng.uniform(-150, 150)
        expected = min(way_to(pair, point) for pair in pairs) - 3.5
        # Points of a segment are less than a tenth of a millimetre apart.
        assert line.beyond_mm(*point) == pytest.approx(expected, abs=0.02)


def test_a_field_has_its_edges_where_its_size_and_heading_say() -> None:
    """A quarter turn clockwise: what was along x is along -y."""
    field = Field((100.0, 50.0), (40.0, 20.0))
    assert [field.beyond_mm(x, 50.0) for x in (100, 115, 120, 125)] == [-10, -5, 0, 5]
    assert [field.beyond_mm(100.0, y) for y in (60, 70)] == [0, 10]
    turned = Field((100.0, 50.0), (40.0, 20.0), heading_deg=90.0)
    assert turned.beyond_mm(100.0, 70.0) == pytest.approx(0.0)
    assert turned.beyond_mm(110.0, 50.0) == pytest.approx(0.0)
    slanted = Field((0.0, 0.0), (200.0, 2.0), heading_deg=30.0)
    ahead = 90 * math.cos(math.radians(30)), -90 * math.sin(math.radians(30))
    assert slanted.beyond_mm(*ahead) < 0 < slanted.beyond_mm(ahead[0], -ahead[1])


def test_an_ellipse_has_its_edge_where_its_equation_says() -> None:
    round_one = Field((10.0, -20.0), (60.0, 30.0), round=True, heading_deg=20.0)
    heading = math.radians(20.0)
    for degrees in range(0, 360, 15):
        x, y = 30 * math.cos(math.radians(degrees)), 15 * math.sin(math.radians(degrees))
        for share, sign in ((0.9, -1), (1.1, 1)):
            at_x = 10.0 + share * (x * math.cos(heading) + y * math.sin(heading))
            at_y = -20.0 + share * (-x * math.sin(heading) + y * math.cos(heading))
            beyond = round_one.beyond_mm(at_x, at_y)
            assert beyond == pytest.approx(sign * 0.1 * 15)


def test_an_oval_is_two_straights_and_two_half_circles() -> None:
    points = oval(800.0, 300.0)
    xs, ys = zip(*points, strict=True)
    assert (min(xs), max(xs)) == pytest.approx((-400.0, 400.0))
    assert (min(ys), max(ys)) == pytest.approx((0.0, 300.0))
    assert points[0] == (0.0, 0.0)
    for x, y in points[1:]:
        assert math.hypot(abs(x) - 250.0, y - 150.0) == pytest.approx(150.0)
    around = sum(math.dist(*pair) for pair in itertools.pairwise((*points, points[0])))
    assert around == pytest.approx(1000.0 + 300.0 * math.pi, rel=1e-3)
    # First to the right end, upwards, then to the left one, downwards.
    assert points[1][0] > 0 > points[-1][0] and points[1][1] < points[25][1]
    assert oval(300.0, 300.0)[1] == pytest.approx((0.0, 0.0))


PIXELS = bytes(range(2 * 3 * 3))


def picture(**values: Any) -> Picture:
    return Picture(**{"pixels": PIXELS, "columns": 2, "size_mm": (20.0, 30.0), **values})


def arena(*motors: int) -> Arena:
    robots = [
        Contestant(
            f"r{number}",
            Robot("r", HubKind.PRIME, tuple(Motor(f"m{i}", "ABCDEF"[i]) for i in range(count))),
            Place(),
        )
        for number, count in enumerate(motors)
    ]
    return Arena(tuple(robots))


LIMITS: dict[str, tuple[Callable[[Any], Any], list[Any], list[Any]]] = {
    "points of a line": (
        lambda points: Line(points),  # noqa: PLW0108
        [((0, 0), (1, 1)), [[0, 0], [1, 1]]],
        [((0, 0),), (), ((0, 0), (math.nan, 0)), ((0, 0), (1,)), ((0, 0), (1, 2, 3)), 5],
    ),
    "width of a line": (lambda w: Line(((0, 0), (1, 1)), w), [TINY], [0.0, -1.0, math.inf]),
    "color": (lambda c: Line(((0, 0), (1, 1)), color=c), ["red"], ["mauve", None, ["red"]]),
    "size of a field": (
        lambda size: Field((0, 0), size),
        [(TINY, TINY)],
        [(0, 1), (1, 0), (1,), (1, 2, 3), 5, (1, math.nan)],
    ),
    "heading of a field": (
        lambda deg: Field((0, 0), (1, 1), heading_deg=deg),
        [-720.0, 0.0],
        [math.nan, math.inf],
    ),
    "ends of a wall": (lambda end: Wall((0, 0), end), [(TINY, 0), (0, -TINY)], [(0, 0), (1,)]),
    "height of a wall": (lambda h: Wall((0, 0), (1, 0), h), [TINY], [0.0]),
    "thickness of a wall": (lambda t: Wall((0, 0), (1, 0), 1.0, t), [TINY], [0.0]),
    "size of a block": (
        lambda size: Block((0, 0), size),
        [(1, 1, TINY)],
        [(1, 1, 0), (1, 1), (1, -1, 1)],
    ),
    "mass of a block": (lambda m: Block((0, 0), mass_g=m), [None, TINY], [0.0, math.inf, math.nan]),
    "spread of a block": (
        lambda s: Block((0, 0), mass_g=1.0, spread_mm=s),
        [(0, 0), (0, 9)],
        [(-TINY, 0), (0, -TINY), (1,), (math.nan, 0)],
    ),
    "spread of a fixed block": (
        lambda s: Block((0, 0), spread_mm=s),
        [(0, 0)],
        [(TINY, 0), (0, TINY)],
    ),
    "diameter of a ball": (lambda d: Ball((0, 0), d), [TINY], [0.0]),
    "mass of a ball": (lambda m: Ball((0, 0), mass_g=m), [TINY], [0.0, math.inf]),
    "spread of a ball": (lambda s: Ball((0, 0), spread_mm=s), [(0, 0)], [(0, -TINY)]),
    "ramp": (
        lambda size: Ramp((0, 0), *size),
        [(TINY, TINY, TINY)],
        [(0, 1, 1), (1, 0, 1), (1, 1, 0)],
    ),
    "light of a lamp": (lambda pct: Lamp((0, 0, 0), pct), [TINY, 100.0], [0.0, 100.1, math.nan]),
    "place of a lamp": (Lamp, [(0, 0, 0)], [(0, 0), (0, 0, math.inf), 3]),
    "place of a beacon": (Beacon, [(0, 0, 0)], [(0, 0), (0, 0, math.nan)]),
    "oval": (lambda size: oval(*size), [(2.0, 2.0), (3.0, TINY)], [(1.9, 2.0), (1.0, 0.0)]),
    "pixels": (
        lambda pixels: picture(pixels=pixels),
        [PIXELS, PIXELS[:6]],
        [b"", PIXELS[:-1], PIXELS[:9]],
    ),
    "columns": (lambda n: picture(columns=n), [1, 2, 3, 6], [0, -1, 4]),
    "size of a picture": (
        lambda size: picture(size_mm=size),
        [(TINY, 1), (10_000, 10_000)],
        [(0, 1), (1, 0), (10_001, 1), (1, 10_001), (math.nan, 1), 5, (1,), ("a", 1)],
    ),
    "place of a picture": (
        lambda at: picture(at_mm=at),
        [(-1e6, 0.0)],
        [(math.nan, 0.0), (0.0, math.inf)],
    ),
    "heading of a start": (
        lambda b: Scene(heading_deg=b),
        [(-180.0, 180.0), (5, 5)],
        [(-180.1, 0.0), (0.0, 180.1), (1.0, 0.0), 5, ("a", "b")],
    ),
    "start": (
        lambda b: Scene(start_mm=(b, (0, 0))),
        [(-10_000, 10_000)],
        [(-10_001, 0), (0, 10_001)],
    ),
    "start to the side": (
        lambda b: Scene(start_mm=((0, 0), b)),
        [(-10_000, 10_000)],
        [(-10_001, 0), (0, 10_001)],
    ),
    "light": (lambda pct: Scene(light_pct=pct), [0.0, 100.0], [-0.1, 100.1, math.nan]),
    "wall": (
        lambda b: Scene(wall_distance_mm=b),
        [(20.0, 5000.0)],
        [(19.9, 30.0), (30.0, 5000.1)],
    ),
    "end stops": (
        lambda stops: Scene(end_stops={"m": stops}),
        [(0.0, 1.0), (-1.0, 0.0)],
        [(TINY, 1.0), (-1.0, -TINY)],
    ),
    "objects": (
        lambda objects: Scene(objects=objects),
        [(), [Beacon((0, 0, 0))], (picture(),)],
        [5, (5,), ("wall",), Beacon((0, 0, 0))],
    ),
    "width of a draw": (RandomPhysics, [0.0, 1.0], [-TINY, 1.0 + TINY, math.nan]),
    "motors of an arena": (
        lambda counts: arena(*counts),
        [(1,), (6, 6, 6, 6, 6, 1)],
        [(), (6, 6, 6, 6, 6, 2)],
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_what_is_within_is_taken_and_what_is_beyond_is_refused(name: str) -> None:
    assert_kept(LIMITS[name], TwinError)


def test_robots_of_an_arena_have_names_of_their_own() -> None:
    one, other = arena(1, 1).robots
    with pytest.raises(TwinError, match="an arena of r0, r0; give each robot"):
        Arena((one, one))
    assert Arena((one, other)).robots == (one, other)


@pytest.mark.parametrize(
    ("pixels", "size_mm", "said"),
    [
        ((100, 50), (100.0, 50.0), None),
        # Up to a twentieth, proportions may differ.
        ((100, 50), (102.0, 50.0), None),
        ((100, 50), (100.0, 60.0), "give its own size, such as 100x50"),
        ((100, 50), (60.0, 50.0), "give its own size, such as 60x30"),
    ],
)
def test_pictures_keep_their_proportions(
    tmp_path: Any, pixels: tuple[int, int], size_mm: tuple[float, float], said: str | None
) -> None:
    path = tmp_path / "mat.png"
    Image.new("RGB", pixels, "red").save(path)
    if said is None:
        read = read_picture(path, size_mm, (1.0, 2.0), 3.0)
        assert (read.columns, read.rows) == pixels
        assert (read.size_mm, read.at_mm, read.heading_deg) == (size_mm, (1.0, 2.0), 3.0)
        return
    with pytest.raises(TwinError, match=said):
        read_picture(path, size_mm)


def test_a_fine_picture_is_averaged_and_a_coarse_one_named(tmp_path: Any) -> None:
    fine = Image.new("L", (80, 40), 0)
    fine.paste(255, (0, 0, 80, 20))
    fine.putpixel((0, 0), 0)
    fine.save(tmp_path / "fine.png")
    read = read_picture(tmp_path / "fine.png", (40.0, 20.0))
    assert (read.columns, read.rows) == (40, 20)
    assert list(read.pixels[:3]) == pytest.approx([191.25] * 3, abs=1)
    assert read.pixels[3:6] == bytes([255] * 3)
    assert not faults_of_picture(tmp_path / "fine.png", (40.0, 20.0))
    (fault,) = faults_of_picture(tmp_path / "fine.png", (800.0, 400.0))
    assert "has 0.1 pixels a millimetre, and a sensor sees edges of 10 mm" in fault
    Image.new("RGBA", (40, 20), (255, 0, 0, 128)).save(tmp_path / "clear.png")
    (fault,) = faults_of_picture(tmp_path / "clear.png", (40.0, 20.0))
    assert "transparent in places" in fault
    half_red = read_picture(tmp_path / "clear.png", (40.0, 20.0)).pixels[:3]
    assert half_red[0] == 255 and half_red[1] == half_red[2] == pytest.approx(127, abs=1)
    for name in ("none.png", "text.png"):
        (tmp_path / "text.png").write_text("no picture")
        assert len(faults_of_picture(tmp_path / name, (40.0, 20.0))) == 1


def test_a_football_field_is_the_same_from_both_goals() -> None:
    scene = games.football()
    length, width = games.FIELD_MM
    ends = {
        frozenset({wall.from_mm, wall.to_mm}) for wall in scene.solids if isinstance(wall, Wall)
    }
    mirrored = {frozenset((-x, y) for x, y in pair) for pair in ends}
    other_side = {frozenset((x, -y) for x, y in pair) for pair in ends}
    assert ends == mirrored == other_side and len(ends) == 12
    corners = {point for pair in ends for point in pair}
    assert max(y for _, y in corners) == width / 2
    assert max(x for x, _ in corners) > length / 2
    # Nothing stands in a goal's mouth: at x of the goal line, walls begin at its posts.
    on_line = [pair for pair in ends if {x for x, _ in pair} == {length / 2}]
    assert sorted(min(abs(y) for _, y in pair) for pair in on_line) == [games.GOAL_MM / 2] * 2
    goals = [mark for mark in scene.marks if isinstance(mark, Field) and mark.size_mm[0] == 80.0]
    assert sorted((goal.at_mm, goal.color) for goal in goals) == [
        ((-length / 2 - 40.0, 0.0), "blue"),
        ((length / 2 + 40.0, 0.0), "yellow"),
    ]


def test_the_walls_of_a_table_are_around_its_mat() -> None:
    scene = games.table()
    walls = [wall for wall in scene.solids if isinstance(wall, Wall)]
    assert len(walls) == 4
    xs = [x for wall in walls for x, _ in (wall.from_mm, wall.to_mm)]
    ys = [y for wall in walls for _, y in (wall.from_mm, wall.to_mm)]
    thickness = {wall.thickness_mm for wall in walls}
    assert thickness == {38.0}
    assert (max(xs) - 19.0, max(ys) - 19.0) == (games.TABLE_MM[0] / 2, games.TABLE_MM[1] / 2)
    assert (min(xs), min(ys)) == (-max(xs), -max(ys))
    (x, _), (y, _) = scene.start_mm
    assert (x, y) == (-games.TABLE_MM[0] / 2 + 180.0, -games.TABLE_MM[1] / 2 + 180.0)


def test_each_block_has_a_field_of_its_color_and_crosses_another() -> None:
    scene = games.blocks()
    fields = {mark.color: mark.at_mm for mark in scene.marks if isinstance(mark, Field)}
    assert sorted(fields) == ["blue", "red", "yellow"]
    places = [(item.color, item.at_mm) for item in scene.pushable.values()]
    assert len({at for _, at in places}) == len(places) == 6
    for color, (x, y) in places:
        straight = y == fields[color][1]
        assert straight or y == -fields[color][1]
        assert x in (350.0, 600.0) and x < fields[color][0] - 150.0
