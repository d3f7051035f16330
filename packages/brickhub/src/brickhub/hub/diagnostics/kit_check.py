"""Preflight check of a robot of LEGO's kits: its devices, their versions and batteries, their reports, and each move."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.preflight import check_moves
from brickhub.hub.interface import Interface
from brickhub.hub.kit_radio import Radio
from brickhub.hub.link.kit_link import PERIOD_MS, KitLink
from brickhub.robot import Robot

_WATCHED_S = 1.0
_LEAST_SHARE = 0.5
"""Share of the reports below which a link is slow."""
_LOW_BATTERY_PCT = 20


def check_kit(
    radio: Radio,
    robot: Robot,
    interface: Interface,
    *,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool] | None = None,
) -> Iterator[Finding]:
    """Check everything that a task needs of a robot of LEGO's kits. Raises HubError if a device cannot be reached.

    Args:
        radio: how to reach the devices.
        robot, interface, may_move, is_right: as for ``check_robot``.
    """
    with KitLink(radio, robot, interface) as link:
        before = {ports: device.reports for ports, device in link.devices.items()}
        radio.sleep(_WATCHED_S)
        for ports, device in link.devices.items():
            lego, name = device.lego, f"{device.part.product.title} {ports}"
            version, battery_pct = ".".join(map(str, lego.version_firmware)), lego.info_device.batteryLevel
            is_low = battery_pct < _LOW_BATTERY_PCT
            detail = f"firmware {version}, battery {battery_pct} %{', charge it' if is_low else ''}"
            yield Finding(name, Outcome.WARNING if is_low else Outcome.OK, detail)
            rate_hz = (device.reports - before[ports]) / _WATCHED_S
            is_slow = rate_hz < _LEAST_SHARE * 1000 / PERIOD_MS
            detail = (
                f"{rate_hz:.0f} a second{', of 67; disconnect other Bluetooth devices, and bring it near' if is_slow else ''}"
            )
            yield Finding(f"reports {ports}", Outcome.WARNING if is_slow else Outcome.OK, detail)
        yield from check_moves(link, robot, interface, may_move, is_right)
