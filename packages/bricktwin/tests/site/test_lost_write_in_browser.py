"""A write that is in flight when the link to a hub is lost, before the page's own Bluetooth and
cable: the browser's promise stays open for ever, or ends late."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest
from browser import TIMEOUT_MS

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

# A browser's Bluetooth with one device, whose writes end when the test lets them.
PLAYED = """async ([how]) => {
    const { Gatt } = await import("./gatt.js");
    const pause = (ms) => new Promise((done) => setTimeout(done, ms));
    const writes = [];
    const characteristic = {
        uuid: "hub",
        writeValueWithResponse: () => new Promise((done, fail) => writes.push({ done, fail })),
        readValue: async () => new DataView(new Uint8Array([1, 2]).buffer),
    };
    const service = { getCharacteristics: async () => [characteristic] };
    const device = Object.assign(new EventTarget(), { name: "Hub", id: "1" });
    device.gatt = {
        connected: false,
        connect: async () => (device.gatt.connected = true),
        disconnect: () => (device.gatt.connected = false),
        getPrimaryServices: async () => [service],
    };
    Object.defineProperty(navigator, "bluetooth", {
        configurable: true, value: { requestDevice: async () => device },
    });
    let lost = 0;
    const gatt = new Gatt({ event() {}, lost: () => lost++ });
    await gatt.choose({});
    await gatt.do({ operation: "connect" });
    const write = { operation: "write", characteristic: "hub", data: "00" };
    const answers = [gatt.do(write), gatt.do(write), gatt.do({ ...write, data: "01" }, true)];
    await pause(0);
    device.gatt.connected = false;
    device.dispatchEvent(new Event("gattserverdisconnected"));
    const late = pause(1000).then(() => "nothing");
    const ended = [];
    for (const answer of answers) ended.push(await Promise.race([answer, late]));
    // The same hub again; now the old write ends, if it does at all.
    await gatt.do({ operation: "connect" });
    const next = gatt.do(write);
    if (how === "rejects") writes[0].fail(new DOMException("GATT Server is disconnected", "NetworkError"));
    if (how === "resolves") writes[0].done();
    await pause(0);
    const isOpen = await Promise.race([next.then(() => false), pause(20).then(() => true)]);
    writes[1].done();
    const read = await Promise.race([gatt.do({ operation: "read", characteristic: "hub" }), late]);
    return { ended, lost, isOpen, next: await Promise.race([next, late]), read, writes: writes.length };
}"""  # noqa: E501


@pytest.fixture(scope="module")
def page(address: str, browser: Browser) -> Iterator[Page]:
    """A file of the site, beside whose scripts no Python has to start."""
    opened = browser.new_page()
    opened.set_default_timeout(TIMEOUT_MS)
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(f"{address}files.json")
    yield opened
    opened.close()
    assert not errors


@pytest.mark.parametrize("how", ["stays open", "rejects", "resolves"])
def test_a_write_ends_with_the_link_however_late_the_browser_does(page: Page, how: str) -> None:
    told: dict[str, Any] = page.evaluate(PLAYED, [how])
    lost = {"error": "NetworkError", "message": "the link is lost"}
    assert told["ended"] == [lost] * 3
    assert told["lost"] == 1
    # What comes after the loss is of the new link alone, and one at a time.
    assert told["isOpen"] is True
    assert told["next"] == {}
    assert told["read"] == {"value": "0102"}
    assert told["writes"] == 2


# A browser's Web Serial with one port, whose cable is pulled while a write has no end; then it is
# another port, beside one of another kind.
PULLED = """async () => {
    const { Cable } = await import("./cable.js");
    const pause = (ms) => new Promise((done) => setTimeout(done, ms));
    const written = [], signals = [];
    const make = (usbProductId, write) => ({
        getInfo: () => ({ usbVendorId: 0x0694, usbProductId }),
        async open() {
            if (this.readable) throw new DOMException("It is open.", "InvalidStateError");
            this.readable = new ReadableStream({ start: (stream) => (this.stream = stream) });
            this.writable = new WritableStream({ write });
        },
        async setSignals(signal) { signals.push(signal.dataTerminalReady); },
        async close() {
            if (this.readable?.locked || this.writable?.locked) throw new TypeError("it is locked");
            this.readable = this.writable = null;
        },
        pull() {
            this.readable = null;
            this.stream.error(new DOMException("The device has been lost.", "NetworkError"));
        },
    });
    const first = make(5, () => new Promise(() => {}));
    const second = make(5, (chunk) => void written.push([...chunk]));
    let ports = [first];
    Object.defineProperty(navigator, "serial", {
        configurable: true, value: { requestPort: async () => first, getPorts: async () => ports },
    });
    let lost = 0;
    const heard = [];
    const cable = new Cable({ event: (digits) => heard.push(digits), lost: () => lost++ });
    await cable.choose({});
    const connected = [await cable.do({ operation: "connect" })];
    first.stream.enqueue(Uint8Array.of(1, 254));
    const write = cable.do({ operation: "write", data: "0a" });
    await pause(5);
    first.pull();
    const ended = await Promise.race([write, pause(1000).then(() => "nothing")]);
    await pause(5);
    const after = await cable.do({ operation: "write", data: "0b" });
    ports = [make(9), second];
    connected.push(await cable.do({ operation: "connect" }));
    const next = await cable.do({ operation: "write", data: "ff00" }, true);
    const closed = await cable.do({ operation: "close" });
    const isConnected = cable.isConnected, isOpen = Boolean(second.readable);
    return { connected, heard, ended, after, next, closed, lost, written, signals, isConnected, isOpen };
}"""  # noqa: E501


def test_a_pulled_cable_ends_a_write_and_is_found_again(page: Page) -> None:
    told: dict[str, Any] = page.evaluate(PULLED)
    assert told["connected"] == [{"product": 5}] * 2
    assert told["signals"] == [True, True]
    assert told["heard"] == ["01fe"]
    assert told["ended"] == {"error": "NetworkError", "message": "the link is lost"}
    assert told["after"] == {"error": "NetworkError", "message": "it is not connected"}
    assert (told["next"], told["closed"], told["lost"]) == ({}, {}, 1)
    assert told["written"] == [[255, 0]]
    assert (told["isConnected"], told["isOpen"]) == (False, False)
