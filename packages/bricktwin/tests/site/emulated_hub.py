"""A simulated hub as a Bluetooth peripheral of a real Chromium, over the DevTools protocol, and a
page of the site that meets it.

The domain ``BluetoothEmulation`` has no notifications. So each is the answer to a read, which the
page does not know of: a script that is there before the page reads the subscribed characteristic
over and over, and Chromium tells the page of each value by the very event of a notification. The
same script holds operations back while the link is being lost: Chromium keeps an emulated
connection for good if one of them has no answer at its end.
"""

from __future__ import annotations

import asyncio
import base64
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, Protocol

from browser import FLAGS, TIMEOUT_MS, chromium_path
from gatt_hub import GattHub

from brickhub.hub.transports import profile
from brickhub.robot import Robot
from brickhub.virtual.body import Body

if TYPE_CHECKING:
    from playwright.async_api import Browser, CDPSession, Page

ADDRESS = "09:09:09:09:09:09"
_READS_FOR_NOTIFICATIONS = """(() => {
    const kind = globalThis.BluetoothRemoteGATTCharacteristic?.prototype;
    if (!kind) return;
    const subscribe = kind.startNotifications;
    kind.startNotifications = async function () {
        const subscribed = await subscribe.call(this);
        const listen = async () => { for (;;) await this.readValue(); };
        listen().catch(() => {});
        return subscribed;
    };
    for (const name of ["readValue", "writeValueWithResponse"]) {
        const begin = kind[name];
        kind[name] = async function (...values) {
            while (globalThis.isLosing) await new Promise((done) => setTimeout(done, 10));
            return begin.apply(this, values);
        };
    }
})()"""
_READABLE = (
    profile.FIRMWARE_REVISION_UUID,
    profile.PROFILE_VERSION_UUID,
    profile.PNP_ID_UUID,
)


_ON_ITS_WAY_S = 0.2
"""Time in which an operation that a page has begun is known here."""


class EmulatedHub(GattHub):
    """A hub of which a browser knows.

    Attributes:
        page: that has it; once it is there.
    """

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        super().__init__(robot, body)
        self.page: Page | None = None
        self._uuids: dict[str, str] = {}
        self._command = ""
        self._is_read = False
        self._is_losing = False
        self._unanswered: list[tuple[str, str]] = []
        self._notifications: deque[bytes] = deque()
        self._tasks: set[asyncio.Task[Any]] = set()

    async def plug_into(self, browser: Browser) -> None:
        """Be a peripheral of a browser."""
        self._cdp: CDPSession = await browser.new_browser_cdp_session()
        self._cdp.on("BluetoothEmulation.gattOperationReceived", self._later(self._on_gatt))
        self._cdp.on(
            "BluetoothEmulation.characteristicOperationReceived", self._later(self._on_operation)
        )
        await self._do("enable", state="powered-on", leSupported=True)
        await self._do(
            "simulatePreconnectedPeripheral",
            address=ADDRESS,
            name=self.name,
            manufacturerData=[],
            knownServiceUuids=[profile.SERVICE_UUID],
        )
        await self._add_services()
        self.switch_on()

    async def meet(self, page: Page) -> None:
        """Be in reach of a page."""
        self.page = page

    async def _add_services(self) -> None:
        hub = await self._service(profile.SERVICE_UUID)
        both = {"read": True, "write": True, "notify": True}
        self._command = await self._characteristic(hub, profile.COMMAND_EVENT_UUID, both)
        # What a browser subscribes by.
        await self._do(
            "addDescriptor",
            characteristicId=self._command,
            descriptorUuid="00002902-0000-1000-8000-00805f9b34fb",
        )
        await self._characteristic(hub, profile.CAPABILITIES_UUID, {"read": True})
        itself = await self._service(profile.DEVICE_INFORMATION_UUID)
        for uuid in _READABLE:
            await self._characteristic(itself, uuid, {"read": True})

    async def send_notification(self, event: bytes) -> None:
        self._notifications.append(event)
        await self._send_next()

    async def tell_loss(self) -> None:
        self._notifications.clear()
        self._is_losing = True
        await self._hold(True)
        # One may be on its way now.
        await asyncio.sleep(_ON_ITS_WAY_S)
        if self._is_read:
            self._is_read = False
            self._unanswered.append((self._command, "read"))
        failed = int(profile.CommandError.UNLIKELY_ERROR)
        ends = [self._answer(*operation, failed) for operation in self._unanswered]
        self._unanswered.clear()
        # All at once: a page that has its answer begins what else it has to do.
        await asyncio.gather(*ends, self._do("simulateGATTDisconnection", address=ADDRESS))
        # With the connection Chromium forgets them.
        await self._add_services()
        self._is_losing = False
        await self._hold(False)

    async def _hold(self, is_losing: bool) -> None:
        """Let the page hold its operations back, or let it go on."""
        if self.page is not None and not self.is_off:
            await self.page.evaluate("(is) => { globalThis.isLosing = is; }", is_losing)

    async def _send_next(self) -> None:
        if self._is_read and self._notifications:
            self._is_read = False
            await self._answer(self._command, "read", 0, self._notifications.popleft())

    async def _on_gatt(self, event: dict[str, Any]) -> None:
        code = 0
        while self._is_losing:
            await asyncio.sleep(_ON_ITS_WAY_S)
        if event["type"] == "connection":
            # The code is of HCI: the peripheral does not answer.
            code = 0x3E if self.is_running else 0
            if not code:
                await self.open()
        await self._do(
            "simulateGATTOperationResponse", address=ADDRESS, type=event["type"], code=code
        )

    async def _on_operation(self, event: dict[str, Any]) -> None:
        kind = event["type"]
        characteristic = event["characteristicId"]
        if self._is_losing:
            self._unanswered.append((characteristic, kind))
        elif kind == "write":
            code = await self.write(base64.b64decode(event["data"]))
            await self._answer(characteristic, kind, code)
        elif kind == "subscribe-to-notifications":
            await self._answer(characteristic, kind, 0)
            await self.subscribe()
        elif characteristic == self._command and kind == "read":
            self._is_read = True
            await self._send_next()
        elif kind == "read":
            value = await self.read(self._uuids[characteristic])
            await self._answer(characteristic, kind, 0, value)
        else:
            await self._answer(characteristic, kind, 0)

    async def _answer(
        self, characteristic: str, kind: str, code: int, data: bytes | None = None
    ) -> None:
        more = {} if data is None else {"data": base64.b64encode(data).decode()}
        await self._do(
            "simulateCharacteristicOperationResponse",
            characteristicId=characteristic,
            type=kind,
            code=code,
            **more,
        )

    async def _service(self, uuid: str) -> str:
        made = await self._do("addService", address=ADDRESS, serviceUuid=uuid)
        return str(made["serviceId"])

    async def _characteristic(self, service: str, uuid: str, properties: dict[str, bool]) -> str:
        made = await self._do(
            "addCharacteristic",
            serviceId=service,
            characteristicUuid=uuid,
            properties=properties,
        )
        self._uuids[made["characteristicId"]] = uuid
        return str(made["characteristicId"])

    async def _do(self, command: str, **parameters: Any) -> dict[str, Any]:
        # What is on its way when the browser closes finds nobody any more.
        if self.is_off:
            return {}
        done: dict[str, Any] = await self._cdp.send(f"BluetoothEmulation.{command}", parameters)
        return done

    def _later(self, handle: Any) -> Any:
        def begin(event: dict[str, Any]) -> None:
            task = asyncio.get_running_loop().create_task(handle(event))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

        return begin


