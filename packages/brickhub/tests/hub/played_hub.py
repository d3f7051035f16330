"""A simulated Pybricks hub over Bluetooth (Bumble): services and advertisement."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from bumble.att import ATT_Error
from bumble.core import UUID, AdvertisingData
from bumble.gatt import Characteristic, CharacteristicValue, Service
from hub_firmware import PlayedFirmware, Refusal
from radio import Radio

from brickhub.hub.transports import profile
from brickhub.robot import Robot


class PlayedHub(PlayedFirmware):
    """A switched-on hub within reach."""

    def __init__(
        self,
        radio: Radio,
        robot: Robot,
        name: str = "Pybricks Hub",
        address: str = "C0:01:02:03:04:05",
    ) -> None:
        super().__init__(robot, name)
        self.radio, self.address = radio, address
        self._connection: Any = None
        radio.run(self._switch_on())

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    @property
    def is_advertising(self) -> bool:
        return bool(self._device.is_advertising)

    @property
    def can_send(self) -> bool:
        return self.radio.link.in_range

    def submit(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        return self.radio.submit(coroutine)

    async def notify(self, event: bytes) -> None:
        await self._device.notify_subscribers(self._characteristic, event)

    async def settle(self) -> None:
        if not self.is_connected:
            await self._advertise()

    def reboot(self) -> None:
        """Power loss: link, program and memory are gone."""
        run = self._run
        self.size = 0
        self.radio.disconnect()
        if run is not None:
            run.stop()
            run.join()

    # ---- in the radio's thread

    async def _switch_on(self) -> None:
        self._device = self.radio.device(self.name, self.address)
        read, readable = Characteristic.Properties.READ, Characteristic.READABLE
        self._characteristic = Characteristic(
            UUID(profile.COMMAND_EVENT_UUID),
            Characteristic.Properties.WRITE | Characteristic.Properties.NOTIFY,
            Characteristic.WRITEABLE,
            CharacteristicValue(write=self._on_command),
        )
        self._characteristic.on(
            Characteristic.EVENT_SUBSCRIPTION, lambda *_: asyncio.ensure_future(self.send_status())
        )
        version = CharacteristicValue(read=lambda _: self.profile_version.encode())
        capabilities = CharacteristicValue(read=self._capabilities)
        self._device.add_service(
            Service(
                UUID.from_16_bits(0x180A),
                [
                    Characteristic(UUID.from_16_bits(0x2A26), read, readable, b"4.0.1"),
                    Characteristic(UUID.from_16_bits(0x2A28), read, readable, version),
                    Characteristic(UUID.from_16_bits(0x2A50), read, readable, self.product),
                ],
            )
        )
        self._device.add_service(
            Service(
                UUID(profile.SERVICE_UUID),
                [
                    self._characteristic,
                    Characteristic(UUID(profile.CAPABILITIES_UUID), read, readable, capabilities),
                ],
            )
        )
        self._device.add_service(_uart_service())
        self._device.on("connection", self._on_connection)
        await self._device.power_on()
        await self._advertise()
        self._report = asyncio.create_task(self.report_for_ever())

    async def _advertise(self) -> None:
        uuids = AdvertisingData.INCOMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS
        response = [
            (AdvertisingData.COMPLETE_LOCAL_NAME, self.name.encode()),
            (
                AdvertisingData.SERVICE_DATA_16_BIT_UUID,
                bytes(UUID.from_16_bits(0x2A50)) + self.product,
            ),
        ]
        advertisement = [
            (AdvertisingData.FLAGS, b"\x06"),
            (uuids, bytes(UUID(profile.SERVICE_UUID))),
        ]
        await self._device.start_advertising(
            advertising_data=bytes(AdvertisingData(advertisement)),
            scan_response_data=bytes(AdvertisingData(response)),
            advertising_interval_min=50,
            advertising_interval_max=50,
        )

    def _capabilities(self, connection: Any) -> bytes:
        return self.capabilities(min(connection.att_mtu - 3, 512))

    def _on_connection(self, connection: Any) -> None:
        self._connection = connection
        connection.on("disconnection", self._on_disconnection)

    def _on_disconnection(self, *_: Any) -> None:
        self._connection = None
        if self._run is None:
            self._later = asyncio.ensure_future(self._advertise())

    async def _on_command(self, _connection: Any, value: bytes) -> None:
        try:
            await self.command(value)
        except Refusal as refusal:
            raise ATT_Error(refusal.code) from None


def _uart_service() -> Service:
    """UART service of older firmware."""
    uuid = "6e40{:04x}-b5a3-f393-e0a9-e50e24dcca9e"
    write, notify = (
        Characteristic.Properties.WRITE_WITHOUT_RESPONSE,
        Characteristic.Properties.NOTIFY,
    )
    taken = CharacteristicValue(write=lambda _connection, _value: None)
    return Service(
        UUID(uuid.format(1)),
        [
            Characteristic(UUID(uuid.format(2)), write, Characteristic.WRITEABLE, taken),
            Characteristic(UUID(uuid.format(3)), notify, Characteristic.READABLE, b""),
        ],
    )
