"""Paths with rounded corners."""

from __future__ import annotations

import math

import pytest

from bricktwin.worlds.paths import pieces, rounded


def test_a_corner_becomes_an_arc_of_the_radius() -> None:
    path = rounded(((0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0)), 250.0)
    assert (path[0], path[-1]) == ((0.0, 0.0), (1000.0, 1000.0))
    arc = path[1:-1]
    assert (arc[0], arc[-1]) == (pytest.approx((750.0, 0.0)), pytest.approx((1000.0, 250.0)))
    middle = (750.0, 250.0)
    for point in arc:
        assert math.dist(point, middle) == pytest.approx(250.0, abs=0.01)
    # Between two points a straight line is at most 0.6 mm off the arc.
    chords = [
        math.dist(middle, ((x0 + x1) / 2, (y0 + y1) / 2))
        for (x0, y0), (x1, y1) in zip(arc, arc[1:], strict=False)
    ]
    assert min(chords) > 249.4


def test_an_arc_that_does_not_fit_is_the_largest_that_does() -> None:
    path = rounded(((0.0, 0.0), (100.0, 0.0), (100.0, -400.0)), 250.0)
    assert path[1] == pytest.approx((50.0, 0.0))
    assert path[-2] == pytest.approx((100.0, -50.0))


def test_a_corner_that_is_none_stays_a_point() -> None:
    corners = ((0.0, 0.0), (100.0, 0.0), (300.0, 0.0))
    assert rounded(corners, 50.0) == corners


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_closed_path_is_round_at_all_corners_whichever_way_it_goes(side: float) -> None:
    square = ((0.0, 0.0), (400.0, 0.0), (400.0, 400.0 * side), (0.0, 400.0 * side))
    path = rounded(square, 100.0, closed=True)
    assert len(path) == 4 * 13
    # The arcs come in the order of the corners, and each goes around its own middle.
    for number, (x, y) in enumerate(square):
        middle = (x + math.copysign(100.0, 200.0 - x), y + side * (100.0 if y == 0.0 else -100.0))
        for point in path[13 * number : 13 * number + 13]:
            assert math.dist(point, middle) == pytest.approx(100.0, abs=0.01)
            assert 0.0 <= point[0] <= 400.0 and 0.0 <= side * point[1] <= 400.0
    ways = [math.dist(*ends) for ends in zip(path, (*path[1:], path[0]), strict=True)]
    assert sum(ways) == pytest.approx(4 * 200.0 + math.tau * 100.0, rel=1e-3)


def test_an_arc_turns_by_no_more_than_its_step_between_two_points() -> None:
    path = rounded(((0.0, 0.0), (300.0, 0.0), (600.0, 300.0)), 100.0)
    arc = path[1:-1]
    # 45 degrees in six steps of 7.5.
    assert len(arc) == 7
    turns = [
        math.atan2(y1 - y0, x1 - x0) for (x0, y0), (x1, y1) in zip(path, path[1:], strict=False)
    ]
    assert turns == sorted(turns)
    steps = [math.degrees(b - a) for a, b in zip(turns[1:-1], turns[2:-1], strict=False)]
    assert steps == pytest.approx([7.5] * 5, abs=0.2)


BENT = ((0.0, 0.0), (300.0, 0.0), (300.0, 400.0))


@pytest.mark.parametrize(
    ("gaps_mm", "made"),
    [
        ((), [BENT]),
        (((100.0, 150.0),), [((0.0, 0.0), (100.0, 0.0)), ((150.0, 0.0), *BENT[1:])]),
        # Two on one side, and one around the corner.
        (
            ((50.0, 60.0), (200.0, 250.0)),
            [
                ((0.0, 0.0), (50.0, 0.0)),
                ((60.0, 0.0), (200.0, 0.0)),
                ((250.0, 0.0), (300.0, 0.0), (300.0, 400.0)),
            ],
        ),
        (
            ((250.0, 400.0),),
            [((0.0, 0.0), (250.0, 0.0)), ((300.0, 100.0), (300.0, 400.0))],
        ),
        (
            ((500.0, 600.0),),
            [((0.0, 0.0), (300.0, 0.0), (300.0, 200.0)), ((300.0, 300.0), (300.0, 400.0))],
        ),
        # From a corner on.
        (
            ((300.0, 400.0),),
            [((0.0, 0.0), (300.0, 0.0)), ((300.0, 100.0), (300.0, 400.0))],
        ),
    ],
)
def test_a_path_is_cut_where_its_gaps_begin_and_end(
    gaps_mm: tuple[tuple[float, float], ...], made: list[tuple[tuple[float, float], ...]]
) -> None:
    assert pieces(BENT, gaps_mm) == made


def test_a_gap_aslant_is_measured_along_the_path() -> None:
    first, second = pieces(((100.0, 50.0), (400.0, 450.0)), ((100.0, 200.0),))
    assert first == ((100.0, 50.0), (160.0, 130.0)) and second == ((220.0, 210.0), (400.0, 450.0))
