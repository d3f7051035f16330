"""Simulated Bluetooth: a Bumble link with connection events, and a bleak backend for it.

The radio has its own thread, as an operating system's Bluetooth.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any, Self, TypeVar

from bleak.backends.adapter import BaseBleakAdapter
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.client import BaseBleakClient
from bleak.backends.device import BLEDevice
from bleak.backends.scanner import AdvertisementData, BaseBleakScanner
from bleak.backends.service import BleakGATTService, BleakGATTServiceCollection
from bleak.exc import BleakError, BleakGATTProtocolError
from bumble import ll
from bumble.controller import Controller
from bumble.core import AdvertisingData, BaseBumbleError, PhysicalTransport, ProtocolError
from bumble.device import Device, Peer
from bumble.hci import HCI_CONNECTION_TIMEOUT_ERROR, Address
from bumble.host import Host
from bumble.link import LocalLink
from bumble.transport.common import StreamPacketSink, StreamPacketSource

from brickhub.hub.transports.ble import BleBackend

T = TypeVar("T")

ATT_NOTIFICATION = 0x1B
ATT_WRITE_REQUEST = 0x12
ATT_WRITE_RESPONSE = 0x13
SUPERVISION_TIMEOUT_S = 0.42
_ATT_OPCODE = 4  # its place in an L2CAP packet
_CENTRAL, _OTHER_CENTRAL = "F0:F1:F2:F3:F4:F5", "F0:F1:F2:F3:F4:F6"
_PROPERTIES = ("broadcast", "read", "write-without-response", "write", "notify", "indicate")

Fault = Callable[[int, bytes], int | bytes]
"""For the opcode and bytes of an attribute packet: number of deliveries (0 lost, 2 duplicated), or
replacement bytes."""


class IntervalLink(LocalLink):  # type: ignore[misc]
    """A link that delivers at connection events; an interval of 0 has no delay."""

    def __init__(self) -> None:
        super().__init__()
        self.interval_ms = 0.0
        self.events = 0
        self.fault: Fault = lambda opcode, data: 1
        self.in_range = True
        self.is_held = False
        self.deaf: set[Controller] = set()
        self._queue: list[tuple[Controller, Address, PhysicalTransport, bytes]] = []
        self._events: asyncio.Task[None] | None = None

    def send_advertising_pdu(self, sender: Controller, packet: Any) -> None:
        """Add scan responses to advertisements, as Bumble's controllers send none."""
        if isinstance(packet, ll.AdvInd):
            packet = dataclasses.replace(
                packet, data=packet.data + sender.le_legacy_advertiser.scan_response_data
            )
        elif isinstance(packet, ll.AdvExtInd):
            for part in sender.advertising_sets.values():
                if part.address == packet.advertiser_address:
                    packet = dataclasses.replace(
                        packet, data=bytes(packet.data) + bytes(part.scan_response_data)
                    )
        if self.in_range:
            super().send_advertising_pdu(sender, packet)

    def send_acl_data(
        self, sender: Controller, destination: Address, transport: PhysicalTransport, data: bytes
    ) -> None:
        arrives = self.fault(data[_ATT_OPCODE], data[_ATT_OPCODE:])
        if isinstance(arrives, bytes):
            data, arrives = data[:_ATT_OPCODE] + arrives, 1
        for _ in range(arrives):
            self._queue.append((sender, destination, transport, data))
        if self.is_held:
            return
        if not self.interval_ms:
            self._deliver()
        elif self._events is None:
            self._events = asyncio.get_running_loop().create_task(self._hold_events())

    def waits(self, opcode: int, command: int | None = None) -> bool:
        """Whether a packet waits for the next connection event."""
        packets = [packet[3][_ATT_OPCODE:] for packet in list(self._queue)]
        return any(packet[0] == opcode and command in (None, *packet[3:4]) for packet in packets)

    def connection_event(self) -> None:
        """Let one connection event happen while events are held."""
        self._deliver()

    def _deliver(self) -> None:
        queue, self._queue = self._queue, []
        if self.in_range:
            for packet in queue:
                if (
                    packet[0] not in self.deaf
                    and self.find_le_controller(packet[1]) not in self.deaf
                ):
                    super().send_acl_data(*packet)

    async def _hold_events(self) -> None:
        loop = asyncio.get_running_loop()
        next_s = loop.time()
        while self.interval_ms:
            next_s += self.interval_ms / 1000
            await asyncio.sleep(max(0.0, next_s - loop.time()))
            if not self.is_held:
                self.events += 1
                self._deliver()
        self._events = None


