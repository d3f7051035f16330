"""Latency of a link: round trip, the share of a step that it takes, and what makes it faster."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from bricksrl.hub.interface import Interface
from bricksrl.hub.link.lockstep import HubLink

SLOW_INTERVAL_MS = 20.0
"""Above it there is something to gain."""
_INTERVAL_UNIT_MS = 1.25
_INTERVALS_PER_ROUND_TRIP = 2
"""A command waits for the next connection event, and its answer for the one after that."""

_ADVICE = {
    "linux": (
        "as root, write 6 into /sys/kernel/debug/bluetooth/hci0/conn_min_interval and 12 into conn_max_interval beside it, or "
        "MinConnectionInterval=6 and MaxConnectionInterval=12 below [LE] in /etc/bluetooth/main.conf, and connect again"
    ),
    "darwin": "macOS chooses the interval itself, usually 15 ms: disconnect other Bluetooth devices and bring the hub near",
    "win32": (
        "Windows 11 gives 15 ms or less to a program that asks for it, which Python cannot yet: disconnect other Bluetooth "
        "devices, bring the hub near, or use a computer with Linux or macOS"
    ),
}


@dataclass(frozen=True)
class Latency:
    """Measured latency of a link.

    Attributes:
        exchanges: readings of the sensors, one after the other.
        p50_ms, p99_ms: of their round trips.
        interval_ms: connection interval that follows from their median.
        link_share: part of a step of the environment that the link takes; ``None`` where a step has no fixed time.
    """

    exchanges: int
    p50_ms: float
    p99_ms: float
    interval_ms: float
    link_share: float | None

    @property
    def is_slow(self) -> bool:
        """True if a shorter interval can be had."""
        return self.interval_ms > SLOW_INTERVAL_MS


def measure(link: HubLink, interface: Interface, exchanges: int = 100) -> Latency:
    """Read the sensors so many times, over a link that is open. Moves nothing.

    Raises:
        HubError: the link failed.
    """
    link.read()
    return latency([link.read().round_trip_s for _ in range(exchanges)], interface)


def latency(round_trips_s: list[float], interface: Interface) -> Latency:
    """Latency from the round trips ``[n]`` of readings, n > 0."""
    p50_ms, p99_ms = (float(value) * 1000 for value in np.percentile(round_trips_s, (50, 99)))
    step_ms = interface.settle.fixed_ms
    return Latency(
        exchanges=len(round_trips_s),
        p50_ms=p50_ms,
        p99_ms=p99_ms,
        interval_ms=round(p50_ms / _INTERVALS_PER_ROUND_TRIP / _INTERVAL_UNIT_MS) * _INTERVAL_UNIT_MS,
        link_share=None if step_ms is None else p50_ms / (step_ms + p50_ms),
    )


def advice(platform: str = sys.platform) -> str:
    """Advice for a shorter connection interval on this operating system."""
    return _ADVICE.get(platform, "look for the connection interval in the settings of this system's Bluetooth")
