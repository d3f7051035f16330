"""Which hubs are in reach."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bricksrl.errors import HubError
from bricksrl.hub.event_loop import EventLoopThread
from bricksrl.hub.failures import AmbiguousHubError, BluetoothUnavailableError, HubNotFoundError, bleak_errors
from bricksrl.hub.pybricks_profile import SERVICE_UUID

if TYPE_CHECKING:
    from bleak.backends.client import BaseBleakClient
    from bleak.backends.device import BLEDevice
    from bleak.backends.scanner import AdvertisementData, BaseBleakScanner

_log = logging.getLogger(__name__)

_OTHERS_S = 0.5
_REMEDY = "switch it on, bring it near, and close other programs that are connected to it"


@dataclass(frozen=True)
class BleBackend:
    """What reaches the radio, where it is not bleak's own choice for this operating system."""

    scanner: type[BaseBleakScanner]
    client: type[BaseBleakClient]


@dataclass(frozen=True)
class FoundHub:
    """A hub that advertises itself; one whose program runs does not.

    Attributes:
        name: that its owner gave it.
        address: of its radio; on macOS one that only this computer knows.
        rssi_dbm: strength of its signal; -60 is near, -90 is far.
    """

    name: str
    address: str
    rssi_dbm: int


def scan(timeout_s: float = 5.0, *, backend: BleBackend | None = None) -> list[FoundHub]:
    """All hubs with Pybricks that advertise themselves within this time, the nearest first.

    Raises:
        BluetoothUnavailableError: this computer has no Bluetooth that may be used.
    """
    loop = EventLoopThread("bricksrl-scan")
    try:
        return loop.run(_scan(timeout_s, backend), timeout_s + 10.0, "look for hubs")
    finally:
        loop.close()


async def _scan(timeout_s: float, backend: BleBackend | None) -> list[FoundHub]:
    from bleak import BleakScanner

    with bleak_errors("look for hubs", BluetoothUnavailableError):
        async with BleakScanner(service_uuids=[SERVICE_UUID], backend=backend.scanner if backend else None) as scanner:
            await asyncio.sleep(timeout_s)
        found = [_found(*pair) for pair in scanner.discovered_devices_and_advertisement_data.values()]
    return sorted(found, key=lambda hub: -hub.rssi_dbm)


async def find(name: str | None, address: str | None, timeout_s: float, backend: BleBackend | None) -> BLEDevice:
    """The hub of this name or address; without either, the only one in reach.

    Raises:
        HubNotFoundError: it is not there.
        AmbiguousHubError: several are there, and none was named.
        BluetoothUnavailableError: this computer has no Bluetooth that may be used.
    """
    from bleak import BleakScanner

    found: dict[str, tuple[BLEDevice, FoundHub]] = {}
    others: dict[str, FoundHub] = {}
    with bleak_errors("look for hubs", BluetoothUnavailableError):
        async with BleakScanner(service_uuids=[SERVICE_UUID], backend=backend.scanner if backend else None) as scanner:
            try:
                async with asyncio.timeout(timeout_s) as bound:
                    async for device, advertisement in scanner.advertisement_data():
                        hub = _found(device, advertisement)
                        if not _is_wanted(hub, name, address):
                            others[hub.address] = hub
                            continue
                        found[hub.address] = (device, hub)
                        if name or address:
                            break
                        if len(found) == 1:  # whoever names none must have one only: see whether there are others
                            bound.reschedule(min(asyncio.get_running_loop().time() + _OTHERS_S, bound.when() or 0.0))
            except TimeoutError:
                pass
    if len(found) == 1:
        device, hub = next(iter(found.values()))
        _log.info("found the hub '%s' (%s, %d dBm)", hub.name, hub.address, hub.rssi_dbm)
        return device
    raise _not_found(name or address, [hub for _, hub in found.values()] or list(others.values()), timeout_s)


def _found(device: BLEDevice, advertisement: AdvertisementData) -> FoundHub:
    return FoundHub(advertisement.local_name or device.name or "", device.address, advertisement.rssi)


def _is_wanted(hub: FoundHub, name: str | None, address: str | None) -> bool:
    return (name is None or hub.name == name) and (address is None or hub.address.casefold() == address.casefold())


def _not_found(wanted: str | None, others: list[FoundHub], timeout_s: float) -> HubError:
    names = ", ".join(f"'{hub.name}' ({hub.address})" for hub in others)
    if wanted is None and others:
        return AmbiguousHubError(f"several hubs are in reach: {names}; say which one by its name or address")
    what = "no hub" if wanted is None else f"no hub '{wanted}'"
    seen = f"; others are: {names}" if names else ""
    return HubNotFoundError(f"{what} with Pybricks was found within {timeout_s:g} s{seen}; {_REMEDY}")
