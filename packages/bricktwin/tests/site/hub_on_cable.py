"""A simulated EV3 Brick on a cable of a real Chromium, whose Web Serial is played before the page
begins: no browser can be told of a serial port that is not there."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING

from played_cable import EV3_PRODUCT, MAX_WRITE_BYTES
from played_usb_hub import PlayedUsbHub, SocketSerial

from brickhub.robot import Robot
from brickhub.virtual.body import Body

if TYPE_CHECKING:
    from playwright.async_api import Browser, Page

# `navigator.serial` as Chromium has it, with one port, which is another one each time that it is
# plugged in.
_SERIAL = """(() => {
    const error = (name, message) => new DOMException(message, name);
    class Port {
        getInfo() { return { usbVendorId: 0x0694, usbProductId: %d }; }
        async open({ baudRate }) {
            if (this.readable) throw error("InvalidStateError", "The port is already open.");
            if (!baudRate || !(await cableOpen())) throw error("NetworkError", "Failed to open serial port.");
            this.readable = new ReadableStream({ pull: (stream) => this.pull(stream), cancel: () => {} });
            this.writable = new WritableStream({ write: (chunk) => cableWrite([...chunk]) });
        }
        async pull(stream) {
            const bytes = await cableRead();
            if (bytes) return stream.enqueue(Uint8Array.from(bytes));
            if (port === this) port = null;
            this.readable = null;
            stream.error(error("NetworkError", "The device has been lost."));
        }
        async setSignals({ dataTerminalReady }) { await cableListens(dataTerminalReady); }
        async close() {
            if (this.readable?.locked || this.writable?.locked) throw new TypeError("it is locked");
            this.readable = this.writable = null;
            await cableClose();
        }
    }
    let port = null;
    const getPorts = async () => {
        if (!(await cableIsThere())) return [];
        port ??= new Port();
        return [port];
    };
    const requestPort = async ({ filters }) => {
        const [found] = await getPorts();
        const wants = ({ usbVendorId, usbProductId }) => usbVendorId === 0x0694 && usbProductId === %d;
        if (!found || !filters.some(wants)) throw error("NotFoundError", "No port selected by the user.");
        return found;
    };
    Object.defineProperty(navigator, "serial", { value: { getPorts, requestPort } });
})()""" % (EV3_PRODUCT, EV3_PRODUCT)  # noqa: E501, UP031


class HubOnCable(PlayedUsbHub):
    """A brick on the cable of a computer with a browser."""

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        super().__init__(robot, "EV3", body)
        self.max_write_bytes = MAX_WRITE_BYTES
        self._heard: asyncio.Queue[bytes] = asyncio.Queue()
        self._listens = False
        self._serial: SocketSerial | None = None

    async def plug_into(self, browser: Browser) -> None:
        """Its cable is of the page's."""

    async def meet(self, page: Page) -> None:
        """Be on the cable of a page."""
        await page.expose_function("cableIsThere", lambda: self.is_plugged_in)
        await page.expose_function("cableOpen", self._open)
        await page.expose_function("cableListens", self._listen_to)
        await page.expose_function("cableWrite", self._written)
        await page.expose_function("cableRead", self._read)
        await page.expose_function("cableClose", self._close)
        await page.add_init_script(_SERIAL)

    def switch_off(self) -> None:
        """End all that it does."""
        self.close()

    def _open(self) -> bool:
        if not self.is_plugged_in:
            return False
        self._listens = False
        self._heard = asyncio.Queue()
        self._serial = self.open_serial("")
        arguments = (self._serial, self._heard, asyncio.get_running_loop())
        threading.Thread(target=self._pass_on, args=arguments, daemon=True).start()
        return True

    def _pass_on(
        self, serial: SocketSerial, heard: asyncio.Queue[bytes], loop: asyncio.AbstractEventLoop
    ) -> None:
        data = None
        while data != b"":
            try:
                data = serial.read(256) or None
            except OSError:
                data = b""
            # A hub says nothing to who does not listen; the end is noticed without.
            if data is not None and (self._listens or not data):
                loop.call_soon_threadsafe(heard.put_nowait, data)
        serial.close()

    def _listen_to(self, listens: bool) -> None:
        self._listens = listens

    def _written(self, data: list[int]) -> None:
        assert self._serial is not None
        self._serial.write(bytes(data))

    async def _read(self) -> list[int] | None:
        """What the hub says next; nothing when it is gone."""
        return list(await self._heard.get()) or None

    def _close(self) -> None:
        if self._serial is not None:
            self._serial.close()
            self._serial = None
