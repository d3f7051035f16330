"""A write that is in flight when the link to a hub is lost, before the page's own Bluetooth: the
browser's promise stays open for ever, or ends late."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

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
