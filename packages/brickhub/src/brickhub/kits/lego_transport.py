"""Virtual devices as a Bluetooth transport of LEGO's package ``legoeducation``, which is not
changed by it.

Importing this module needs the package (extra ``legoeducation``; BUSL-1.1), which finds virtual
devices from its first use on, once this transport is registered. Its coroutines run in the
package's own thread.
"""

import sys
from collections.abc import Mapping
from typing import Any, ClassVar

from legoeducation.ble_transport import BLETransport


class VirtualTransport(BLETransport):  # type: ignore[misc]  # the package has no types
    """Transport to the devices of all virtual kits of this process, each a ``Peer``. ``in_reach``:
    kits that a scan finds."""

    in_reach: ClassVar[list[Any]] = []
    _bluetooth: BLETransport | None = None

    async def scan_devices(
        self,
        timeout: float,
        filters: Mapping[str, Any] | None = None,
    ) -> list[Any]:
        """Virtual devices of the wanted product that nobody is connected to, at once; their card is
        the one that is asked for. Where no virtual kit is in reach, real devices."""
        if not self.in_reach:
            return await self._real().scan_devices(timeout, filters) or []
        found: list[Any] = []
        for kit in self.in_reach:
            found += [
                peer for peer in kit.peers if kit.in_reach() and _is_wanted(peer, filters or {})
            ]
        return found

    async def connect(
        self,
        device: Any,
        notification_callback: Any,
        disconnect_callback: Any,
    ) -> bool:
        if not _is_virtual(device):
            return bool(
                await self._real().connect(device, notification_callback, disconnect_callback)
            )
        return bool(device.connect(notification_callback, disconnect_callback))

    async def send(
        self,
        device: Any,
        message: bytes,
    ) -> None:
        if _is_virtual(device):
            device.send(bytes(message))
        else:
            await self._real().send(device, message)

    async def device_disconnect(self, device: Any) -> None:
        if _is_virtual(device):
            device.disconnect()
        else:
            await self._real().device_disconnect(device)

    def shutdown_all(self) -> None:
        for kit in self.in_reach:
            for peer in kit.peers:
                peer.disconnect()
        if self._bluetooth is not None:
            self._bluetooth.shutdown_all()
        if self.shutdown_callback is not None:
            self.shutdown_callback()

    def _real(self) -> BLETransport:
        """Bluetooth of this computer, or of this browser, as LEGO's package uses it by itself."""
        # Bluetooth is made only where it is used, because who has virtual devices may have none.
        if self._bluetooth is None:
            # Neither can be imported where the other one is.
            if sys.platform == "emscripten":
                from legoeducation.web_bluetooth import WebBluetoothTransport as Bluetooth
            else:
                from legoeducation.basic_ble import BasicBLE as Bluetooth

            self._bluetooth = Bluetooth(shutdown_callback=None)
        return self._bluetooth


def _is_wanted(peer: Any, filters: Mapping[str, Any]) -> bool:
    """Whether a scan with these filters finds a device; LEGO's package says "any" for no filter."""
    # A device to which somebody is connected does not advertise itself.
    if peer.device.is_connected:
        return False
    if filters.get("product_id") not in (None, peer.device.product):
        return False
    name = str(filters.get("device_name") or "any").lower()
    address = str(filters.get("device_mac") or "any").lower()
    has_name = name == "any" or name in peer.name.lower()
    has_address = address == "any" or address in peer.address.lower()
    return has_name and has_address


def _is_virtual(device: Any) -> bool:
    return str(device.address).startswith("virtual-")
