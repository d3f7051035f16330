"""Exchanges over each Bluetooth link of the virtual hub, one after the other and after pauses,
against published and estimated times. Nobody has published times over the cable of an EV3.

    python -m benchmarks link_exchanges

An exchange is a reading of the sensors over the link that trains robots (brickhub's HubLink),
retries included.
"""

from __future__ import annotations

from typing import Any

from benchmarks.session import Session
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.profiles import PROFILES
from brickhub.hub.link.timing import percentile
from brickhub.robot import BENCH
from brickhub.target import whole_interface
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

PERCENTS = (50, 95, 99, 99.9)
PAUSE_MS = 1000
EXPECTED: dict[str, dict[str, Any]] = {
    "mac": {
        "exchanges": {"p50": 30, "p95": 45, "p99.9": 100},
        "source": "an interval of about 15 ms on macOS, so two for an exchange; tail estimated",
    },
    "linux": {
        "exchanges": {"p50": 90, "p95": 105, "p99.9": 300},
        "after_pause": {"p95": 300},
        "source": (
            "11 Hz in the BricksRL paper; 30 to 50 ms (bluez#847); up to 300 ms after a "
            "pause (gattlib#223); p95 estimated"
        ),
    },
    "bad-room": {
        "exchanges": {"p50": 95, "p95": 190, "p99.9": 500},
        "source": "estimated: one event in ten is lost, in bursts",
    },
}
"""Times in ms, and where they are from."""


def measure(name: str, exchanges: int, pauses: int) -> dict[str, Any]:
    """Quantiles over one link, in ms."""
    hub, interface = VirtualHub(BenchBody(BENCH), link=PROFILES[name]), whole_interface(BENCH)
    with HubLink(hub, BENCH, interface) as link:
        rows = {
            "exchanges": [link.read().round_trip_s for _ in range(exchanges)],
            "after_pause": list[float](),
        }
        for _ in range(pauses):
            hub.run_on_until(hub.machine.time_ms + PAUSE_MS)
            rows["after_pause"].append(link.read().round_trip_s)
        counts = {
            "resends": link.statistics.resends,
            "watchdog_ms": round(1000 * link.statistics.watchdog_s),
        }
    quantiles = {
        row: {f"p{one:g}": round(1000 * percentile(times_s, one)) for one in PERCENTS}
        for row, times_s in rows.items()
    }
    return {**quantiles, **counts, "count": exchanges, "pauses": pauses}


def main(session: Session) -> None:
    """Measure all links and write."""
    args = session.parse(exchanges=10_000)
    parts = {
        f"{name}-{args.exchanges}": (name, args.exchanges, args.exchanges // 10)
        for name in EXPECTED
    }
    measured = dict(zip(EXPECTED, session.outcomes(measure, parts), strict=True))
    session.write(
        {"links": {name: found | {"expected": EXPECTED[name]} for name, found in measured.items()}}
    )
