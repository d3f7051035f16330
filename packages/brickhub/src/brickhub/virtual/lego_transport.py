"""Virtual devices as a Bluetooth transport of LEGO's package ``legoeducation``, which is not changed by it.

Importing this module needs the package (extra ``legoeducation``; BUSL-1.1). Its coroutines run in the package's own thread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from legoeducation.ble_transport import BLETransport, register_transport


class VirtualTransport(BLETransport):  # type: ignore[misc]  # the package has no types
    """Transport to the devices of all virtual kits of this process, each a ``Peer``. ``in_reach``: kits that a scan finds."""

    in_reach: ClassVar[list[Any]] = []

    async def scan_devices(self, timeout: float, filters: Mapping[str, Any] | None = None) -> list[Any]:
        """Devices of the wanted product that nobody is connected to, at once. Their card is the one that is asked for."""
        wanted = filters or {}
        name, address = (str(wanted.get(key) or "any") for key in ("device_name", "device_mac"))
        return [
            peer
            for kit in self.in_reach
            for peer in kit.peers
            if kit.in_reach()
            and not peer.device.is_connected
            and wanted.get("product_id") in (None, peer.device.product)
            and (name == "any" or name.lower() in peer.name.lower())
            and (address == "any" or address.lower() in peer.address.lower())
        ]

    async def connect(self, device: Any, notification_callback: Any, disconnect_callback: Any) -> bool:
        return bool(device.connect(notification_callback, disconnect_callback))

    async def send(self, device: Any, message: bytes) -> None:
        device.send(bytes(message))

    async def device_disconnect(self, device: Any) -> None:
        device.disconnect()

    def shutdown_all(self) -> None:
        for kit in self.in_reach:
            for peer in kit.peers:
                peer.disconnect()
        if self.shutdown_callback is not None:
            self.shutdown_callback()


def use_virtual_devices() -> None:
    """Let LEGO's package find virtual devices in this process, from its first use on."""
    register_transport(VirtualTransport)
