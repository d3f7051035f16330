"""Rays of an orthographic view through the solids of a part, and what is cut out of them. LDraw
units.

All depths are single precision, which is enough for a picture. A ray that misses a solid has NaN
for its depths there: whatever NaN is compared with, the answer is no.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.geometry import Bools, Form, Solid

Reals = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
_PARALLEL = 1e-6
"""Sine or squared sine below which a ray counts as parallel to a surface."""
_EPSILON = np.float32(0.02)
"""Least thickness of material along a ray, LDU. Without it rounding leaves films of material, at
almost a third of the points of a gear with 24 teeth (3648)."""
_MAX_PASSES = 12
"""Largest number of times that a ray may leave one cut and find itself in another."""
Window = tuple[slice, slice]
"""Slices of the rows and of the columns of an array."""


class Box(NamedTuple):
    """A range of columns and rows: the first ones, and the ones after the last."""

    left: int
    top: int
    right: int
    bottom: int

    def window(
        self,
        left: int,
        top: int,
    ) -> Window:
        """The rows and columns of this box in an array that begins at another column and row."""
        rows = slice(self.top - top, self.bottom - top)
        columns = slice(self.left - left, self.right - left)
        return rows, columns

    def shared_with(self, other: "Box") -> "Box | None":
        """What both boxes have, if anything."""
        shared = Box(
            max(self.left, other.left),
            max(self.top, other.top),
            min(self.right, other.right),
            min(self.bottom, other.bottom),
        )
        is_empty = shared.left >= shared.right or shared.top >= shared.bottom
        return None if is_empty else shared


def around(boxes: Sequence[Box]) -> Box:
    """The least box with all of these in it."""
    left, top, right, bottom = zip(*boxes, strict=True)
    return Box(
        min(left),
        min(top),
        max(right),
        max(bottom),
    )


class Spans(NamedTuple):
    """Depths at which rays enter and leave a convex solid; NaN for a ray that misses it."""

    enter: Reals
    leave: Reals


class Cut(NamedTuple):
    """Spans of rays in a cut, in a window of the rays of the piece."""

    solid: Solid
    box: Box
    window: Window
    spans: Spans


class Seen(NamedTuple):
    """A solid as a view sees it.

    Attributes:
        turned: rows: its axes, right, down and away [3, 3].
        centre: its centre along its own axes [3].
    """

    turned: Reals
    centre: Reals


def seen(solid: Solid, axes: Reals) -> Seen:
    """A solid in a view; ``axes``: right, down, away in the part's frame [3, 3]."""
    return Seen(solid.frame @ axes.T, solid.offset)


def pixel_boxes(
    solids: Sequence[Solid],
    axes: Reals,
    zoom: float,
) -> list[Box]:
    """The columns and rows of solids, at least one of each."""
    corners = np.stack([solid.corners() for solid in solids])  # [n, 8, 3]
    points = corners @ (zoom * axes[:2].T)  # [n, 8, 2]
    first = np.floor(points.min(axis=1)).astype(int)
    after_last = np.ceil(points.max(axis=1)).astype(int)
    after_last = np.maximum(after_last, first + 1)
    sides = np.hstack([first, after_last])  # [n, 4]
    return [Box(*four) for four in sides.tolist()]


class Grid(NamedTuple):
    """Rays through the middles of a box's columns [w] and rows [h], LDU; ``axes``: right, down,
    away in the part's frame [3, 3]."""

    x: Reals
    y: Reals
    axes: Reals

    def plane(
        self,
        right: float,
        down: float,
        constant: float,
    ) -> Reals:
        """Values ``right`` x + ``down`` y + ``constant`` of all rays [h, w]."""
        rows = down * self.y + constant
        return np.asarray(rows[:, None] + right * self.x)

    def spans(self, solid: Solid) -> list[Spans]:
        """Spans of the rays in a solid: one, or for a ring two, before and behind its bore."""
        turned, centre = seen(solid, self.axes)
        if solid.form is Form.BOX:
            sides = zip(turned, centre.tolist(), solid.half, strict=True)
            return [_common(*(self._slab(*side) for side in sides))]
        if solid.form is Form.BALL:
            return [self._ball(turned, centre, solid.half[0])]
        radius, bore_radius, half_length = solid.half
        ends = self._slab(turned[2], float(centre[2]), half_length)
        outer = _common(self._tube(turned[:2], centre[:2], radius), ends)
        if solid.form is Form.CYLINDER:
            return [outer]
        # A ring is not convex: a ray through its bore crosses the wall twice.
        bore = _common(self._tube(turned[:2], centre[:2], bore_radius), ends)
        is_bored = bore.enter < bore.leave
        before_bore = Spans(outer.enter, np.where(is_bored, bore.enter, outer.leave))
        behind_bore = Spans(np.where(is_bored, bore.leave, np.float32(np.nan)), outer.leave)
        return [before_bore, behind_bore]

    def _slab(
        self,
        turned: Reals,
        centre: float,
        half: float,
    ) -> Spans:
        """Spans of the rays between two parallel planes."""
        # The place of a ray across the slab is `right x + down y + away depth - centre`.
        right, down, away = turned.tolist()
        if abs(away) < _PARALLEL:
            across = self.plane(right, down, -centre)
            return _everywhere(np.abs(across) < half)
        reach = half / abs(away)
        middle = centre / away
        enter = self.plane(-right / away, -down / away, middle - reach)
        return Spans(enter, enter + np.float32(2 * reach))

    def _tube(
        self,
        turned: Reals,
        centre: Reals,
        radius: float,
    ) -> Spans:
        """Spans of the rays in an endless cylinder; its two axes across [2, 3]."""
        along = turned[:, 2]
        square = float(along @ along)
        in_view = np.column_stack([turned[:, :2], -centre])  # [2, 3]
        if square < _PARALLEL:
            first, second = (self.plane(*row) for row in in_view.tolist())
            return _everywhere(first**2 + second**2 < radius**2)
        # The ray comes nearest to the axis in the middle of its way through the cylinder; both
        # that depth and how near it comes depend on x and y like planes.
        normal = np.array([along[1], -along[0]]) / math.sqrt(square)
        middle = self.plane(*(-along @ in_view / square).tolist())
        nearest = self.plane(*(normal @ in_view).tolist())
        return _around(middle, np.square(nearest, out=nearest), radius, square)

    def _ball(
        self,
        turned: Reals,
        centre: Reals,
        radius: float,
    ) -> Spans:
        x, y, away = (centre @ turned).tolist()
        from_middle = np.square(self.y - y)[:, None] + np.square(self.x - x)
        middle = np.full(from_middle.shape, away, dtype=np.float32)
        return _around(middle, from_middle, radius, 1.0)


