"""The played hub against somebody else's client: what pybricksdev can work with is a Pybricks hub."""

from __future__ import annotations

import asyncio

import bleak
import pytest
from played_hub import PlayedHub
from radio import Radio

from bricksrl.hub.compile import compile_mpy, program_blob
from bricksrl.robots import TWO_WHEELER, HubKind

ECHO = """
from micropython import kbd_intr
from usys import stdin, stdout
from uselect import poll, POLLIN
from pybricks.tools import wait
kbd_intr(-1)
keys = poll()
keys.register(stdin, POLLIN)
stdout.buffer.write(b"ready")
while True:
    while not keys.poll(0):
        wait(1)
    stdout.buffer.write(stdin.buffer.read(1))
"""


def test_pybricksdev_takes_it_for_a_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    from pybricksdev.ble import find_device
    from pybricksdev.connections.pybricks import PybricksHubBLE

    radio = Radio()
    hub = PlayedHub(radio, TWO_WHEELER)
    hub.library.append(ECHO)
    backend = radio.backend()
    monkeypatch.setattr(bleak, "get_platform_scanner_backend_type", lambda: (backend.scanner, "radio"))
    monkeypatch.setattr(bleak, "get_platform_client_backend_type", lambda: (backend.client, "radio"))
    received = bytearray()

    async def expect(data: bytes) -> None:
        async with asyncio.timeout(5):
            while bytes(received) != data:
                await asyncio.sleep(0.005)
        received.clear()

    async def use() -> None:
        client = PybricksHubBLE(await find_device("Pybricks Hub", timeout=5))
        client.print_output = False
        await client.connect()
        client.stdout_observable.subscribe(received.extend)
        await client.download_user_program(program_blob(compile_mpy(ECHO), HubKind.PRIME))
        await client.start_user_program()
        await expect(b"ready")
        for data in (b"a", bytes(range(20)), bytes(63)):
            await client.write(data)
            await expect(data)
        with pytest.raises(bleak.exc.BleakGATTProtocolError):
            await client.write(bytes(64))  # more than its buffer
        with pytest.raises(bleak.exc.BleakGATTProtocolError):
            await client.start_user_program()  # one runs already
        await client.stop_user_program()
        await expect(b"\r\nThe program was stopped (SystemExit).\r\n")
        await client.disconnect()

    try:
        asyncio.run(use())
    finally:
        hub.close()
        radio.close()
