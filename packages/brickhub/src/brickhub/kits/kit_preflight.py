"""Preflight check of a robot of LEGO's kits: firmware, battery and reports of each device, then the
motors."""

from collections.abc import Callable, Iterator

from brickhub.finding import Finding, Outcome
from brickhub.hub.diagnostics.preflight import check_moves, judged
from brickhub.hub.interface import Interface
from brickhub.kits.link import PERIOD_MS, KitLink
from brickhub.kits.radio import Radio
from brickhub.robot import Robot

_WATCHED_S = 1.0
"""Time over which reports are counted."""
_LEAST_REPORTS = 0.5
"""Share of the reports of a device of LEGO's kits below which its link is slow."""
_LOW_BATTERY_PCT = 20


def check_kit(
    radio: Radio,
    robot: Robot,
    interface: Interface,
    *,
    may_move: Callable[[], bool],
    is_right: Callable[[str], bool | None] | None = None,
) -> Iterator[Finding]:
    """Check everything that a task needs of a robot of LEGO's kits. Raises HubError if a device
    cannot be reached.

    Args:
        radio: how to reach the devices.
        robot, interface, may_move, is_right: as for ``check_robot``.
    """
    with KitLink(radio, robot, interface) as link:
        before = {ports: device.reports for ports, device in link.devices.items()}
        radio.sleep(_WATCHED_S)
        for ports, device in link.devices.items():
            lego = device.lego
            name = f"{device.part.product.title} {ports}"
            version = ".".join(map(str, lego.version_firmware))
            battery_pct = lego.info_device.batteryLevel
            low = (battery_pct < _LOW_BATTERY_PCT, Outcome.WARNING, ", charge it")
            yield judged(name, f"firmware {version}, battery {battery_pct} %", low)
            rate_hz = (device.reports - before[ports]) / _WATCHED_S
            is_slow = rate_hz < _LEAST_REPORTS * 1000 / PERIOD_MS
            remedy = ", of 67; disconnect other Bluetooth devices, and bring it near"
            slow = (is_slow, Outcome.WARNING, remedy)
            yield judged(f"reports {ports}", f"{rate_hz:.0f} a second", slow)
        # These checks come last, because only they move something and need a person.
        yield from check_moves(
            link,
            robot,
            interface,
            may_move,
            is_right,
        )
