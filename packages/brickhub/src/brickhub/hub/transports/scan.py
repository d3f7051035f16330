"""Bluetooth scan for hubs in reach."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from brickhub.errors import HubProtocolError
from brickhub.hub.hub_errors import AmbiguousHubError, BluetoothUnavailableError, HubNotFoundError
from brickhub.hub.transports.bluetooth import bleak_errors
from brickhub.hub.transports.event_loop import EventLoopThread
from brickhub.hub.transports.profile import PNP_ID_UUID, SERVICE_UUID, parse_hub_kind
from brickhub.robot import HubKind

if TYPE_CHECKING:
    from bleak.backends.adapter import BaseBleakAdapter
    from bleak.backends.client import BaseBleakClient
    from bleak.backends.device import BLEDevice
    from bleak.backends.scanner import AdvertisementData, BaseBleakScanner

_log = logging.getLogger(__name__)

_OTHERS_S = 0.5
_REMEDY = "switch it on, bring it near, and close other programs that are connected to it"


@dataclass(frozen=True)
class BleBackend:
    """Bleak backend in place of the operating system's default."""

    scanner: type[BaseBleakScanner]
    client: type[BaseBleakClient]
    adapter: type[BaseBleakAdapter]


@dataclass(frozen=True)
class FoundHub:
    """An advertising hub; a hub that runs a program does not advertise.

    Attributes:
        name: name given by its owner.
        address: Bluetooth address; on macOS an identifier that is valid on this computer only.
        rssi_dbm: signal strength; -60 is near, -90 is far.
        kind: kind of hub, if known.
    """

    name: str
    address: str
    rssi_dbm: int
    kind: HubKind | None = None


_Found: TypeAlias = "list[tuple[BLEDevice, FoundHub]]"
_Seen: TypeAlias = "dict[str, tuple[BLEDevice, FoundHub]]"
"""Found hubs by address."""


def scan(timeout_s: float = 5.0, *, backend: BleBackend | None = None) -> list[FoundHub]:
    """Advertising Pybricks hubs, found within ``timeout_s``, the strongest signal first. Raises BluetoothUnavailableError if
    Bluetooth is not available on this computer."""
    with contextlib.closing(EventLoopThread("bricksrl-scan")) as loop:
        return loop.run(_scan(timeout_s, backend), timeout_s + 10.0, "look for hubs")


async def _scan(timeout_s: float, backend: BleBackend | None) -> list[FoundHub]:
    seen: _Seen = {}
    await _listen(seen, lambda: False, timeout_s, backend)
    return sorted((hub for _, hub in seen.values()), key=lambda hub: -hub.rssi_dbm)


async def find(name: str | None, address: str | None, timeout_s: float, backend: BleBackend | None) -> BLEDevice:
    """Find the only hub in reach with this name, or with this address; without either, the only one.

    A hub that is still connected to this computer, because a program died, does not advertise, but is found too.

    Raises:
        HubNotFoundError: the hub was not found.
        AmbiguousHubError: several such hubs were found.
        BluetoothUnavailableError: Bluetooth is not available on this computer.
    """
    seen: _Seen = {}
    for device in await _still_connected(backend):
        seen[device.address] = (device, FoundHub(device.name or "", device.address, 0))
    if not _matches(seen, name, address):
        await _listen(seen, lambda: bool(_matches(seen, name, address)), timeout_s, backend)
    if address is None and len(_matches(seen, name, None)) == 1:  # check that there are no others
        await _listen(seen, lambda: len(_matches(seen, name, None)) > 1, _OTHERS_S, backend)
    matches = _matches(seen, name, address)
    if len(matches) > 1:
        raise AmbiguousHubError(f"several hubs are in reach: {_listed(matches)}; say which one by its name or address")
    if not matches:
        raise _not_found(name or address, list(seen.values()), timeout_s)
    device, hub = matches[0]
    _log.info("found the hub '%s' (%s)", hub.name, hub.address)
    return device


async def _listen(seen: _Seen, is_enough: Callable[[], bool], timeout_s: float, backend: BleBackend | None) -> None:
    """Add advertising hubs until ``is_enough()`` or the timeout."""
    from bleak import BleakScanner

    scanner = BleakScanner(service_uuids=[SERVICE_UUID], backend=backend.scanner if backend else None)
    with bleak_errors("look for hubs", BluetoothUnavailableError):
        async with scanner:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(timeout_s):
                    async for device, advertisement in scanner.advertisement_data():
                        seen[device.address] = (device, _found_hub(device, advertisement))
                        if is_enough():
                            break


async def _still_connected(backend: BleBackend | None) -> list[BLEDevice]:
    from bleak import BleakAdapter
    from bleak.exc import BleakError

    try:
        adapter = await BleakAdapter.get(backend=backend.adapter if backend else None)
        return await adapter.get_connected_devices([SERVICE_UUID])
    except (BleakError, OSError, EOFError, NotImplementedError) as error:
        _log.debug("cannot ask for hubs that are still connected: %s", error)
        return []


def _matches(seen: _Seen, name: str | None, address: str | None) -> _Found:
    return [
        (device, hub)
        for device, hub in seen.values()
        if (name is None or hub.name == name) and (address is None or hub.address.casefold() == address.casefold())
    ]


def _found_hub(device: BLEDevice, advertisement: AdvertisementData) -> FoundHub:
    pnp_id = (advertisement.service_data or {}).get(PNP_ID_UUID)
    kind = None
    if pnp_id is not None:
        with contextlib.suppress(HubProtocolError):  # another device with Pybricks' service
            kind = parse_hub_kind(pnp_id)
    return FoundHub(advertisement.local_name or device.name or "", device.address, advertisement.rssi, kind)


def _not_found(requested: str | None, others: _Found, timeout_s: float) -> HubNotFoundError:
    what = "no hub" if requested is None else f"no hub '{requested}'"
    seen = f"; others are: {_listed(others)}" if others else ""
    return HubNotFoundError(f"{what} with Pybricks was found within {timeout_s:g} s{seen}; {_REMEDY}")


def _listed(found: _Found) -> str:
    return ", ".join(f"'{hub.name}' ({hub.address})" for _, hub in found)
