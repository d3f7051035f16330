"""Entries of vectors: one number of an observation or of an action, wherever it is described."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One number of an observation, or the physical meaning of one of an action.

    Attributes:
        low, high: the range that tables state; infinite where there is none.
        limits: ends of what can occur, where the range is only nominal: a fast turn is reported as it is. ``None`` for the range.
        wraps: an angle that runs around from 360 to 0.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    limits: tuple[float, float] | None = None
    wraps: bool = False

    @property
    def bounds(self) -> tuple[float, float]:
        """Ends of what can occur."""
        return (self.low, self.high) if self.limits is None else self.limits
