"""The air of a simulated team: what the robots of many copies tell one another.

A copy has no hubs, but the antenna that each hub would have, and the air between them is that of
the virtual hubs: its intervals, its losses, and for how long a message counts.
"""

from __future__ import annotations

import torch
from torch import Tensor

from brickhub.hub.messages import HUNDREDTHS
from brickhub.seed import derive_seed
from brickhub.virtual.air import Air, Antenna
from brickhub.virtual.link_radio import PLACEMENT_MS

EXCHANGE_MS = 110
"""Time from a hub's answer to its next command, over the default link: measured, the steps of
`Tag-v0` of 250 ms begin every 360 ms in the arena."""
DISTANCE_M = 1.0
"""Distance of any two robots, which changes only how strong a message is."""


class SimulatedAir:
    """Antennas ``[copies, robots]``, and the air between those of each copy.

    Args:
        told: numbers that each robot tells.
        step_ms: duration of a step on the hub.
    """

    def __init__(
        self,
        copies: int,
        robots: int,
        told: int,
        step_ms: int,
        seed: int,
    ) -> None:
        self._robots = range(robots)
        self._told = told
        self._step_ms = step_ms
        self._time_ms = [0] * copies
        self._antennas = []
        self._airs = []
        for copy in range(copies):
            antennas = [Antenna() for _ in self._robots]
            for robot, antenna in enumerate(antennas):
                antenna.observe([other for other in self._robots if other != robot])
            air_seed = derive_seed(seed, "air", copy)
            self._antennas.append(antennas)
            self._airs.append(Air(antennas, lambda _one, _other: DISTANCE_M, air_seed))

    def step(self, numbers: Tensor) -> Tensor:
        """What each robot has heard at the end of a step, ``[copies, robots, others * told]``, of
        the numbers in -1..1 that they told at its beginning, ``[copies, robots, told]``."""
        hundredths = (numbers.clamp(-1.0, 1.0) * HUNDREDTHS).round().int().tolist()
        heard = [self._heard(copy, told) for copy, told in enumerate(hundredths)]
        return torch.tensor(heard, dtype=torch.float32, device=numbers.device) / HUNDREDTHS

    def restart(self, is_reset: Tensor) -> Tensor:
        """What each robot has heard at the start of an episode of some copies, bool ``[copies]``:
        they were placed, and have told zeros for a step; ``[reset copies, robots, others *
        told]``."""
        zeros = [[0] * self._told for _ in self._robots]
        heard = []
        for copy in is_reset.nonzero().flatten().tolist():
            self._time_ms[copy] += PLACEMENT_MS
            heard.append(self._heard(copy, zeros))
        return torch.tensor(heard, dtype=torch.float32, device=is_reset.device) / HUNDREDTHS

    def _heard(self, copy: int, told: list[list[int]]) -> list[list[int]]:
        """What each robot of a copy has heard at the end of a step, ``[robots][others * told]``."""
        antennas = self._antennas[copy]
        begin_ms = self._time_ms[copy] + EXCHANGE_MS
        end_ms = begin_ms + self._step_ms
        self._time_ms[copy] = end_ms
        # What was told in the step before is in the air until this one begins.
        self._airs[copy].carry(begin_ms)
        for robot, antenna in enumerate(antennas):
            antenna.broadcast(begin_ms, robot, tuple(told[robot]))
        self._airs[copy].carry(end_ms)
        nothing = (0,) * self._told
        heard = []
        for robot, antenna in enumerate(antennas):
            numbers: list[int] = []
            for other in self._robots:
                if other != robot:
                    message, _ = antenna.observed(end_ms, other)
                    numbers += message if isinstance(message, tuple) else nothing
            heard.append(numbers)
        return heard
