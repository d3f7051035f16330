"""The air of a simulated team: what the robots of many copies tell one another.

A copy has no hubs, but the antenna that each hub would have, and the air between them is that of
the virtual hubs: its intervals, its losses, and for how long a message counts.
"""

from __future__ import annotations

from typing import Any

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
        self._copies = []
        for copy in range(copies):
            self._copies.append(
                _Copy(
                    robots=robots,
                    told=told,
                    step_ms=step_ms,
                    seed=derive_seed(seed, "air", copy),
                )
            )
        self._zeros = [[0] * told for _ in range(robots)]

    def step(self, numbers: Tensor) -> Tensor:
        """What each robot has heard at the end of a step, ``[copies, robots, others * told]``, of
        the numbers in -1..1 that they told at its beginning, ``[copies, robots, told]``."""
        clamped = numbers.clamp(-1.0, 1.0)
        hundredths = (clamped * HUNDREDTHS).round().int().tolist()
        heard = []
        for copy, told in zip(self._copies, hundredths, strict=True):
            heard.append(copy.step(told))
        return _numbers(heard, numbers.device)

    def restart(self, is_reset: Tensor) -> Tensor:
        """What each robot has heard at the start of an episode of some copies, bool ``[copies]``:
        they were placed, and have told zeros for a step; ``[reset copies, robots, others *
        told]``."""
        heard = []
        for number in is_reset.nonzero().flatten().tolist():
            copy = self._copies[number]
            copy.time_ms += PLACEMENT_MS
            heard.append(copy.step(self._zeros))
        return _numbers(heard, is_reset.device)


class _Copy:
    """Antennas of the robots of one copy, and the air between them."""

    def __init__(
        self,
        robots: int,
        told: int,
        step_ms: int,
        seed: int,
    ) -> None:
        self.time_ms = 0
        self._step_ms = step_ms
        self._nothing = (0,) * told
        self._antennas = []
        self._others = []
        for robot in range(robots):
            others = [other for other in range(robots) if other != robot]
            antenna = Antenna()
            antenna.observe(others)
            self._antennas.append(antenna)
            self._others.append(others)
        self._air = Air(
            self._antennas,
            lambda _one, _other: DISTANCE_M,
            seed,
        )

    def step(self, told: list[list[int]]) -> list[list[int]]:
        """What each robot has heard at the end of a step, ``[robots][others * told]``, of what they
        told at its beginning."""
        begin_ms = self.time_ms + EXCHANGE_MS
        end_ms = begin_ms + self._step_ms
        self.time_ms = end_ms
        # What was told in the step before is in the air until this one begins.
        self._air.carry(begin_ms)
        for robot, antenna in enumerate(self._antennas):
            antenna.broadcast(begin_ms, robot, tuple(told[robot]))
        self._air.carry(end_ms)
        return [self._heard(robot) for robot in range(len(told))]

    def _heard(self, robot: int) -> list[int]:
        """What a robot has heard of all others."""
        antenna = self._antennas[robot]
        numbers: list[Any] = []
        for other in self._others[robot]:
            message, _ = antenna.observed(self.time_ms, other)
            if isinstance(message, tuple):
                numbers += message
            else:
                numbers += self._nothing
        return numbers


def _numbers(hundredths: list[list[list[int]]], device: torch.device) -> Tensor:
    """Numbers in -1..1 of hundredths."""
    heard = torch.tensor(
        hundredths,
        dtype=torch.float32,
        device=device,
    )
    return heard / HUNDREDTHS
