"""A device of LEGO's kits as a Bluetooth peripheral of a real Chromium, over the DevTools protocol;
behind it is a virtual one, in real time. Its notifications are read, as those of
:mod:`emulated_hub`."""

from __future__ import annotations

import asyncio
import base64
from collections import deque
from typing import TYPE_CHECKING, Any

from emulated_hub import ADDRESS

from brickhub.kits.virtual_kit import VirtualKit
from brickhub.virtual.body import Body

if TYPE_CHECKING:
    from playwright.async_api import Browser, CDPSession, Page

SERVICE = "0000fd02-0000-1000-8000-00805f9b34fb"
WRITE = "0000fd02-0001-1000-8000-00805f9b34fb"
NOTIFY = "0000fd02-0002-1000-8000-00805f9b34fb"
LEGO = 0x0397
CARD = bytes([0, 0, 0])
_STEP_S = 0.02


class EmulatedKit:
    """The device that carries a robot, for one connection."""

    def __init__(self, body: Body) -> None:
        self._kit = VirtualKit(body)
        self._peer = self._kit.peers[0]
        self.is_off = False
        self._ids: dict[str, str] = {}
        self._is_read = False
        self._said: deque[bytes] = deque()
        self._tasks: set[asyncio.Task[Any]] = set()

    @property
    def is_driven(self) -> bool:
        """Whether a motor has a voltage."""
        return any(servo.voltage_mv for servo in self._kit.machine.servos.values())

    async def meet(self, page: Page) -> None:
        """A page finds it by the browser."""

    async def plug_into(self, browser: Browser) -> None:
        """Be a peripheral of a browser."""
        self._cdp: CDPSession = await browser.new_browser_cdp_session()
        handlers = {
            "gattOperationReceived": self._on_gatt,
            "characteristicOperationReceived": self._on_operation,
        }
        for event, handle in handlers.items():
            self._cdp.on(f"BluetoothEmulation.{event}", self._later(handle))
        await self._do("enable", state="powered-on", leSupported=True)
        product = self._peer.device.product.to_bytes(2, "big")
        data = base64.b64encode(product + CARD).decode()
        await self._do(
            "simulatePreconnectedPeripheral",
            address=ADDRESS,
            name=self._peer.name,
            manufacturerData=[{"key": LEGO, "data": data}],
            knownServiceUuids=[SERVICE],
        )
        made = await self._do("addService", address=ADDRESS, serviceUuid=SERVICE)
        service = made["serviceId"]
        both = {"write": True, "writeWithoutResponse": True}
        for uuid, properties in ((WRITE, both), (NOTIFY, {"read": True, "notify": True})):
            made = await self._do(
                "addCharacteristic",
                serviceId=service,
                characteristicUuid=uuid,
                properties=properties,
            )
            self._ids[made["characteristicId"]] = uuid
            if uuid == NOTIFY:
                self._notify = made["characteristicId"]
        await self._do(
            "addDescriptor",
            characteristicId=self._notify,
            descriptorUuid="00002902-0000-1000-8000-00805f9b34fb",
        )
        self._start(self._live())

    def switch_off(self) -> None:
        """End it; called within the loop."""
        self.is_off = True
        for task in self._tasks:
            task.cancel()

    async def _live(self) -> None:
        """Let the world go on in real time."""
        while not self.is_off:
            await asyncio.sleep(_STEP_S)
            for _ in range(round(_STEP_S / 0.005)):
                for _, packet in self._kit.step():
                    self._said.append(packet)
            await self._say()

    async def _say(self) -> None:
        if self._is_read and self._said:
            self._is_read = False
            await self._answer(self._notify, "read", self._said.popleft())

    async def _on_gatt(self, event: dict[str, Any]) -> None:
        if event["type"] == "connection":
            self._said.clear()
            self._peer.connect(lambda _, packet: None, lambda: None)
        await self._do("simulateGATTOperationResponse", address=ADDRESS, type=event["type"], code=0)

    async def _on_operation(self, event: dict[str, Any]) -> None:
        characteristic = event["characteristicId"]
        kind = event["type"]
        if kind == "read":
            self._is_read = True
            await self._say()
            return
        if kind == "write":
            self._peer.send(base64.b64decode(event["data"]))
        await self._answer(characteristic, kind)

    async def _answer(self, characteristic: str, kind: str, data: bytes | None = None) -> None:
        more = {} if data is None else {"data": base64.b64encode(data).decode()}
        await self._do(
            "simulateCharacteristicOperationResponse",
            characteristicId=characteristic,
            type=kind,
            code=0,
            **more,
        )

    async def _do(self, command: str, **parameters: Any) -> dict[str, Any]:
        if self.is_off:
            return {}
        done: dict[str, Any] = await self._cdp.send(f"BluetoothEmulation.{command}", parameters)
        return done

    def _later(self, handle: Any) -> Any:
        return lambda event: self._start(handle(event))

    def _start(self, coroutine: Any) -> None:
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
