"""Clock synchronisation between hub and computer, for the age of an observation.

The two clocks have different origins. Each exchange bounds their offset: the sensors were read after the command was
sent and before the answer arrived. The offset is the midpoint of the tightest bounds of the recent exchanges; its error
is at most half of their distance, about half of the link's shortest round trip. Older exchanges are dropped because
crystals drift (50 ppm are 1 ms in 20 s).
"""

from __future__ import annotations

from collections import deque

_RECENT = 200
_WRAP_MS = 1 << 16


class HubClock:
    """Clock of one hub program, from its start."""

    def __init__(self) -> None:
        self._time_ms: int | None = None
        self._lower_bounds_s: deque[float] = deque(maxlen=_RECENT)
        self._upper_bounds_s: deque[float] = deque(maxlen=_RECENT)

    def unwrap(self, time_ms: int) -> int:
        """Unwrap the hub's 16-bit clock; answers are never a whole wrap (65.5 s) apart unless the program ended."""
        if self._time_ms is None:
            self._time_ms = time_ms
        else:
            self._time_ms += (time_ms - self._time_ms) % _WRAP_MS
        return self._time_ms

    def compare(self, time_ms: int, not_before_s: float, arrived_s: float) -> None:
        """Add the bounds of one exchange: ``time_ms`` is the hub's unwrapped clock, the others are this computer's."""
        self._lower_bounds_s.append(not_before_s - time_ms / 1000)
        self._upper_bounds_s.append(arrived_s - time_ms / 1000)

    def age_s(self, time_ms: int, now_s: float) -> float:
        """Age of a time on the hub's clock; 0 before the first exchange."""
        if not self._upper_bounds_s:
            return 0.0
        upper_bound_s = min(self._upper_bounds_s)
        offset_s = (min(max(self._lower_bounds_s), upper_bound_s) + upper_bound_s) / 2
        return max(0.0, now_s - offset_s - time_ms / 1000)
