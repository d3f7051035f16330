"""Profiles of links: what a connection does to messages between a computer and a hub, as a table.

Over Bluetooth, computer and hub meet at connection events only. What is lost in one is sent again
in the next one. Losses come in bursts, after E. N. Gilbert (1960),
https://doi.org/10.1002/j.1538-7305.1960.tb03959.x: during one, ``BURST_LOSS`` of the events are
lost.
"""

from dataclasses import dataclass

from brickhub.errors import UnknownNameError, hint
from brickhub.robot import HubModel

BURST_LOSS = 0.5
"""Share of lost events during a burst; an estimate, as is the duration of bursts."""
PAUSE_MS = 500.0
"""Time without a command after which the next one is late: labapart/gattlib#223 had it at 1 s and
not below 0.5 s."""


@dataclass(frozen=True)
class LinkProfile:
    """Distribution of a link's delays and losses, in both directions.

    Attributes:
        interval_ms: connection interval, the time between two events; over USB, that between two
            looks of the hub at what has come; 0 for a link without delay.
        jitter_ms: mean of the exponentially distributed time that a message takes within the
            computer.
        loss: share of events in which a packet is lost, up to ``BURST_LOSS``.
        burst_ms: mean duration of a burst of losses.
        lost_notifications: share of the hub's notifications that never arrive.
        wake_ms: largest additional delay of a command after a pause, uniformly distributed.
    """

    interval_ms: float
    jitter_ms: float = 0.0
    loss: float = 0.0
    burst_ms: float = 300.0
    lost_notifications: float = 0.0
    wake_ms: float = 0.0


PROFILES = {
    "mac": LinkProfile(
        15.0,
        4.0,
        0.01,
        300.0,
        0.0001,
        80.0,
    ),
    "linux": LinkProfile(
        45.0,
        6.0,
        0.01,
        300.0,
        0.0001,
        250.0,
    ),
    "bad-room": LinkProfile(
        45.0,
        6.0,
        0.1,
        300.0,
        0.0002,
        250.0,
    ),
    # Nobody has published a round trip of an EV3 over USB. ASSUMED: 5 to 20 ms, twice the time
    # between two looks; nothing is lost on a cable.
    "usb-quick": LinkProfile(2.5, 0.25),
    "usb": LinkProfile(5.0, 0.5),
    "usb-slow": LinkProfile(10.0, 1.0),
}
"""Links by name. Intervals: about 15 ms on macOS; 30 to 50 ms on Linux (bluez/bluez#847), where the
BricksRL paper's 11 Hz are exchanges of two intervals of 45 ms. A pause on Linux: up to 300 ms
(labapart/gattlib#223). Notifications do get lost (pybricks/support#320), nobody has counted how
many. The rest is estimated."""
DEFAULT_LINK = "linux"
CABLE_LINK = "usb"
"""Link of a hub that is reached over USB only."""
IDEAL = LinkProfile(0.0)
"""A link without delays and losses."""


def profile(name: str) -> LinkProfile:
    """The profile of that name. Raises UnknownNameError if there is none."""
    if name not in PROFILES:
        raise UnknownNameError(
            f"there is no link '{name}'{hint(name, PROFILES)}; choose {', '.join(PROFILES)}"
        )
    return PROFILES[name]


def usual_link(hub: HubModel) -> LinkProfile:
    """The profile of a kind of hub, unless another one is chosen."""
    return PROFILES[DEFAULT_LINK if hub.has_bluetooth else CABLE_LINK]
