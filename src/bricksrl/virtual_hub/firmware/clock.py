"""Clock of the motor control: the simulated time, in the two units that the firmware counts it in."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Source of the time that controllers, observers and logs see."""

    time_ms: int
    time_ticks: int
