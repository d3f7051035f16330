"""Transport to a real hub over Bluetooth Low Energy."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from brickhub.hub.hub_errors import HubDisconnectedError
from brickhub.hub.transports import profile
from brickhub.hub.transports.bluetooth import bleak_errors
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from brickhub.hub.transports.scan import BleBackend, find

if TYPE_CHECKING:
    from bleak import BleakClient
    from bleak.backends.characteristic import BleakGATTCharacteristic
    from bleak.backends.client import BaseBleakClient
    from bleak.backends.device import BLEDevice


class BleTransport(ProfileTransport):
    """A :class:`~brickhub.hub.transport.Transport` over Bluetooth.

    Args:
        name, address: name or address of the hub; with neither it must be the only one in reach.
        backend: bleak backend; ``None`` for bleak's default.
        timeout_s, answer_timeout_s, record: see :class:`ProfileTransport`.
    """

    def __init__(
        self,
        name: str | None = None,
        address: str | None = None,
        *,
        backend: BleBackend | None = None,
        timeout_s: float = 20.0,
        answer_timeout_s: float = 2.0,
        record: Path | None = None,
    ) -> None:
        super().__init__(timeout_s=timeout_s, answer_timeout_s=answer_timeout_s, record=record)
        self._name, self._address = name, address
        self._backend = backend

    async def _find(self, timeout_s: float) -> Port:
        name, address = (self._name, self._address) if self._first_hub is None else (None, self._first_hub.address)
        device = await find(name, address, timeout_s, self._backend)
        return BlePort(device, self._backend.client if self._backend else None, timeout_s)


class BlePort:
    """Pybricks Profile over a GATT connection, with bleak."""

    def __init__(self, device: BLEDevice, client_backend: type[BaseBleakClient] | None, timeout_s: float) -> None:
        self.name, self.address = device.name or "", device.address
        self._device, self._client_backend, self._timeout_s = device, client_backend, timeout_s
        self._client: BleakClient | None = None

    async def open(self, on_event: Callable[[bytes], None], on_loss: Callable[[str], None]) -> None:
        from bleak import BleakClient

        self._on_event = on_event
        self._client = BleakClient(
            self._device,
            disconnected_callback=lambda _: on_loss("it is out of reach, or was switched off"),
            timeout=self._timeout_s,
            backend=self._client_backend,
        )
        with self._errors():
            await self._client.connect()

    async def read(self, characteristic: str) -> bytes:
        with self._errors():
            return bytes(await self._opened().read_gatt_char(characteristic))

    async def subscribe(self) -> None:
        def on_notification(_: BleakGATTCharacteristic, data: bytearray) -> None:
            self._on_event(bytes(data))

        with self._errors():
            await self._opened().start_notify(profile.COMMAND_EVENT_UUID, on_notification)

    async def write(self, command: bytes, operation: str) -> None:
        with bleak_errors(operation, HubDisconnectedError):
            await self._opened().write_gatt_char(profile.COMMAND_EVENT_UUID, command, response=True)

    async def close(self) -> None:
        if self._client is not None:
            await self._client.disconnect()

    def _opened(self) -> BleakClient:
        if self._client is None:
            raise HubDisconnectedError("the hub is not connected; open the link first")
        return self._client

    def _errors(self) -> AbstractContextManager[None]:
        return bleak_errors(f"connect to the hub '{self.name}'", HubDisconnectedError)
