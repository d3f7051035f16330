"""Latency of a link: round trip, its share of a step, and advice to reduce it."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.statistics import percentile

SLOW_INTERVAL_MS = 20.0
"""Connection interval above which a shorter one is possible."""
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
        exchanges: number of consecutive sensor readings.
        p50_ms, p99_ms: percentiles of their round trips.
        interval_ms: connection interval inferred from the median.
        link_share: link's share of a step of the environment; ``None`` if a step has no fixed time.
    """

    exchanges: int
    p50_ms: float
    p99_ms: float
    interval_ms: float
    link_share: float | None

    @property
    def is_slow(self) -> bool:
        """True if a shorter interval is possible."""
        return self.interval_ms > SLOW_INTERVAL_MS


def measure(link: HubLink, interface: Interface, exchanges: int = 100) -> Latency:
    """Time ``exchanges`` sensor readings over an open link; nothing moves. Raises HubError if the link failed."""
    link.read()
    return latency([link.read().round_trip_s for _ in range(exchanges)], interface)


def latency(round_trips_s: list[float], interface: Interface) -> Latency:
    """Latency statistics of the round trips ``[n]`` of readings, n > 0."""
    p50_ms, p99_ms = (percentile(round_trips_s, percent) * 1000 for percent in (50, 99))
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
