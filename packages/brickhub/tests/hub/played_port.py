"""A hub's port without a hub: it notes commands, and reports what a test says."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable

from brickhub.hub.transports import profile
from brickhub.hub.transports.profile import Status


class PlayedPort:
    """A hub's port. ``written``: commands that it got; ``fails``: raised by the next writes."""

    name = "Rover"
    address = "C0:01"
    silence = "switch it on"

    def __init__(self) -> None:
        self.values = {
            profile.PROFILE_VERSION_UUID: b"1.5.0",
            profile.PNP_ID_UUID: struct.pack("<BHHH", 1, 0x0397, 0x81, 0),
            profile.FIRMWARE_REVISION_UUID: b"4.0.1",
            profile.CAPABILITIES_UUID: struct.pack("<HIIB", 20, 3, 1000, 2),
        }
        self.written: list[bytes] = []
        self.operations: list[str] = []
        self.fails: list[Exception] = []
        self.is_silent = False
        self.status = Status(0)
        self.slot = 1
        self.is_closed = False
        # What the hub does after a command.
        self.after: Callable[[bytes], None] = lambda command: None

    def report(self, status: Status | None = None) -> None:
        """Report a status, by default the present one."""
        if status is not None:
            self.status = status
        self.on_event(b"\x00" + struct.pack("<IxB", self.status, self.slot))

    async def open(self, on_event: Callable[[bytes], None], on_loss: Callable[[str], None]) -> None:
        self.on_event = on_event
        self.on_loss = on_loss

    async def read(self, characteristic: str) -> bytes:
        if self.is_silent:
            await asyncio.sleep(10)
        return self.values[characteristic]

    async def subscribe(self) -> None:
        self.report()

    async def write(self, command: bytes, operation: str) -> None:
        self.written.append(command)
        self.operations.append(operation)
        if self.fails:
            raise self.fails.pop(0)
        if self.is_silent:
            await asyncio.sleep(10)
        self.after(command)

    async def close(self) -> None:
        self.is_closed = True
