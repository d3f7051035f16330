"""Keepalive: when to tell a hub that this computer lives, while the hub carries out a step and there is nothing else to say.

A hub stops its motors when it has not heard from its host for the time of its watchdog. So a sign of life goes out at
least twice within that time; no oftener, because a write takes two connection intervals until it is acknowledged, and
an emergency stop and the next command have to wait for that. For the same reason none goes out when the answer is due.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

_PER_WATCHDOG = 2


def signs_of_life_s(move_s: float | None, watchdog_s: float) -> Iterator[float]:
    """Times of the signs, from the command on; without end.

    Args:
        move_s: time until the answer is due on the hub; ``None`` where nobody knows.
        watchdog_s: of the hub.
    """
    return itertools.accumulate(_pauses_s(move_s, watchdog_s / _PER_WATCHDOG))


def _pauses_s(move_s: float | None, longest_s: float) -> Iterator[float]:
    if move_s is not None:
        count = int(move_s / longest_s)
        pause_s = move_s / (count + 1)
        yield from itertools.repeat(pause_s, count)
        yield pause_s + longest_s / 2
    yield from itertools.repeat(longest_s)
