"""Bluetooth Low Energy: what this computer says of it, the search for hubs, and the transport to
one."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from brickhub import errors
from brickhub.hub.transports import profile
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.event_loop import EventLoopThread
from brickhub.hub.transports.profile import PNP_ID_UUID, SERVICE_UUID, parse_hub_kind, refusal
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from brickhub.robot import HubKind

if TYPE_CHECKING:
    from bleak import BleakClient
    from bleak.backends.adapter import BaseBleakAdapter
    from bleak.backends.client import BaseBleakClient
    from bleak.backends.device import BLEDevice
    from bleak.backends.scanner import AdvertisementData, BaseBleakScanner

_log = logging.getLogger(__name__)

_OTHERS_S = 0.5
"""Time in which another hub of the same name, or any other one, would be heard."""
_SERVICE_PATIENCE_S = 0.2
"""Time in which Pybricks' background service, on this same computer, accepts a connection."""

_HUB_REMEDY = "switch the hub on and bring it near"
_NOT_FOUND_REMEDY = "switch it on, bring it near, and close other programs that are connected to it"
_RELEASE = "release the hub with `pb disconnect`, or end the service with `pb service stop`"

_BLUETOOTH_FOLDER = Path("/sys/class/bluetooth")
_RFKILL_FOLDER = Path("/sys/class/rfkill")
_SYSTEM_BUS = Path("/run/dbus/system_bus_socket")
_SERVICES = "`sudo systemctl start dbus bluetooth`"

# The keys are the names in bleak's BleakBluetoothNotAvailableReason, so that bleak need not be
# imported for them.
_REASONS = {
    "NO_BLUETOOTH": errors.Reason.NO_ADAPTER,
    "NO_BLE_CENTRAL_ROLE": errors.Reason.NO_ADAPTER,
    "POWERED_OFF": errors.Reason.SWITCHED_OFF,
    "DENIED_BY_USER": errors.Reason.DENIED,
    "DENIED_BY_SYSTEM": errors.Reason.DENIED,
    "DENIED_BY_UNKNOWN": errors.Reason.DENIED,
}
_REMEDIES = {
    "linux": (
        f"see that Bluetooth's service runs ({_SERVICES}) and that you may use it (`brickhub "
        "doctor` tells)"
    ),
    "darwin": (
        "switch Bluetooth on, and allow the terminal to use it (System Settings, Privacy & "
        "Security, Bluetooth)"
    ),
    "win32": "switch Bluetooth on (Settings, Bluetooth & devices)",
}


def bluetooth_problem() -> tuple[errors.Reason, str] | None:
    """Reason why Bluetooth is unavailable on Linux: adapter, switch or service. ``None`` if none is
    found."""
    if sys.platform != "linux":
        return None
    if not (_BLUETOOTH_FOLDER.is_dir() and any(_BLUETOOTH_FOLDER.glob("hci*"))):
        return (
            errors.Reason.NO_ADAPTER,
            "this computer has no Bluetooth adapter; plug one in, or use a cable and --hub usb",
        )
    for switch in _RFKILL_FOLDER.glob("rfkill*"):
        if _text(switch / "type") != "bluetooth":
            continue
        # A program may block the radio (soft), and so may a key or switch of the computer (hard).
        is_blocked = "1" in (_text(switch / "soft"), _text(switch / "hard"))
        if is_blocked:
            remedy = "run `rfkill unblock bluetooth`, or use the switch of this computer"
            return errors.Reason.SWITCHED_OFF, f"Bluetooth is switched off; {remedy}"
    # Bleak reaches the Bluetooth service over the system bus. In a container, for example, neither
    # runs.
    if not _SYSTEM_BUS.exists() and "DBUS_SYSTEM_BUS_ADDRESS" not in os.environ:
        return (
            errors.Reason.NO_SERVICE,
            f"the system bus (D-Bus) does not run, which Bluetooth needs; start both: {_SERVICES}",
        )
    return None