class Bluetooth:
    """A computer's Bluetooth with its thread.

    Args:
        port: of this computer, where another process's radio lends a controller.
    """

    def __init__(self, port: int) -> None:
        self._start_thread()
        self.central = self.run(self._power_on(port))

    def _start_thread(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="radio", daemon=True)
        self._thread.start()

    async def _power_on(self, port: int) -> Device:
        transport, source = await self._loop.create_connection(
            StreamPacketSource, "127.0.0.1", port
        )
        host = Host(controller_source=source, controller_sink=StreamPacketSink(transport))
        central = Device("another computer", address=Address(_OTHER_CENTRAL), host=host)
        await central.power_on()
        return central

    def run(self, coroutine: Coroutine[Any, Any, T], timeout_s: float = 10.0) -> T:
        return self.submit(coroutine).result(timeout_s)

    def submit(self, coroutine: Coroutine[Any, Any, T]) -> Future[T]:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    def call(self, function: Callable[[], object]) -> None:
        """Run a function in the radio's thread and wait."""

        async def run() -> None:
            function()

        self.run(run())

    def backend(self) -> BleBackend:
        """A bleak backend for this radio."""
        radio = self

        class Scanner(RadioScanner):
            RADIO = radio

        class Client(RadioClient):
            RADIO = radio

        class Adapter(RadioAdapter):
            RADIO = radio

        return BleBackend(Scanner, Client, Adapter)

    def close(self) -> None:
        self.run(self._cancel_all())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        self._loop.close()

    async def _cancel_all(self) -> None:
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


class Radio(Bluetooth):
    """The air, and this computer's Bluetooth."""

    def __init__(self) -> None:
        self._start_thread()
        self.link = IntervalLink()
        self._lent: list[asyncio.Server] = []
        self.central = self.run(self._power_on())

    def device(self, name: str, address: str) -> Device:
        """A new Bluetooth device; call in the radio's thread."""
        host = Host()
        host.controller = Controller(name, link=self.link)
        return Device(name, address=Address(address), host=host)

    def lend(self, *, says_good_bye: bool) -> int:
        """Lend a controller to the process that connects to the returned port.

        If the process dies, its link ends at once with ``says_good_bye``, as a running system does;
        otherwise the hub notices after the supervision timeout, as if the computer had died.
        """

        async def serve() -> int:
            server = await self._loop.create_server(
                lambda: LentController(self, says_good_bye), "127.0.0.1", 0
            )
            self._lent.append(server)
            return int(server.sockets[0].getsockname()[1])

        return self.run(serve())

    def disconnect(self) -> None:
        """Break the link; both sides know at once."""
        for connection in list(self.central.connections.values()):
            self.submit(connection.disconnect())

    def leave(self) -> None:
        """Move the hub out of reach; both sides know after the supervision timeout."""

        def lose() -> None:
            for controller in list(self.link.controllers):
                for connection in list(controller.le_connections.values()):
                    controller.on_le_disconnected(connection, HCI_CONNECTION_TIMEOUT_ERROR)

        def cut() -> None:
            self.link.in_range = False
            self._loop.call_later(SUPERVISION_TIMEOUT_S, lose)

        self.call(cut)

    def come_back(self) -> None:
        self.call(lambda: setattr(self.link, "in_range", True))

    def close(self) -> None:
        for server in self._lent:
            self.call(server.close)
        super().close()

    async def _power_on(self) -> Device:  # type: ignore[override]
        central = self.device("central", _CENTRAL)
        await central.power_on()
        return central


