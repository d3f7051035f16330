"""Entries of vectors: single numbers of an observation or an action."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One number of an observation, or the physical quantity of one of an action.

    Attributes:
        low, high: nominal range; infinite if there is none.
        limits: lowest and highest possible value if the range is only nominal, as for a rate of
            turn; ``None`` for the range.
        wraps: whether it is an angle that wraps from 360 to 0.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    limits: tuple[float, float] | None = None
    wraps: bool = False

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest possible value."""
        return (self.low, self.high) if self.limits is None else self.limits