def remedy(platform: str = sys.platform) -> str:
    """Remedy for Bluetooth that fails for an unknown reason."""
    return _REMEDIES.get(
        platform, "switch this computer's Bluetooth on, and allow this program to use it"
    )


@contextmanager
def bleak_errors(operation: str, default_error: type[errors.HubError]) -> Iterator[None]:
    """Translate bleak's errors during ``operation`` (e.g. ``"connect to the hub"``) into our
    errors.

    ``default_error`` is the type for errors that bleak does not specify further.
    """
    # Bleak takes a while to load, and the command line should start at once.
    from bleak.exc import (
        BleakBluetoothNotAvailableError,
        BleakDeviceNotFoundError,
        BleakError,
        BleakGATTProtocolError,
    )

    try:
        yield
    # This comes before TimeoutError, because a HubTimeoutError is both.
    except errors.HubError:
        raise
    except BleakGATTProtocolError as error:
        raise refusal(operation, int(error.code)) from error
    except BleakBluetoothNotAvailableError as error:
        raise no_bluetooth(operation, error) from error
    except BleakDeviceNotFoundError as error:
        raise errors.HubNotFoundError(
            f"could not {operation}: it is not in reach any more; {_HUB_REMEDY}"
        ) from error
    except TimeoutError as error:
        raise errors.HubTimeoutError(f"could not {operation} in time; {_HUB_REMEDY}") from error
    # Backends let the system's errors through, such as EOFError when D-Bus has ended.
    except (BleakError, OSError, EOFError) as error:
        if default_error is errors.BluetoothUnavailableError:
            raise no_bluetooth(operation, error) from error
        raise default_error(
            f"could not {operation} ({errors.message_of(error)}); {_HUB_REMEDY}"
        ) from error


def no_bluetooth(operation: str, error: BaseException) -> errors.BluetoothUnavailableError:
    """Error with the reason found on this computer, or else with bleak's."""
    problem = bluetooth_problem()
    if problem is not None:
        reason, why = problem
    else:
        # Some errors of bleak have a reason, from an enumeration of bleak's own.
        bleak_reason = getattr(error, "reason", None)
        name = getattr(bleak_reason, "name", "")
        reason = _REASONS.get(name, errors.Reason.UNKNOWN)
        why = f"{errors.message_of(error)}; {remedy()}"
    return errors.BluetoothUnavailableError(f"could not {operation}: {why}", reason)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except OSError:
        return ""


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


_FoundHubs: TypeAlias = "dict[str, tuple[BLEDevice, FoundHub]]"
"""Found hubs by address."""


def scan(timeout_s: float = 5.0, *, backend: BleBackend | None = None) -> list[FoundHub]:
    """Advertising Pybricks hubs, found within ``timeout_s``, the strongest signal first. Raises
    BluetoothUnavailableError if Bluetooth is not available on this computer."""
    found: _FoundHubs = {}
    with contextlib.closing(EventLoopThread("bricksrl-scan")) as loop:
        loop.run(
            _listen(
                found,
                lambda: False,
                timeout_s,
                backend,
            ),
            timeout_s + 10.0,
            "look for hubs",
        )
    return sorted((hub for _, hub in found.values()), key=lambda hub: -hub.rssi_dbm)


