"""View of several robots in one world: from behind and above them."""

from collections.abc import Sequence

from bricktwin.twin.standing import Pose
from bricktwin.view.drawing_of_body import View

_AROUND_M = 1.0
"""Distance of the camera from robots, beyond that of the outer ones from one another."""
_FROM_BEHIND_DEG = -150.0
_FROM_ABOVE_DEG = 35.0


def view_around(places: Sequence[Pose]) -> View:
    """The view in which all robots at these places are seen; at least one."""
    xs_m = [place.x_m for place in places]
    ys_m = [place.y_m for place in places]
    middle = ((min(xs_m) + max(xs_m)) / 2, (min(ys_m) + max(ys_m)) / 2, 0.0)
    width_m = max(max(xs_m) - min(xs_m), max(ys_m) - min(ys_m))
    return View(
        middle,
        width_m + _AROUND_M,
        _FROM_BEHIND_DEG,
        _FROM_ABOVE_DEG,
    )
