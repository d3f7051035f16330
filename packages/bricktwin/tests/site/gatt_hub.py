"""A simulated hub's GATT, as a browser sees it: to connect, read, subscribe and write; and faults.

Its program runs in the virtual hub in real time. Who plays the browser says how its notifications
travel, and has the event loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from hub_firmware import PlayedFirmware, Refusal

from brickhub.hub.transports import profile
from brickhub.robot import Robot
from brickhub.virtual.body import Body

WRITE_BYTES = 512
REFUSED = "NotSupportedError"
GONE = "NetworkError"


class GattError(Exception):
    """An operation that fails, with the browser's name for it."""


class GattHub(PlayedFirmware):
    """A switched-on hub within reach.

    Attributes:
        is_silent: whether all that it says is lost.
        is_off: whether it is switched off for good.
        refusals: number of next writes that are refused.
        connections: how often a browser has connected.
    """

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        super().__init__(robot, "Pybricks Hub", body)
        self.loop: asyncio.AbstractEventLoop | None = None
        self.is_silent = False
        self.is_off = False
        self.refusals = 0
        self.connections = 0
        self._is_open = False
        self._is_subscribed = False
        self._report: asyncio.Task[None] | None = None

    @property
    def is_connected(self) -> bool:
        return self._is_open

    @property
    def can_send(self) -> bool:
        return self._is_open

    def submit(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        assert self.loop is not None
        if self.loop.is_closed():
            coroutine.close()
            return None
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop)

    async def settle(self) -> None:
        """A hub advertises again; who plays the browser looks at `is_running`."""

    async def notify(self, event: bytes) -> None:
        if self._is_open and self._is_subscribed and not self.is_silent:
            await self.send_notification(event)

    async def send_notification(self, event: bytes) -> None:
        """Hook: a notification on its way to the browser."""

    async def tell_loss(self) -> None:
        """Hook: the browser notices that the link is lost."""

    def switch_on(self) -> None:
        """Begin to report; called within the loop."""
        self.loop = asyncio.get_running_loop()
        self._report = self.loop.create_task(self.report_for_ever())

    def switch_off(self) -> None:
        """End its program, and its reports; called within the loop."""
        self.is_off = True
        if self._report is not None:
            self._report.cancel()
        self.close()

    # ---- what a browser does

    async def open(self) -> None:
        # A hub whose program runs does not advertise, so nobody finds it.
        if self.is_running:
            raise GattError(GONE)
        self.connections += 1
        self._is_open = True
        self._is_subscribed = False

    async def read(self, characteristic: str) -> bytes:
        values = {
            profile.FIRMWARE_REVISION_UUID: b"4.0.1",
            profile.PROFILE_VERSION_UUID: self.profile_version.encode(),
            profile.PNP_ID_UUID: self.product,
            profile.CAPABILITIES_UUID: self.capabilities(WRITE_BYTES),
        }
        return values[characteristic]

    async def subscribe(self) -> None:
        self._is_subscribed = True
        asyncio.ensure_future(self.send_status())  # noqa: RUF006  it is at once at its end

    async def write(self, command: bytes) -> int:
        """Error code of a command, 0 if it is obeyed."""
        if self.refusals:
            self.refusals -= 1
            return int(profile.CommandError.BUSY)
        try:
            await self.command(command)
        except Refusal as refusal:
            return refusal.code
        return 0

    async def disconnect(self) -> None:
        self._is_open = False

    async def lose(self) -> None:
        """The link breaks."""
        if self._is_open:
            self._is_open = False
            await self.tell_loss()
