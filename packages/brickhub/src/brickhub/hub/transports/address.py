"""Address of a hub: ``virtual``, ``ble``, ``ble:NAME``, ``ble:ADDRESS``, ``usb`` or
``usb:PORT``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from brickhub.errors import DescriptionError, UnknownNameError, hint

if TYPE_CHECKING:
    from brickhub.hub.transports.pybricks_hub import ProfileTransport
    from brickhub.robot import AnyHub

VIRTUAL = "virtual"
_REAL = ("ble", "usb")
_CHOICES = (
    "'virtual', 'ble' or 'usb'; 'ble:NAME', 'ble:ADDRESS' or 'usb:PORT' where there are several"
)
# macOS hides Bluetooth addresses and gives an identifier of its own instead.
_BLE_ADDRESS = re.compile(
    r"([0-9A-F]{2}:){5}[0-9A-F]{2}|[0-9A-F]{8}(-[0-9A-F]{4}){3}-[0-9A-F]{12}", re.IGNORECASE
)


@dataclass(frozen=True)
class HubAddress:
    """Address of a hub.

    Attributes:
        medium: ``"virtual"``, ``"ble"`` or ``"usb"``.
        which: name or address of a hub over Bluetooth, or serial port; ``None`` for the only one in
            reach.
    """

    medium: str
    which: str | None = None

    @property
    def is_virtual(self) -> bool:
        return self.medium == VIRTUAL

    def transport(self, kind: AnyHub | None = None) -> ProfileTransport:
        """An unopened transport to the hub, which is of this kind if that is known. Raises
        UnknownNameError if the hub is virtual, and needs a robot, DescriptionError if that kind is
        not reached so."""
        if kind is not None and self.medium == "ble" and not kind.model.has_bluetooth:
            raise DescriptionError(
                f"Pybricks on an {kind.value.upper()} Brick has no Bluetooth to a computer yet; "
                "plug its cable in, and say --hub usb"
            )
        if self.medium == "usb":
            from brickhub.hub.transports.usb import UsbTransport

            return UsbTransport(self.which)
        # A virtual hub moves the body of a robot, so its transport is made together with the robot.
        if self.is_virtual:
            raise UnknownNameError(
                "a virtual hub has no transport of its own; choose 'ble' or 'usb'"
            )
        # This import is here because commands that only name a hub should not wait for asyncio and
        # what is below it.
        from brickhub.hub.transports.ble import BleTransport

        if self.which is not None and _BLE_ADDRESS.fullmatch(self.which):
            return BleTransport(address=self.which)
        return BleTransport(name=self.which)


def parse_hub(text: str) -> HubAddress:
    """Parse the address of a hub. Raises UnknownNameError if there is no such kind of hub."""
    medium, colon, which = text.partition(":")
    if medium == VIRTUAL and not colon:
        return HubAddress(VIRTUAL)
    if medium not in _REAL or (colon and not which):
        raise UnknownNameError(
            f"there is no hub '{text}'{hint(medium, (VIRTUAL, *_REAL))}; choose {_CHOICES}"
        )
    return HubAddress(medium, which or None)