class LentController(StreamPacketSource):  # type: ignore[misc]
    """A controller in this process with a host in another one."""

    def __init__(self, radio: Radio, says_good_bye: bool) -> None:
        super().__init__()
        self._radio, self._says_good_bye = radio, says_good_bye

    def connection_made(self, transport: Any) -> None:
        sink = StreamPacketSink(transport)
        self._controller = Controller(
            "lent", host_source=self, host_sink=sink, link=self._radio.link
        )

    def connection_lost(self, error: Exception | None) -> None:
        """The process is gone."""
        self._controller.host = None
        if self._says_good_bye:
            self._end()
        else:
            self._radio.link.deaf.add(self._controller)
            asyncio.get_running_loop().call_later(SUPERVISION_TIMEOUT_S, self._end)

    def _end(self) -> None:
        for connection in list(self._controller.le_connections.values()):
            connection.send_ll_control_pdu(ll.TerminateInd(HCI_CONNECTION_TIMEOUT_ERROR))
        self._radio.link.remove_controller(self._controller)


class RadioScanner(BaseBleakScanner):
    RADIO: Bluetooth

    def __init__(
        self, detection_callback: Any, service_uuids: list[str] | None, scanning_mode: str, **_: Any
    ) -> None:
        super().__init__(detection_callback, service_uuids)

    async def start(self) -> None:
        self.seen_devices = {}
        self._host = asyncio.get_running_loop()
        await _in_radio(self.RADIO, self._start())

    async def stop(self) -> None:
        await _in_radio(self.RADIO, self._stop())

    async def _start(self) -> None:
        self.RADIO.central.on("advertisement", self._on_advertisement)
        await self.RADIO.central.start_scanning(active=True, filter_duplicates=False)

    async def _stop(self) -> None:
        self.RADIO.central.remove_listener("advertisement", self._on_advertisement)
        await self.RADIO.central.stop_scanning()

    def _on_advertisement(self, advertisement: Any) -> None:
        data = advertisement.data
        uuids = [
            _uuid_text(uuid)
            for kind in (
                AdvertisingData.INCOMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS,
                AdvertisingData.COMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS,
            )
            for uuid in data.get(kind) or []
        ]
        name = data.get(AdvertisingData.COMPLETE_LOCAL_NAME)
        service_data = {
            _uuid_text(uuid): bytes(value)
            for uuid, value in data.get_all(AdvertisingData.SERVICE_DATA_16_BIT_UUID)
        }
        found = AdvertisementData(name, {}, service_data, uuids, None, advertisement.rssi, ())
        self._host.call_soon_threadsafe(self._report, advertisement.address, found)

    def _report(self, address: Address, found: AdvertisementData) -> None:
        text = _address_text(address)
        device = self.create_or_update_device(text, text, found.local_name, address, found)
        if self.is_allowed_uuid(found.service_uuids):
            self.call_detection_callbacks(device, found)


class RadioAdapter(BaseBleakAdapter):
    RADIO: Bluetooth

    @classmethod
    async def get(cls, **_: Any) -> Self:
        return cls()

    async def get_connected_devices(self, service_uuids: frozenset[str]) -> list[BLEDevice]:
        peers = [connection.peer_address for connection in self.RADIO.central.connections.values()]
        return [BLEDevice(_address_text(peer), None, peer) for peer in peers]


