"""Statistics of a link: exchanges, round trips, resent frames."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

_RECENT_EXCHANGES = 500


def percentile(values: Iterable[float], percent: float) -> float:
    """Percentile of at least one value, interpolated between the two nearest."""
    ordered = sorted(values)
    position = (len(ordered) - 1) * (percent / 100)
    low, high = ordered[math.floor(position)], ordered[math.ceil(position)]
    share = position % 1
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1 - share)


def _recent() -> deque[float]:
    return deque(maxlen=_RECENT_EXCHANGES)


@dataclass(frozen=True)
class LinkStatistics:
    """Snapshot of counts since the link was made; percentiles are over the last 500 exchanges, and 0 before the first.

    Attributes:
        exchanges: commands and readings that were answered.
        resends: frames sent again because no answer came in time.
        stale_answers: answers to another sequence number than the one waited for.
        round_trip_p50_s, round_trip_p99_s: time from the first sending to the answer, including the commands' duration.
        age_p50_s, age_p99_s: age of the observations when they were returned.
        crc_errors, skipped_bytes: see ``FrameDecoder``.
        watchdog_s: silence after which the hub stops its motors.
    """

    exchanges: int
    resends: int
    stale_answers: int
    round_trip_p50_s: float
    round_trip_p99_s: float
    age_p50_s: float
    age_p99_s: float
    crc_errors: int
    skipped_bytes: int
    watchdog_s: float


@dataclass
class LinkMeter:
    """Counts for :class:`LinkStatistics`."""

    exchanges: int = 0
    resends: int = 0
    stale_answers: int = 0
    crc_errors: int = 0
    skipped_bytes: int = 0
    round_trips_s: deque[float] = field(default_factory=_recent)
    ages_s: deque[float] = field(default_factory=_recent)
    delays_s: deque[float] = field(default_factory=_recent)
    """Round trips minus the commands' duration, where that is known."""

    def record(self, round_trip_s: float, age_s: float, move_s: float | None, resends: int) -> None:
        """Count an exchange. ``move_s`` is the duration of its command, ``None`` if unknown; ``resends`` is the count before it.

        Waiting for a lost frame is no delay of the link: if counted, it would raise the watchdog's time ever further.
        """
        self.exchanges += 1
        self.ages_s.append(age_s)
        self.round_trips_s.append(round_trip_s)
        if move_s is not None and self.resends == resends:
            self.delays_s.append(max(0.0, round_trip_s - move_s))

    def delay_p99_s(self) -> float:
        """99th percentile of the link's delay; 0 while unknown."""
        return percentile(self.delays_s, 99) if self.delays_s else 0.0

    def snapshot(self, watchdog_s: float) -> LinkStatistics:
        round_trips_s, ages_s = self.round_trips_s or [0.0], self.ages_s or [0.0]
        return LinkStatistics(
            exchanges=self.exchanges,
            resends=self.resends,
            stale_answers=self.stale_answers,
            round_trip_p50_s=percentile(round_trips_s, 50),
            round_trip_p99_s=percentile(round_trips_s, 99),
            age_p50_s=percentile(ages_s, 50),
            age_p99_s=percentile(ages_s, 99),
            crc_errors=self.crc_errors,
            skipped_bytes=self.skipped_bytes,
            watchdog_s=watchdog_s,
        )
