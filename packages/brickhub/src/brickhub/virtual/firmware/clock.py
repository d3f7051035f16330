"""Clock of the motor control."""

from __future__ import annotations

from typing import Protocol


class Clock(Protocol):
    """Simulated time in ms and in ticks of 0.1 ms, for controllers, observers and logs."""

    time_ms: int
    time_ticks: int
