"""Paths with rounded corners."""

from __future__ import annotations

import math

import pytest

from bricktwin.worlds.paths import rounded


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