class RadioClient(BaseBleakClient):
    RADIO: Bluetooth

    def __init__(
        self, device: BLEDevice, *, disconnected_callback: Any, timeout: float, **_: Any
    ) -> None:
        super().__init__(device, disconnected_callback=disconnected_callback, timeout=timeout)
        self._device = device
        self._connection: Any = None
        self._host = asyncio.get_running_loop()

    @property
    def name(self) -> str:
        return self._device.name or self.address

    @property
    def mtu_size(self) -> int:
        return int(self._connection.att_mtu)

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    async def connect(self, pair: bool, **_: Any) -> None:
        self.services = await _in_radio(self.RADIO, self._connect())

    async def disconnect(self) -> None:
        await _in_radio(self.RADIO, self._disconnect())

    async def pair(self, *_: Any, **__: Any) -> None:
        raise NotImplementedError

    async def unpair(self) -> None:
        raise NotImplementedError

    async def read_gatt_char(self, characteristic: BleakGATTCharacteristic, **_: Any) -> bytearray:
        return bytearray(await _in_radio(self.RADIO, characteristic.obj.read_value()))

    async def read_gatt_descriptor(self, descriptor: Any, **_: Any) -> bytearray:
        raise NotImplementedError

    async def write_gatt_char(
        self, characteristic: BleakGATTCharacteristic, data: Any, response: bool
    ) -> None:
        await _in_radio(
            self.RADIO, characteristic.obj.write_value(bytes(data), with_response=response)
        )

    async def write_gatt_descriptor(self, descriptor: Any, data: Any) -> None:
        raise NotImplementedError

    async def start_notify(
        self, characteristic: BleakGATTCharacteristic, callback: Any, **_: Any
    ) -> None:
        def notified(value: bytes) -> None:
            self._host.call_soon_threadsafe(callback, bytearray(value))

        await _in_radio(self.RADIO, characteristic.obj.discover_descriptors())
        await _in_radio(self.RADIO, characteristic.obj.subscribe(notified))

    async def stop_notify(self, characteristic: BleakGATTCharacteristic) -> None:
        await _in_radio(self.RADIO, characteristic.obj.unsubscribe())

    async def _connect(self) -> BleakGATTServiceCollection:
        central, peer = self.RADIO.central, self._device.details
        connection = next(
            (link for link in central.connections.values() if link.peer_address == peer), None
        )
        if connection is None:
            connection = await central.connect(peer, timeout=self._timeout)
        connection.on("disconnection", self._on_disconnection)
        self._connection = connection
        profile = Peer(connection)
        await profile.request_mtu(517)
        await profile.discover_services()
        found = BleakGATTServiceCollection()
        for service in profile.services:
            ours = BleakGATTService(service, service.handle, _uuid_text(service.uuid))
            found.add_service(ours)
            await service.discover_characteristics()
            for char in service.characteristics:
                properties: Any = [
                    name for bit, name in enumerate(_PROPERTIES) if int(char.properties) & 1 << bit
                ]
                found.add_characteristic(
                    BleakGATTCharacteristic(
                        char,
                        char.handle,
                        _uuid_text(char.uuid),
                        properties,
                        lambda: self.mtu_size - 3,
                        ours,
                    )
                )
        return found

    async def _disconnect(self) -> None:
        if self._connection is not None:
            await self._connection.disconnect()

    def _on_disconnection(self, *_: Any) -> None:
        self._connection = None
        if self._disconnected_callback is not None:
            with contextlib.suppress(RuntimeError):  # whoever asked to be told is gone
                self._host.call_soon_threadsafe(self._disconnected_callback)


async def _in_radio(radio: Bluetooth, coroutine: Coroutine[Any, Any, T]) -> T:
    """Await something of the radio's thread, and turn Bumble's errors into bleak's."""

    async def run() -> T:
        try:
            return await coroutine
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise
            raise BleakError("disconnected") from None  # Bumble cancels what waits for an answer
        except ProtocolError as error:
            raise BleakGATTProtocolError(error.error_code) from error
        except BaseBumbleError as error:
            raise BleakError(f"{type(error).__name__}: {error}") from error

    return await asyncio.wrap_future(radio.submit(run()))


def _address_text(address: Address) -> str:
    return str(address).split("/")[0]


def _uuid_text(uuid: Any) -> str:
    text = str(uuid.to_hex_str(separator="-")).lower()
    return f"0000{text}-0000-1000-8000-00805f9b34fb" if len(text) == 4 else text
