"""Clock of the hub, seen from this computer: the age of an observation.

The two clocks have different starts. Each exchange bounds the difference: the sensors were not read before the command
was sent, nor after the answer arrived. The tightest bounds of the last exchanges are kept, and their middle is taken;
the error is at most half of what lies between them, about half of the link's shortest round trip. Recent exchanges
only, because crystals drift (50 millionths are 1 ms in 20 s).
"""

from __future__ import annotations

from collections import deque

_RECENT = 200
_WRAP_MS = 1 << 16


class HubClock:
    """One program's clock, from its start."""

    def __init__(self) -> None:
        self._time_ms: int | None = None
        self._at_least_s: deque[float] = deque(maxlen=_RECENT)
        self._at_most_s: deque[float] = deque(maxlen=_RECENT)

    def unwrap(self, time_ms: int) -> int:
        """The hub's clock without its wraps; answers are never a whole wrap (65.5 s) apart unless the program ended."""
        if self._time_ms is None:
            self._time_ms = time_ms
        else:
            self._time_ms += (time_ms - self._time_ms) % _WRAP_MS
        return self._time_ms

    def compare(self, time_ms: int, not_before_s: float, arrived_s: float) -> None:
        """Learn from an observation of the hub's time ``time_ms`` (without wraps), the others of this computer."""
        self._at_least_s.append(not_before_s - time_ms / 1000)
        self._at_most_s.append(arrived_s - time_ms / 1000)

    def age_s(self, time_ms: int, now_s: float) -> float:
        """Age of a time on the hub's clock; 0 while nothing was compared."""
        if not self._at_most_s:
            return 0.0
        at_most_s = min(self._at_most_s)
        difference_s = (min(max(self._at_least_s), at_most_s) + at_most_s) / 2
        return max(0.0, now_s - difference_s - time_ms / 1000)