async def find(
    name: str | None,
    address: str | None,
    timeout_s: float,
    backend: BleBackend | None,
) -> BLEDevice:
    """Find the only hub in reach with this name, or with this address; without either, the only
    one.

    A hub that is still connected to this computer, because a program died, does not advertise, but
    is found too.

    Raises:
        HubNotFoundError: the hub was not found.
        AmbiguousHubError: several such hubs were found.
        HubTakenError: Pybricks' own service keeps the link to it.
        BluetoothUnavailableError: Bluetooth is not available on this computer.
    """
    found: _FoundHubs = {}
    for device in await _still_connected(backend):
        found[device.address] = (device, FoundHub(device.name or "", device.address, 0))
    connected = _matches(found, name, address)
    # The service keeps the link even after its programs have ended, so it has to give up the link
    # first.
    if connected and service_is_running():
        what = f"{_listed(connected)} is connected to Pybricks' own background service"
        raise errors.HubTakenError(f"the hub {what}; {_RELEASE}")
    if not connected:
        await _listen(
            found,
            lambda: bool(_matches(found, name, address)),
            timeout_s,
            backend,
        )
    # In a classroom, the first hub that is heard may be somebody else's. Only an address is unique.
    if address is None and len(_matches(found, name, None)) == 1:
        await _listen(
            found,
            lambda: len(_matches(found, name, None)) > 1,
            _OTHERS_S,
            backend,
        )
    matches = _matches(found, name, address)
    if len(matches) > 1:
        raise errors.AmbiguousHubError(
            f"several hubs are in reach: {_listed(matches)}; say which one by its name or address"
        )
    if not matches:
        what = "no hub" if name is None and address is None else f"no hub '{name or address}'"
        others = f"; others are: {_listed(found.values())}" if found else ""
        remedy = _NOT_FOUND_REMEDY
        # Not every system tells which devices are connected, so a hub that the service holds may
        # look absent.
        if service_is_running():
            remedy = f"Pybricks' own background service runs, and may have it: {_RELEASE}"
        raise errors.HubNotFoundError(
            f"{what} with Pybricks was found within {timeout_s:g} s{others}; {remedy}"
        )
    device, hub = matches[0]
    _log.info("found the hub '%s' (%s)", hub.name, hub.address)
    return device


async def _listen(
    found: _FoundHubs,
    is_enough: Callable[[], bool],
    timeout_s: float,
    backend: BleBackend | None,
) -> None:
    """Add advertising hubs until ``is_enough()`` or the timeout."""
    from bleak import BleakScanner

    scanner = BleakScanner(
        service_uuids=[SERVICE_UUID], backend=backend.scanner if backend else None
    )
    with bleak_errors("look for hubs", errors.BluetoothUnavailableError):
        async with scanner:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(timeout_s):
                    async for device, advertisement in scanner.advertisement_data():
                        found[device.address] = (device, _found_hub(device, advertisement))
                        if is_enough():
                            break


async def _still_connected(backend: BleBackend | None) -> list[BLEDevice]:
    from bleak import BleakAdapter
    from bleak.exc import BleakError

    try:
        adapter = await BleakAdapter.get(backend=backend.adapter if backend else None)
        return await adapter.get_connected_devices([SERVICE_UUID])
    # Not every backend can tell this, and then a hub is found only while it advertises.
    except (BleakError, OSError, EOFError, NotImplementedError) as error:
        _log.debug("cannot ask for hubs that are still connected: %s", error)
        return []


def _matches(
    found: _FoundHubs,
    name: str | None,
    address: str | None,
) -> list[tuple[BLEDevice, FoundHub]]:
    matches = []
    for device, hub in found.values():
        has_name = name is None or hub.name == name
        has_address = address is None or hub.address.casefold() == address.casefold()
        if has_name and has_address:
            matches.append((device, hub))
    return matches


def _found_hub(device: BLEDevice, advertisement: AdvertisementData) -> FoundHub:
    # The system may remember a name from before the hub was renamed, so the advertised one goes
    # first.
    name = advertisement.local_name or device.name or ""
    service_data = advertisement.service_data or {}
    kind = None
    # A device may say nothing, or be another one that offers Pybricks' service.
    with contextlib.suppress(errors.HubProtocolError):
        kind = parse_hub_kind(service_data.get(PNP_ID_UUID, b""), name)
    return FoundHub(
        name,
        device.address,
        advertisement.rssi,
        kind,
    )


def _listed(found: Iterable[tuple[BLEDevice, FoundHub]]) -> str:
    return ", ".join(f"'{hub.name}' ({hub.address})" for _, hub in found)