def _around(
    middle: Reals,
    distance: Reals,
    radius: float,
    square: float,
) -> Spans:
    """Spans around the depths where rays come nearest to a round solid, at these squared distances;
    ``square``: of the sine between ray and axis. Uses up ``distance``."""
    # Half the way through the solid is sqrt((radius^2 - distance^2) / square), NaN beside it.
    np.subtract(np.float32(radius**2), distance, out=distance)
    np.multiply(distance, np.float32(1 / square), out=distance)
    reach = np.sqrt(distance, out=distance)
    leave = middle + reach
    return Spans(np.subtract(middle, reach, out=middle), leave)


def _common(first: Spans, *others: Spans) -> Spans:
    """The common part of all spans, which it uses up."""
    enter, leave = first
    for other in others:
        np.maximum(enter, other.enter, out=enter)
        np.minimum(leave, other.leave, out=leave)
    return Spans(enter, leave)


def _everywhere(is_inside: Bools) -> Spans:
    """Rays that never leave where they are: inside a solid, or outside of it."""
    enter = np.where(is_inside, np.float32(-np.inf), np.float32(np.nan))
    return Spans(enter, -enter)


def grid(
    box: Box,
    axes: Reals,
    zoom: float,
) -> Grid:
    """The rays through the middles of these columns and rows."""
    x = (np.arange(box.left, box.right, dtype=np.float32) + 0.5) / zoom
    y = (np.arange(box.top, box.bottom, dtype=np.float32) + 0.5) / zoom
    return Grid(x, y, axes)


def cuts_in(
    cuts: Sequence[Solid],
    box: Box,
    axes: Reals,
    zoom: float,
) -> list[Cut]:
    """The cuts that rays of a box may meet; one with a bore is two."""
    if not cuts:
        return []
    found: list[Cut] = []
    for cut, whole in zip(cuts, pixel_boxes(cuts, axes, zoom), strict=True):
        # Following only the rays that the piece and the cut share saves most of the work.
        shared = whole.shared_with(box)
        if shared is None:
            continue
        window = shared.window(box.left, box.top)
        spans = grid(shared, axes, zoom).spans(cut)
        found += [Cut(cut, shared, window, span) for span in spans]
    return found


def first_material(span: Spans, cuts: Sequence[Cut]) -> tuple[Reals, Ints]:
    """Depths at which rays meet the material of a solid (NaN if nowhere), and the indices of the
    cuts that they come out of, -1 for none."""
    at = span.enter.copy()
    cut_by = np.full(at.shape, -1, dtype=np.int16)
    # Cuts overlap, as a bore and its recesses do, so a ray that leaves one may be in another that
    # was tested before it. Only those that share rays with a cut that moved some are tested again.
    is_beside = _beside(np.array([cut.box for cut in cuts]).reshape(-1, 4))
    is_waiting = np.ones(len(cuts), dtype=bool)
    for _ in range(_MAX_PASSES):
        if not is_waiting.any():
            break
        is_next = np.zeros(len(cuts), dtype=bool)
        for number in np.flatnonzero(is_waiting).tolist():
            if _leave(cuts[number], number, at, cut_by):
                is_next |= is_beside[number]
        is_waiting = is_next
    at[~(at < span.leave - _EPSILON)] = np.nan
    return at, cut_by


def _leave(
    cut: Cut,
    number: int,
    at: Reals,
    cut_by: Ints,
) -> bool:
    """Move the rays that are in a cut to its end. Whether there was one."""
    there = at[cut.window]
    is_empty = cut.spans.enter <= there + _EPSILON
    is_empty &= there < cut.spans.leave - _EPSILON
    if not is_empty.any():
        return False
    np.copyto(there, cut.spans.leave, where=is_empty)
    cut_by[cut.window][is_empty] = number
    return True


def _beside(boxes: Ints) -> Bools:
    """Whether two boxes (left, top, right, bottom) [n, 4] share rays [n, n]; none is beside
    itself."""
    left_top = boxes[:, :2]
    right_bottom = boxes[:, 2:]
    begins_before = left_top < right_bottom[:, None]  # [n, n, 2]
    ends_after = right_bottom > left_top[:, None]
    is_other = ~np.eye(len(boxes), dtype=bool)
    return np.asarray((begins_before & ends_after).all(axis=2) & is_other)
