"""The air between hubs in one room: what one broadcasts, the others observe.

Rules of the firmware, from ``pb_type_ble_radio.c`` of Pybricks 4: what was heard on a channel lasts
1 s, its strength is smoothed over 512 ms, the last message of a channel counts, and a hub does not
hear itself. A hub advertises every 100 ms, and the Bluetooth specification adds 0 to 10 ms at
random to each interval (volume 6, part B, 4.4.2.2.1).

Assumptions, as nobody has published measurements of all kinds of hubs: one message in twenty is
lost, and the strength is that of a small antenna, -55 dBm at 1 m, 6 dB less at twice the distance.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

Value = bool | int | float | str | bytes
Message = Value | tuple[Value, ...]

INTERVAL_MS = 100.0
"""Time between two advertisements."""
_LARGEST_DELAY_MS = 10.0
LASTS_MS = 1000
"""Time for which a message counts."""
_SMOOTHING_MS = 512
NOTHING_HEARD_DBM = -128
_AT_ONE_METRE_DBM = -55.0
_LOST = 0.05
"""Share of messages that are lost."""
_NEAREST_M = 0.05
DISTANCE_M = 0.5
"""Distance of two hubs on a bench."""


@dataclass
class Heard:
    """What a hub has heard on a channel."""

    time_ms: int = -LASTS_MS - 1
    message: Message | None = None
    strength_dbm: int = NOTHING_HEARD_DBM

    def take(self, time_ms: int, message: Message, strength_dbm: int) -> None:
        """Hear a message."""
        weight = min(time_ms - self.time_ms, _SMOOTHING_MS)
        before = self.strength_dbm * (_SMOOTHING_MS - weight)
        # The firmware divides without a sign, which rounds down.
        self.strength_dbm = (before + strength_dbm * weight) // _SMOOTHING_MS
        self.time_ms = time_ms
        self.message = message


@dataclass
class Antenna:
    """What a hub broadcasts and has heard.

    Attributes:
        heard: by channel; a hub hears the channels that it observes.
        changes: what it broadcasts from a time (ms) on: channel and message; ``None`` for nothing.
        is_in_air: whether others could hear it; alone, it keeps its last change only.
        current: channel and message that it broadcasts now; ``None`` for nothing.
        busy_until_ms: when a task can change that again.
    """

    heard: dict[int, Heard] = field(default_factory=dict)
    changes: list[tuple[int, int, Message | None]] = field(default_factory=list)
    is_in_air: bool = False
    current: tuple[int, Message] | None = None
    busy_until_ms: int = 0

    def observe(self, channels: Sequence[int]) -> None:
        """Listen to these channels."""
        self.heard = {channel: Heard() for channel in channels}

    def broadcast(self, time_ms: int, channel: int, message: Message | None) -> None:
        """Broadcast a message from now on, or nothing."""
        self.current = None if message is None else (channel, message)
        if not self.is_in_air:
            self.changes.clear()
        self.changes.append((time_ms, channel, message))

    def fall_silent(self, time_ms: int) -> None:
        """End broadcasting and listening, as at the end of a program."""
        self.broadcast(time_ms, 0, None)
        self.heard = {}

    def observed(self, time_ms: int, channel: int) -> tuple[Message | None, int]:
        """The last message of a channel, if it still counts, and its strength."""
        heard = self.heard[channel]
        if time_ms - heard.time_ms > LASTS_MS:
            heard.message = None
            heard.strength_dbm = NOTHING_HEARD_DBM
        return heard.message, heard.strength_dbm


class Air:
    """The air between antennas.

    Args:
        antennas: of the hubs in the room.
        distance_m: distance of two of them, by number.
        seed: seed of delays and losses.
    """

    def __init__(
        self,
        antennas: Sequence[Antenna],
        distance_m: Callable[[int, int], float],
        seed: int = 0,
    ) -> None:
        self._antennas = antennas
        for antenna in antennas:
            antenna.is_in_air = True
        self._distance_m = distance_m
        # Each hub draws by itself, so that one more hub changes nothing between the others.
        self._draws = [random.Random(f"{seed}/{number}") for number in range(len(antennas))]
        self._due_ms: list[float | None] = [None] * len(antennas)

    def carry(self, time_ms: int) -> None:
        """Let the antennas hear what was advertised up to a time. All hubs have come so far."""
        for number, antenna in enumerate(self._antennas):
            self._advertise(number, antenna, time_ms)

    def _advertise(self, number: int, antenna: Antenna, until_ms: int) -> None:
        draws = self._draws[number]
        changes = antenna.changes
        while changes:
            due_ms = self._due_ms[number]
            if due_ms is None:
                due_ms = changes[0][0] + draws.uniform(0.0, _LARGEST_DELAY_MS)
            if due_ms > until_ms:
                self._due_ms[number] = due_ms
                return
            # Of several changes before an advertisement the last one counts.
            while len(changes) > 1 and changes[1][0] <= due_ms:
                changes.pop(0)
            _, channel, message = changes[0]
            if message is None:
                changes.pop(0)
                self._due_ms[number] = None
                continue
            self._send(number, math.ceil(due_ms), channel, message)
            self._due_ms[number] = due_ms + INTERVAL_MS + draws.uniform(0.0, _LARGEST_DELAY_MS)

    def _send(self, number: int, time_ms: int, channel: int, message: Message) -> None:
        draws = self._draws[number]
        for other, antenna in enumerate(self._antennas):
            if other == number:
                continue
            # Drawn for each hub, heard or not, so that who listens changes nothing for the others.
            is_lost = draws.random() < _LOST
            if channel in antenna.heard and not is_lost:
                distance_m = max(self._distance_m(number, other), _NEAREST_M)
                strength_dbm = round(_AT_ONE_METRE_DBM - 20.0 * math.log10(distance_m))
                antenna.heard[channel].take(time_ms, message, strength_dbm)
