"""Keepalive: times of the frames that keep the hub's watchdog from firing while the hub carries out a step.

A hub stops its motors after hearing nothing from its host for the watchdog's time. So a keepalive is sent twice within
that time; not more often, because a write takes two connection intervals until it is acknowledged, and an emergency stop
and the next command have to wait for that. For the same reason none is sent when the answer is due.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

_PER_WATCHDOG = 2


def keepalive_times_s(move_s: float | None, watchdog_s: float) -> Iterator[float]:
    """Times of the keepalives, counted from the command; an infinite iterator.

    Args:
        move_s: time until the answer is due on the hub; ``None`` if unknown.
        watchdog_s: time of the hub's watchdog.
    """
    return itertools.accumulate(_pauses_s(move_s, watchdog_s / _PER_WATCHDOG))


def _pauses_s(move_s: float | None, longest_s: float) -> Iterator[float]:
    if move_s is not None:
        count = int(move_s / longest_s)
        pause_s = move_s / (count + 1)
        yield from itertools.repeat(pause_s, count)
        yield pause_s + longest_s / 2
    yield from itertools.repeat(longest_s)