class Peripheral(Protocol):
    """What a browser finds."""

    async def plug_into(self, browser: Browser) -> None: ...

    async def meet(self, page: Page) -> None: ...

    def switch_off(self) -> None: ...


@asynccontextmanager
async def page_with(hub: Peripheral, address: str) -> AsyncIterator[Page]:
    """A page of a site, with Python at work, in a browser that has a hub within reach."""
    from playwright.async_api import async_playwright

    async with async_playwright() as playwright:
        path = chromium_path(playwright.chromium.executable_path)
        # On Linux, pages may use Bluetooth only where somebody has switched it on.
        flags = [*FLAGS, "--enable-blink-features=WebBluetooth"]
        browser = await playwright.chromium.launch(executable_path=path, args=flags)
        try:
            await hub.plug_into(browser)
            page = await _page(browser)
            await hub.meet(page)
            errors: list[str] = []
            page.on("pageerror", lambda error: errors.append(str(error)))
            await page.goto(address)
            await page.wait_for_selector("#state.ready")
            yield page
        finally:
            hub.switch_off()
            await browser.close()
        assert not errors


async def _page(browser: Browser) -> Page:
    """A page with no program, and no robot whose pictures take long without a graphics card."""
    context = await browser.new_context(viewport={"width": 1280, "height": 800})
    page = await context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    await page.add_init_script(_READS_FOR_NOTIFICATIONS)
    await page.add_init_script(
        "localStorage['bricks-programs'] ??= JSON.stringify("
        "{ files: { 'main.py': '' }, current: 'main.py', robot: 'bench', world: '' })"
    )
    await _choose_when_asked(page)
    return page


async def _choose_when_asked(page: Page) -> None:
    """Choose the first device of the browser's own window, as a person does."""
    session = await page.context.new_cdp_session(page)
    chosen: set[str] = set()

    async def choose(prompt: dict[str, Any]) -> None:
        await session.send(
            "DeviceAccess.selectPrompt",
            {"id": prompt["id"], "deviceId": prompt["devices"][0]["id"]},
        )

    def on_prompt(prompt: dict[str, Any]) -> None:
        # It is told again for each device that is found.
        if prompt["devices"] and prompt["id"] not in chosen:
            chosen.add(prompt["id"])
            asyncio.ensure_future(choose(prompt))  # noqa: RUF006

    session.on("DeviceAccess.deviceRequestPrompted", on_prompt)
    await session.send("DeviceAccess.enable")


async def connect(page: Page) -> None:
    """Press the button, and wait until the hub is connected."""
    await page.click("#connect")
    await page.locator("[data-real=facts]", has_text="firmware").wait_for()