class BleTransport(ProfileTransport):
    """A :class:`~brickhub.hub.transport.Transport` over Bluetooth.

    Args:
        name, address: name or address of the hub; with neither it must be the only one in reach.
        backend: bleak backend; ``None`` for bleak's default.
        options: see :class:`ProfileTransport`.
    """

    def __init__(
        self,
        name: str | None = None,
        address: str | None = None,
        *,
        backend: BleBackend | None = None,
        **options: Any,
    ) -> None:
        super().__init__(**options)
        self._name = name
        self._address = address
        self._backend = backend

    async def _find(self, timeout_s: float) -> Port:
        # After a loss, only the same hub will do, although another one may have its name.
        if self._first_hub is None:
            device = await find(
                self._name,
                self._address,
                timeout_s,
                self._backend,
            )
        else:
            device = await find(
                None,
                self._first_hub.address,
                timeout_s,
                self._backend,
            )
        return BlePort(device, self._backend.client if self._backend else None, timeout_s)


class BlePort:
    """Pybricks Profile over a GATT connection, with bleak."""

    silence = "switch it off and on, and bring it near"

    def __init__(
        self,
        device: BLEDevice,
        client_backend: type[BaseBleakClient] | None,
        timeout_s: float,
    ) -> None:
        from bleak import BleakClient

        def on_disconnect(_: BleakClient) -> None:
            self._on_loss("it is out of reach, or was switched off")

        self.name = device.name or ""
        self.address = device.address
        self._client = BleakClient(
            device,
            on_disconnect,
            timeout=timeout_s,
            backend=client_backend,
        )

    async def open(
        self,
        on_event: Callable[[bytes], None],
        on_loss: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._on_loss = on_loss
        with self._errors():
            await self._client.connect()

    async def read(self, characteristic: str) -> bytes:
        with self._errors():
            return bytes(await self._client.read_gatt_char(characteristic))

    async def subscribe(self) -> None:
        with self._errors():
            await self._client.start_notify(
                profile.COMMAND_EVENT_UUID, lambda _, data: self._on_event(bytes(data))
            )

    async def write(
        self,
        command: bytes,
        operation: str,
    ) -> None:
        # Writes ask for a response: since firmware 3.2 a hub may drop one without a response, and
        # say nothing.
        with bleak_errors(operation, errors.HubDisconnectedError):
            await self._client.write_gatt_char(profile.COMMAND_EVENT_UUID, command, response=True)

    async def close(self) -> None:
        await self._client.disconnect()

    def _errors(self) -> AbstractContextManager[None]:
        return bleak_errors(f"connect to the hub '{self.name}'", errors.HubDisconnectedError)


def socket_path() -> Path:
    """The socket of Pybricks' background service (``pb_core/paths.py`` of pybricks-core 1.0)."""
    # The search has the service's own order, so that it ends at the same socket: the folder that
    # the user sets, the session's folder on Linux, then any other one.
    given_folder = os.environ.get("PB_RUNTIME_DIR")
    session_folder = os.environ.get("XDG_RUNTIME_DIR") if sys.platform == "linux" else None
    if given_folder:
        folder = Path(given_folder)
    elif session_folder:
        folder = Path(session_folder) / "pybricks"
    else:
        folder = Path(tempfile.gettempdir()) / f"pybricks-{os.getuid()}"
    return folder / "pb-service.sock"


def service_is_running() -> bool:
    """Whether Pybricks' background service (``pybricks-service``, 2026) of this user answers, which
    keeps the link to a hub after its programs have ended; never on Windows, where it has a named
    pipe."""
    if sys.platform == "win32":
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(_SERVICE_PATIENCE_S)
        # Only a connection tells that the service runs, because the socket's file stays when a
        # service is killed.
        try:
            probe.connect(str(socket_path()))
        except OSError:
            return False
    return True
