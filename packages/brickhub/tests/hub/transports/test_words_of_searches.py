"""What a search for hubs says, over Bluetooth and USB, and how errors of libraries are ours."""

from __future__ import annotations

import asyncio
import errno
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bleak.exc import (
    BleakDeviceNotFoundError,
    BleakError,
    BleakGATTProtocolError,
    BleakGATTProtocolErrorCode,
)

from brickhub import errors
from brickhub.errors import DescriptionError, Reason, UnknownNameError
from brickhub.hub.transports import ble, usb
from brickhub.hub.transports.address import HubAddress, parse_hub
from brickhub.hub.transports.ble import BleTransport, FoundHub, bleak_errors
from brickhub.hub.transports.usb import UsbHub, UsbTransport
from brickhub.robot import HubKind

ROVER = FoundHub("Rover", "C0:01:02:03:04:05", -61, HubKind.PRIME)
CRANE = FoundHub("Crane", "C0:01:02:03:04:06", -40, HubKind.CITY)
TWIN = FoundHub("Rover", "C0:01:02:03:04:07", -80, None)


class Room:
    """Hubs that are heard, one with each search, and those that are connected."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.heard: list[list[FoundHub]] = []
        self.connected: list[FoundHub] = []
        self.searches_s: list[float] = []
        self.has_service = False
        monkeypatch.setattr(ble, "_listen", self._listen)
        monkeypatch.setattr(ble, "_still_connected", self._still_connected)
        monkeypatch.setattr(ble, "service_is_running", lambda: self.has_service)

    async def _listen(
        self, found: Any, is_enough: Callable[[], bool], timeout_s: float, backend: object
    ) -> None:
        self.searches_s.append(timeout_s)
        for hub in self.heard.pop(0) if self.heard else ():
            found[hub.address] = (self._device(hub), hub)

    async def _still_connected(self, backend: object) -> list[Any]:
        return [self._device(hub) for hub in self.connected]

    def _device(self, hub: FoundHub) -> Any:
        return SimpleNamespace(address=hub.address, name=hub.name)

    def find(self, name: str | None = None, address: str | None = None) -> str:
        """Address of the hub that is found within 20 s."""
        device = asyncio.run(ble.find(name, address, 20.0, None))
        return str(device.address)


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> Room:
    return Room(monkeypatch)


def test_only_hub_is_found_and_another_one_waited_for(room: Room) -> None:
    room.heard = [[ROVER]]
    assert room.find() == ROVER.address
    assert room.searches_s == [20.0, 0.5]


def test_address_is_that_of_one_hub(room: Room) -> None:
    room.heard = [[ROVER, TWIN]]
    assert room.find(address=TWIN.address.lower()) == TWIN.address
    assert room.searches_s == [20.0]


def test_hub_of_a_name_among_others(room: Room) -> None:
    room.heard = [[CRANE, ROVER]]
    assert room.find("Rover") == ROVER.address


def test_several_hubs_of_a_name(room: Room) -> None:
    room.heard = [[ROVER], [TWIN]]
    several = (
        r"several hubs are in reach: 'Rover' \(C0:01:02:03:04:05\), 'Rover' "
        r"\(C0:01:02:03:04:07\); say which one by its name or address"
    )
    with pytest.raises(errors.AmbiguousHubError, match=f"^{several}$"):
        room.find("Rover")


@pytest.mark.parametrize(
    ("name", "address", "what"),
    [
        (None, None, "no hub with"),
        ("Rover", None, "no hub 'Rover' with"),
        (None, "C0:99", "no hub 'C0:99' with"),
    ],
)
def test_hub_that_is_not_found(
    room: Room, name: str | None, address: str | None, what: str
) -> None:
    remedy = "switch it on, bring it near, and close other programs that are connected to it"
    with pytest.raises(errors.HubNotFoundError) as caught:
        room.find(name, address)
    assert str(caught.value) == f"{what} Pybricks was found within 20 s; {remedy}"
    assert room.searches_s == [20.0]


def test_others_are_named(room: Room) -> None:
    room.heard = [[CRANE]]
    with pytest.raises(errors.HubNotFoundError, match=r"within 20 s; others are: 'Crane' \(C0:01"):
        room.find("Rover")


def test_hub_that_is_still_connected_is_found_at_once(room: Room) -> None:
    room.connected = [ROVER]
    assert room.find(address=ROVER.address) == ROVER.address
    assert room.searches_s == []


def test_service_of_pybricks_keeps_the_link(room: Room) -> None:
    room.connected = [ROVER]
    room.has_service = True
    with pytest.raises(errors.HubTakenError, match=r"the hub 'Rover' \(C0:.* is connected to Pyb"):
        room.find("Rover")
    room.connected = []
    remedy = "Pybricks' own background service runs, and may have it: release the hub with `pb disc"
    with pytest.raises(errors.HubNotFoundError, match=remedy):
        room.find("Rover")


def test_strongest_signal_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    async def listen(found: Any, is_enough: Any, timeout_s: float, backend: object) -> None:
        assert not is_enough()
        for hub in (ROVER, CRANE, TWIN):
            found[hub.address] = (None, hub)

    monkeypatch.setattr(ble, "_listen", listen)
    assert ble.scan(1.0) == [CRANE, ROVER, TWIN]


def advertisement(**told: Any) -> Any:
    plain = {"local_name": None, "service_data": {}, "rssi": -50}
    return SimpleNamespace(**(plain | told))


@pytest.mark.parametrize(
    ("device_name", "told", "name", "kind"),
    [
        ("Old", {"local_name": "New"}, "New", None),
        ("Old", {}, "Old", None),
        (None, {"service_data": None}, "", None),
        (
            "x",
            {"service_data": {ble.PNP_ID_UUID: b"\x01\x97\x03\x41\x00\x00\x00"}},
            "x",
            HubKind.CITY,
        ),
        ("x", {"service_data": {ble.PNP_ID_UUID: b"\x01"}}, "x", None),
        ("Peak-1", {}, "Peak-1", HubKind.PRIME),
    ],
)
def test_advertisement_of_a_hub(
    device_name: str | None, told: dict[str, Any], name: str, kind: HubKind | None
) -> None:
    device: Any = SimpleNamespace(name=device_name, address="C0:01")
    assert ble._found_hub(device, advertisement(**told)) == FoundHub(name, "C0:01", -50, kind)


REMEDY = "switch the hub on and bring it near"
UPDATE = "update its firmware on code.pybricks.com"


@pytest.mark.parametrize(
    ("error", "kind", "said"),
    [
        (
            BleakDeviceNotFoundError("C0:01"),
            errors.HubNotFoundError,
            f"could not connect: it is not in reach any more; {REMEDY}",
        ),
        (TimeoutError(), errors.HubTimeoutError, f"could not connect in time; {REMEDY}"),
        (
            BleakError("odd"),
            errors.HubDisconnectedError,
            f"could not connect (odd); {REMEDY}",
        ),
        (EOFError(), errors.HubDisconnectedError, f"could not connect (EOFError); {REMEDY}"),
        (
            OSError("no bus"),
            errors.HubDisconnectedError,
            f"could not connect (no bus); {REMEDY}",
        ),
        (
            BleakGATTProtocolError(BleakGATTProtocolErrorCode(0x06)),
            errors.HubRefusedError,
            f"could not connect: the hub refused it (error 0x06, not supported); {UPDATE}",
        ),
        (errors.HubTimeoutError("ours"), errors.HubTimeoutError, "ours"),
    ],
)
def test_errors_of_bleak_are_ours(error: Exception, kind: type[Exception], said: str) -> None:
    with (
        pytest.raises(errors.HubError) as caught,
        bleak_errors("connect", errors.HubDisconnectedError),
    ):
        raise error
    assert type(caught.value) is kind
    assert str(caught.value) == said


def test_error_while_looking_is_that_of_bluetooth(monkeypatch: pytest.MonkeyPatch) -> None:
    problems = [(Reason.SWITCHED_OFF, "Bluetooth is switched off; switch it on"), None]
    monkeypatch.setattr(ble, "bluetooth_problem", lambda: problems.pop(0))
    monkeypatch.setattr(ble, "remedy", lambda: "look after it")
    told = []
    for _ in range(2):
        with (
            pytest.raises(errors.BluetoothUnavailableError) as caught,
            bleak_errors("look", errors.BluetoothUnavailableError),
        ):
            raise BleakError("odd")
        told.append((str(caught.value), caught.value.reason))
    assert told == [
        ("could not look: Bluetooth is switched off; switch it on", Reason.SWITCHED_OFF),
        ("could not look: odd; look after it", Reason.UNKNOWN),
    ]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("NO_BLUETOOTH", Reason.NO_ADAPTER),
        ("NO_BLE_CENTRAL_ROLE", Reason.NO_ADAPTER),
        ("POWERED_OFF", Reason.SWITCHED_OFF),
        ("DENIED_BY_USER", Reason.DENIED),
        ("DENIED_BY_SYSTEM", Reason.DENIED),
        ("DENIED_BY_UNKNOWN", Reason.DENIED),
        ("NEW", Reason.UNKNOWN),
    ],
)
def test_reasons_of_bleak(monkeypatch: pytest.MonkeyPatch, name: str, reason: Reason) -> None:
    monkeypatch.setattr(ble, "bluetooth_problem", lambda: None)
    error = BleakError("odd")
    error.reason = SimpleNamespace(name=name)  # type: ignore[attr-defined]
    assert ble.no_bluetooth("look", error).reason is reason


@pytest.mark.skipif(sys.platform == "win32", reason="sockets of POSIX")
def test_socket_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("PB_RUNTIME_DIR", "/given")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/session")
    assert ble.socket_path() == Path("/given/pb-service.sock")
    monkeypatch.delenv("PB_RUNTIME_DIR")
    assert ble.socket_path() == Path("/session/pybricks/pb-service.sock")
    monkeypatch.setattr("sys.platform", "darwin")
    other = Path(tempfile.gettempdir()) / f"pybricks-{os.getuid()}" / "pb-service.sock"
    assert ble.socket_path() == other
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert ble.socket_path() == other


def usb_find(hubs: list[UsbHub], port: str | None = None, first: str | None = None) -> UsbHub:
    """The hub that is found on a cable; ``first``: address of the one before."""
    transport = UsbTransport(port, find_hubs=lambda: hubs)
    if first is not None:
        transport._first_hub = SimpleNamespace(address=first)  # type: ignore[assignment]
    found: Any = asyncio.run(transport._find(1.0))
    return UsbHub(found.name, found.address, 0)


PRIME = UsbHub("/dev/ttyACM0", "39AF", 0x0009)
BRICK = UsbHub("COM7", "0016", 0x0005)


@pytest.mark.parametrize(
    ("hubs", "port", "first", "found"),
    [
        ([PRIME], None, None, ("/dev/ttyACM0", "39AF")),
        ([PRIME, BRICK], "com7", None, ("COM7", "0016")),
        # A port that was named is tried, whatever is there.
        ([PRIME], "COM9", None, ("COM9", "COM9")),
        ([], "COM9", "COM9", ("COM9", "COM9")),
        # One that was plugged in again may be elsewhere.
        ([PRIME, BRICK], "COM9", "39AF", ("/dev/ttyACM0", "39AF")),
    ],
)
def test_hub_on_a_cable(
    hubs: list[UsbHub], port: str | None, first: str | None, found: tuple[str, str]
) -> None:
    hub = usb_find(hubs, port, first)
    assert (hub.device, hub.address) == found


@pytest.mark.parametrize(
    ("hubs", "port", "first", "error", "says"),
    [
        ([], None, None, errors.HubNotFoundError, "no hub with Pybricks 4.1 is on USB; plug it in"),
        ([PRIME], "COM9", "77", errors.HubNotFoundError, "no hub with Pybricks 4.1 is on USB"),
        (
            [PRIME, BRICK],
            None,
            None,
            errors.AmbiguousHubError,
            (
                "several hubs are on USB: /dev/ttyACM0, COM7; say which one by its port, such as "
                "usb:/dev/ttyACM0"
            ),
        ),
    ],
)
def test_hub_that_is_on_no_cable(
    hubs: list[UsbHub],
    port: str | None,
    first: str | None,
    error: type[errors.HubError],
    says: str,
) -> None:
    with pytest.raises(error, match=says):
        usb_find(hubs, port, first)


def test_hubs_are_known_by_their_usb_ids(monkeypatch: pytest.MonkeyPatch) -> None:
    def port(vid: int, pid: int, serial_number: str | None = "1") -> Any:
        return SimpleNamespace(device=f"COM{pid}", vid=vid, pid=pid, serial_number=serial_number)

    ports = [port(0x0694, pid) for pid in (0x0009, 0x0010, 0x000D, 0x0005, 0x0002, 0x0008)]
    ports += [port(0x0693, 0x0009), port(0x0694, 0x0009, None)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    found = usb.list_usb_hubs()
    # SPIKE Prime, Robot Inventor, SPIKE Essential, EV3, NXT, as LEGO numbers them.
    assert [hub.product for hub in found] == [0x0009, 0x0010, 0x000D, 0x0005, 0x0002, 0x0009]
    prime, essential = HubKind.PRIME, HubKind.ESSENTIAL
    kinds = [prime, prime, essential, HubKind.EV3, None, prime]
    assert [hub.kind for hub in found] == kinds
    assert [hub.address for hub in found] == ["1"] * 5 + ["COM9"]
    assert UsbHub("COM1", "x").kind is None


@pytest.mark.parametrize(
    ("number", "kind", "remedy"),
    [
        (errno.EACCES, errors.UsbUnavailableError, "allow it: on Linux, join the group dialout"),
        (errno.EPERM, errors.UsbUnavailableError, "allow it: on Linux, join the group dialout"),
        (errno.ENOENT, errors.HubDisconnectedError, "plug the hub in, switch it on, and close"),
    ],
)
def test_errors_of_serial_ports(number: int, kind: type[errors.HubError], remedy: str) -> None:
    with pytest.raises(errors.HubError) as caught, usb._serial_errors("open it"):
        raise OSError(number, "[Errno 2] twice")
    assert type(caught.value) is kind
    assert str(caught.value).startswith(f"could not open it ({os.strerror(number)}); {remedy}")
    with pytest.raises(errors.HubError, match=r"^could not open it \(odd\); plug") as other:
        _raise_odd()
    assert type(other.value) is errors.HubDisconnectedError


def _raise_odd() -> None:
    with usb._serial_errors("open it"):
        raise OSError("odd")


@pytest.mark.parametrize(
    ("text", "medium", "which"),
    [
        ("virtual", "virtual", None),
        ("ble", "ble", None),
        ("ble:Rover", "ble", "Rover"),
        ("ble:C0:01:02:03:04:05", "ble", "C0:01:02:03:04:05"),
        ("usb:COM3", "usb", "COM3"),
    ],
)
def test_addresses(text: str, medium: str, which: str | None) -> None:
    address = parse_hub(text)
    assert address == HubAddress(medium, which)
    assert address.is_virtual is (medium == "virtual")


@pytest.mark.parametrize(
    ("text", "hinted"),
    [
        ("virtual:x", " (did you mean 'virtual'?)"),
        ("bel", " (did you mean 'ble'?)"),
        ("ble:", ""),
        ("", ""),
    ],
)
def test_address_that_is_none(text: str, hinted: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        parse_hub(text)
    said = str(caught.value)
    assert said.startswith(f"there is no hub '{text}'")
    assert hinted in said
    assert said.endswith("'ble:NAME', 'ble:ADDRESS' or 'usb:PORT' where there are several")


@pytest.mark.parametrize(
    ("which", "name", "address"),
    [
        (None, None, None),
        ("Rover", "Rover", None),
        ("c0:01:02:03:04:05", None, "c0:01:02:03:04:05"),
        ("C0:01:02:03:04", "C0:01:02:03:04", None),
        (
            "12345678-ABCD-abcd-1234-123456789ABC",
            None,
            "12345678-ABCD-abcd-1234-123456789ABC",
        ),
    ],
)
def test_bluetooth_by_name_or_address(
    which: str | None, name: str | None, address: str | None
) -> None:
    transport = HubAddress("ble", which).transport()
    assert isinstance(transport, BleTransport)
    assert (transport._name, transport._address) == (name, address)


def test_hub_that_is_not_reached_so() -> None:
    with pytest.raises(DescriptionError, match="on an EV3 Brick has no Bluetooth to a computer"):
        HubAddress("ble").transport(HubKind.EV3)
    assert isinstance(HubAddress("usb").transport(HubKind.EV3), UsbTransport)
    assert isinstance(HubAddress("ble").transport(HubKind.CITY), BleTransport)
    with pytest.raises(UnknownNameError, match="a virtual hub has no transport of its own; choose"):
        HubAddress("virtual").transport()


def test_a_plugged_in_hub_is_there_soon() -> None:
    transport = UsbTransport(find_hubs=list, timeout_s=20.0)
    assert transport._search_s() == 6.0
    assert UsbTransport(find_hubs=list, timeout_s=2.0)._search_s() == 2.0
    transport._first_hub = SimpleNamespace(address="39AF")  # type: ignore[assignment]
    assert transport._search_s() == 20.0


class PlayedClient:
    """Bleak's client; notes how it is made and called."""

    def __init__(self, device: Any, on_disconnect: Callable[[Any], None], **options: Any) -> None:
        self.device = device
        self.lose = on_disconnect
        self.options = options
        self.calls: list[tuple[Any, ...]] = []

    async def connect(self) -> None:
        self.calls.append(("connect",))

    async def disconnect(self) -> None:
        self.calls.append(("disconnect",))

    async def read_gatt_char(self, characteristic: str) -> bytearray:
        self.calls.append(("read", characteristic))
        return bytearray(b"value")

    async def start_notify(self, characteristic: str, heard: Callable[..., None]) -> None:
        self.calls.append(("notify", characteristic))
        heard(None, bytearray(b"\x01out"))

    async def write_gatt_char(self, characteristic: str, data: bytes, response: bool) -> None:
        self.calls.append(("write", characteristic, data, response))
        if data == b"refuse":
            raise BleakError("odd")


