"""Collisions between parts: sample points of one part inside the material of another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from bricktwin.plans.geometry import Bools, Floats
from bricktwin.plans.plan import Placed

_MARGIN = 0.8
"""LDU; with the sampling depth, overlaps up to 0.7 mm are tolerated, as real parts are slightly smaller."""
_MIN_POINTS = 2
"""Minimum number of points inside."""
_MAX_PAIRS, _MAX_COMPARED = 200, 50_000
"""Limits of the collision search."""


class Occupancy:
    """Space occupied by the parts of a plan.

    Attributes:
        low, high: [n, 3], bounds of each part in the plan's frame.
        queries: number of calls of `is_free`.
    """

    def __init__(self, parts: Sequence[Placed]) -> None:
        self._parts = parts
        self.queries = 0
        self.low: Floats = np.array([placed.bounds[0] for placed in parts]).reshape(-1, 3)
        self.high: Floats = np.array([placed.bounds[1] for placed in parts]).reshape(-1, 3)

    def collisions(self) -> list[tuple[int, int]]:
        """Pairs of colliding parts, the lower index first; at most 200."""
        pairs: list[tuple[int, int]] = []
        compared = 0
        for index in range(len(self._parts)):
            for other in index + 1 + np.flatnonzero(self._near(index, np.zeros(3))[index + 1 :]):
                compared += 1
                if self._collide(index, int(other), np.zeros(3)):
                    pairs.append((index, int(other)))
                if len(pairs) >= _MAX_PAIRS or compared >= _MAX_COMPARED:
                    return pairs
        return pairs

    def is_free(self, group: Iterable[int], others: Bools, shift: Floats) -> bool:
        """Whether a group of parts, moved by ``shift``, collides with none of the parts in ``others`` [n]."""
        self.queries += 1
        for index in group:
            near = self._near(index, shift) & others
            if any(self._collide(index, int(other), shift) for other in np.flatnonzero(near)):
                return False
        return True

    def _near(self, index: int, shift: Floats) -> Bools:
        """Parts with bounds that overlap those of a moved part [n]."""
        low, high = self.low[index] + shift + 1.5, self.high[index] + shift - 1.5
        return np.asarray(((low < self.high) & (self.low < high)).all(axis=1))

    def _collide(self, index: int, other: int, shift: Floats) -> bool:
        if "chains" in (self._parts[index].part.family, self._parts[other].part.family):
            return False  # links are flexible, and lie between teeth
        return self._inside(index, other, shift) or self._inside(other, index, -shift)

    def _inside(self, index: int, other: int, shift: Floats) -> bool:
        """Whether points of a part, moved, lie in another."""
        points = self._parts[index].samples + shift
        near = ((points > self.low[other]) & (points < self.high[other])).all(axis=1)
        if np.count_nonzero(near) < _MIN_POINTS:
            return False
        target = self._parts[other]
        inner = target.to_part(points[near])
        # In large overlaps a few points are enough.
        return any(int(np.count_nonzero(target.part.contains(sample, _MARGIN))) >= _MIN_POINTS for sample in (inner[::23], inner))
