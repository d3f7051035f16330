"""The simulated hub against pybricksdev as a client."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterator

import bleak
import pytest
from described import TWO_WHEELER
from hub_firmware import Refusal
from played_hub import PlayedHub
from radio import Radio

from brickhub.hub.program.compile import compile_mpy, program_blob
from brickhub.hub.transports.profile import (
    CommandError,
    PybricksCommand,
    Status,
    StatusReport,
    parse_capabilities,
    parse_event,
)
from brickhub.robot import HubKind

pytestmark = pytest.mark.realtime

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


def test_pybricksdev_accepts_played_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    from pybricksdev.ble import find_device
    from pybricksdev.connections.pybricks import PybricksHubBLE

    radio = Radio()
    hub = PlayedHub(radio, TWO_WHEELER)
    hub.library.append(ECHO)
    backend = radio.backend()
    monkeypatch.setattr(
        bleak, "get_platform_scanner_backend_type", lambda: (backend.scanner, "radio")
    )
    monkeypatch.setattr(
        bleak, "get_platform_client_backend_type", lambda: (backend.client, "radio")
    )
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
        await client.download_user_program(
            program_blob({"__main__": compile_mpy(ECHO)}, HubKind.PRIME)
        )
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


@pytest.fixture
def hub() -> Iterator[PlayedHub]:
    radio = Radio()
    played = PlayedHub(radio, TWO_WHEELER)
    yield played
    played.close()
    radio.close()


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (bytes((PybricksCommand.START_USER_PROGRAM, 0, 0)), CommandError.VALUE_NOT_ALLOWED),
        # there is none
        (bytes((PybricksCommand.START_USER_PROGRAM,)), CommandError.INVALID_COMMAND),
        (
            struct.pack("<BI", PybricksCommand.WRITE_USER_PROGRAM_META, 10**8),
            CommandError.VALUE_NOT_ALLOWED,
        ),
        (
            struct.pack("<BI", PybricksCommand.WRITE_USER_RAM, 272 * 1024 - 1) + b"ab",
            CommandError.VALUE_NOT_ALLOWED,
        ),
        (bytes((99,)), CommandError.INVALID_COMMAND),
        (bytes((PybricksCommand.STOP_USER_PROGRAM,)), None),  # nothing to stop is no error
        (bytes((PybricksCommand.WRITE_STDIN, 1, 2)), None),
        (bytes((PybricksCommand.WRITE_APP_DATA, 0, 0, 5)), None),
    ],
)
def test_played_hub_refuses_as_firmware(hub: PlayedHub, command: bytes, code: int | None) -> None:
    if code is None:
        asyncio.run(hub.command(command))
        return
    with pytest.raises(Refusal) as caught:
        asyncio.run(hub.command(command))
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("version", "capability_bytes", "report_bytes"),
    [("1.3.0", 10, 5), ("1.4.0", 10, 6), ("1.5.0", 11, 7), ("1.6.0", 11, 7)],
)
def test_played_hub_follows_profile_versions(
    hub: PlayedHub,
    monkeypatch: pytest.MonkeyPatch,
    version: str,
    capability_bytes: int,
    report_bytes: int,
) -> None:
    reports: list[bytes] = []

    async def keep(event: bytes) -> None:
        reports.append(event)

    hub.profile_version = version
    monkeypatch.setattr(hub, "notify", keep)
    asyncio.run(hub.send_status())
    assert len(hub.capabilities(100)) == capability_bytes
    assert parse_capabilities(hub.capabilities(100)).slots == (5 if capability_bytes == 11 else 0)
    assert len(reports[0]) == report_bytes
    assert parse_event(reports[0]) == StatusReport(Status(0), 0)
