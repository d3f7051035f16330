"""Times of a link: the hub's clock, repetitions of a frame, and statistics of the exchanges.

The clocks of hub and computer have different origins. Each exchange bounds their offset: the
sensors were read after the command was sent and before the answer arrived. The offset is the
midpoint of the tightest bounds of the recent exchanges; its error is at most half of their
distance, about half of the link's shortest round trip. Older exchanges are dropped because crystals
drift (50 ppm are 1 ms in 20 s).

A hub stops its motors after hearing nothing from its host for the watchdog's time, and ends its
program if that is in the middle of a step. So a step's frame is repeated as a keepalive: twice
within the watchdog's time where the step ends before it, six times in a longer step, so that four
in a row may get lost. Not more often, because a write takes two connection intervals until it is
acknowledged, and an emergency stop and the next command have to wait for that. For the same reason
none is sent when the answer is due. An answer is overdue after half of the watchdog's time, at
least twice the 99th percentile of the round trips.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

_COMPARED_EXCHANGES = 200
"""Exchanges whose bounds of the clocks' offset are kept: 20 s of steps of 100 ms, in which the
clocks drift apart by a millisecond."""
_RECENT_EXCHANGES = 500
"""Exchanges that the percentiles are of."""
_WRAP_MS = 1 << 16
"""The hub's clock on the wire has 16 bits."""
REPEATS_PER_WATCHDOG = 6
"""Repetitions of a frame within the watchdog's time, in a step that outlasts it."""
_REPEATS_IN_SHORT_STEP = 2
"""Those in a step that ends before it."""


class HubClock:
    """Clock of one hub program, from its start."""

    def __init__(self) -> None:
        self._time_ms = 0
        # The hub's clock was 0 at some time between these bounds, on this computer's clock.
        self._lower_bounds_s: deque[float] = deque(maxlen=_COMPARED_EXCHANGES)
        self._upper_bounds_s: deque[float] = deque(maxlen=_COMPARED_EXCHANGES)

    def unwrap(self, time_ms: int) -> int:
        """Unwrap the hub's 16-bit clock; answers are never a whole wrap (65.5 s) apart unless the
        program ended."""
        # Python's remainder is never negative, so a smaller number counts as a wrap.
        since_last_ms = (time_ms - self._time_ms) % _WRAP_MS
        self._time_ms += since_last_ms
        return self._time_ms

    def compare(
        self,
        time_ms: int,
        not_before_s: float,
        arrived_s: float,
    ) -> None:
        """Add the bounds of one exchange: ``time_ms`` is the hub's unwrapped clock, the others are
        this computer's."""
        time_s = time_ms / 1000
        self._lower_bounds_s.append(not_before_s - time_s)
        self._upper_bounds_s.append(arrived_s - time_s)

    def age_s(
        self,
        time_ms: int,
        now_s: float,
    ) -> float:
        """Age of a time on the hub's clock; 0 before the first exchange."""
        if not self._upper_bounds_s:
            return 0.0
        upper_bound_s = min(self._upper_bounds_s)
        # Clocks drift, so bounds from exchanges that are far apart may contradict each other.
        lower_bound_s = min(max(self._lower_bounds_s), upper_bound_s)
        offset_s = (lower_bound_s + upper_bound_s) / 2
        return max(0.0, now_s - offset_s - time_ms / 1000)


def repeat_times_s(move_s: float | None, watchdog_s: float) -> Iterator[float]:
    """Times at which a frame is repeated until its answer comes, counted from when it was sent; an
    infinite iterator.

    Args:
        move_s: time until the answer is due on the hub; ``None`` if unknown.
        watchdog_s: time of the hub's watchdog.
    """
    is_short = move_s is not None and move_s < watchdog_s
    repeats_per_watchdog = _REPEATS_IN_SHORT_STEP if is_short else REPEATS_PER_WATCHDOG
    longest_pause_s = watchdog_s / repeats_per_watchdog
    time_s = 0.0
    if move_s is None:
        while True:
            time_s += longest_pause_s
            yield time_s
    # Keepalives divide the move evenly. None falls on its end, where the answer is due and a write
    # would be in the way of the next command.
    count = int(move_s / longest_pause_s)
    pause_s = move_s / (count + 1)
    for _ in range(count):
        time_s += pause_s
        yield time_s
    # After this time an answer is overdue, so the frame or its answer was lost.
    overdue_s = watchdog_s / 2
    time_s += pause_s + overdue_s
    yield time_s
    while True:
        time_s += overdue_s
        yield time_s


def percentile(values: Iterable[float], percent: float) -> float:
    """Percentile of some values, interpolated between the two nearest; 0 for none."""
    ordered = sorted(values) or [0.0]
    position = (len(ordered) - 1) * (percent / 100)
    low = ordered[math.floor(position)]
    high = ordered[math.ceil(position)]
    share = position % 1
    # The result is computed from the nearer end, so that rounding never takes it beyond either.
    if share < 0.5:
        return low + (high - low) * share
    return high - (high - low) * (1 - share)


def _recent_times() -> deque[float]:
    return deque(maxlen=_RECENT_EXCHANGES)


@dataclass
class LinkStatistics:
    """Counts since the link was made; percentiles are over the last 500 exchanges, and 0 before the
    first.

    Attributes:
        exchanges: commands and readings that were answered.
        resends: frames sent again because no answer came in time.
        stale_answers: answers to another sequence number than the one waited for.
        crc_errors, skipped_bytes: see ``FrameDecoder``.
        watchdog_s: silence after which the hub stops its motors.
        round_trips_s: times from the first sending to the answer, including the commands' duration.
        ages_s: ages of the observations when they were returned.
        delays_s: times from writing a frame to its acknowledgement, the round trips of the link
            itself, except after a pause.
    """

    exchanges: int = 0
    resends: int = 0
    stale_answers: int = 0
    crc_errors: int = 0
    skipped_bytes: int = 0
    watchdog_s: float = 0.0
    round_trips_s: deque[float] = field(default_factory=_recent_times)
    ages_s: deque[float] = field(default_factory=_recent_times)
    delays_s: deque[float] = field(default_factory=_recent_times)

    @property
    def round_trip_p50_s(self) -> float:
        return percentile(self.round_trips_s, 50)

    @property
    def round_trip_p99_s(self) -> float:
        return percentile(self.round_trips_s, 99)

    @property
    def age_p50_s(self) -> float:
        return percentile(self.ages_s, 50)

    @property
    def age_p99_s(self) -> float:
        return percentile(self.ages_s, 99)

    def record(
        self,
        round_trip_s: float,
        age_s: float,
    ) -> None:
        """Count an exchange."""
        self.exchanges += 1
        self.ages_s.append(age_s)
        self.round_trips_s.append(round_trip_s)
