"""The view of several robots."""

from __future__ import annotations

import pytest

from bricktwin.twin.standing import Pose
from bricktwin.view.around import view_around


@pytest.mark.parametrize(
    ("places_m", "middle_m", "width_m"),
    [
        ([(0.3, -0.2)], (0.3, -0.2), 0.0),
        ([(0.0, 0.0), (0.4, -1.0), (0.2, 0.2)], (0.2, -0.4), 1.2),
        ([(-0.5, 0.1), (1.5, 0.0)], (0.5, 0.05), 2.0),
    ],
)
def test_camera_is_farther_away_the_farther_robots_are_apart(places_m, middle_m, width_m):
    view = view_around([Pose(x_m, y_m, 0.0) for x_m, y_m in places_m])
    assert view.target == pytest.approx((*middle_m, 0.0))
    assert view.distance_m == pytest.approx(1.0 + width_m)