def test_port_over_bluetooth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bleak.BleakClient", PlayedClient)
    device: Any = SimpleNamespace(name=None, address="C0:01")
    port = ble.BlePort(device, None, 7.5)
    client: Any = port._client
    assert (client.device, client.options) == (device, {"timeout": 7.5, "backend": None})
    assert (port.name, port.address) == ("", "C0:01")
    events: list[bytes] = []
    losses: list[str] = []

    async def run() -> None:
        await port.open(events.append, losses.append)
        assert await port.read("a") == b"value"
        await port.subscribe()
        await port.write(b"\x00", "stop")
        with pytest.raises(errors.HubDisconnectedError, match=r"^could not stop \(odd\); switch"):
            await port.write(b"refuse", "stop")
        client.lose(client)
        await port.close()

    asyncio.run(run())
    command = "c5f50002-8280-46da-89f4-6d8051e4aeef"
    assert client.calls == [
        ("connect",),
        ("read", "a"),
        ("notify", command),
        # Writes without a response may be lost silently.
        ("write", command, b"\x00", True),
        ("write", command, b"refuse", True),
        ("disconnect",),
    ]
    assert events == [b"\x01out"]
    assert losses == ["it is out of reach, or was switched off"]


def test_port_reads_what_is_there_and_waits_for_a_byte_where_nothing_is() -> None:
    sizes: list[int] = []
    waiting = [0, 7, 1]

    class Serial:
        @property
        def in_waiting(self) -> int:
            return waiting.pop(0) if waiting else 0

        def read(self, size: int) -> bytes:
            sizes.append(size)
            if not waiting:
                raise OSError("gone")
            return b"x" * size

    port = usb.UsbPort(PRIME, lambda device: Serial())  # type: ignore[arg-type,return-value]
    taken: list[Any] = []
    port._loop = SimpleNamespace(  # type: ignore[assignment]
        call_soon_threadsafe=lambda call, *arguments: taken.append(arguments)
    )
    port._read_loop(Serial())  # type: ignore[arg-type]
    assert sizes == [1, 7, 1]
    # The end of reading is the loss of the link.
    lost = "its cable was pulled, or it was switched off"
    assert taken == [(b"x",), (b"x" * 7,), (lost,)]
