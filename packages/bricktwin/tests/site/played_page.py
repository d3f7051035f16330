"""A page that is played: the browser's Bluetooth before a simulated hub, for Python of the tab
without a browser."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from typing import Any

from gatt_hub import GONE, REFUSED, GattError, GattHub

from brickhub.robot import Robot
from brickhub.virtual.body import Body


class PageHub(GattHub):
    """A hub whose browser is a `PlayedPage`."""

    page: PlayedPage

    async def send_notification(self, event: bytes) -> None:
        self.page.put({"kind": "event", "data": event.hex()})

    async def tell_loss(self) -> None:
        self.page.put({"kind": "lost"})


class PlayedPage:
    """A page with a hub; implements ``HubPage`` and ``Page``.

    Attributes:
        events: what it was sent.
        on_event: called with each of them.
        is_mute: whether writes have no answer any more, as of a browser whose promise stays open.
    """

    def __init__(self, robot: Robot, body: Body | None = None) -> None:
        self.hub = PageHub(robot, body)
        self.hub.page = self
        self.events: list[dict[str, Any]] = []
        self.on_event: Callable[[dict[str, Any]], None] = lambda _: None
        self.is_mute = False
        self._changed = threading.Condition()
        self._messages: list[dict[str, Any]] = []
        self._loop = self.hub.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name="browser", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.call_soon(self.hub.switch_on)
        self._loop.run_forever()
        for task in asyncio.all_tasks(self._loop):
            task.cancel()
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()

    def close(self) -> None:
        self.hub.close()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)

    def text(self, kind: str = "out") -> str:
        """What was printed."""
        return "".join(event["text"] for event in self.events if event["kind"] == kind)

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.events if event["kind"] == kind]

    def put(self, message: dict[str, Any]) -> None:
        """Put a message into the mailbox."""
        with self._changed:
            self._messages.append(message)
            self._changed.notify_all()

    def later(self, seconds: float, call: Callable[[], object]) -> None:
        """Let something happen while Python is busy."""

        def wait() -> None:
            time.sleep(seconds)
            call()

        threading.Thread(target=wait, daemon=True).start()

    # ---- as Python in the worker sees it

    def ask(self, number: int, operation: str, characteristic: str, data: str) -> None:
        self.hub.submit(self._answer(number, operation, characteristic, bytes.fromhex(data)))

    def take(self) -> str:
        with self._changed:
            messages = self._messages
            self._messages = []
        return json.dumps(messages) if messages else ""

    def wait(self, longest_ms: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._messages, longest_ms / 1000)

    def frame(self) -> None:
        raise AssertionError("nobody films a real hub")

    def post(self, events: str, rows: bytes) -> None:
        for event in json.loads(events or "[]"):
            self.events.append(event)
            self.on_event(event)

    async def _answer(self, number: int, operation: str, characteristic: str, data: bytes) -> None:
        answer: dict[str, Any] = {"kind": "answer", "number": number}
        try:
            answer.update(await self._done(operation, characteristic, data))
        except GattError as error:
            answer.update(error=str(error), message="GATT operation failed for unknown reason.")
        if not (self.is_mute and operation == "write"):
            self.put(answer)

    async def _done(self, operation: str, characteristic: str, data: bytes) -> dict[str, Any]:
        hub = self.hub
        if operation == "connect":
            await hub.open()
            return {"name": hub.name, "id": "abc"}
        if operation == "close":
            await hub.disconnect()
            return {}
        if not hub.is_connected:
            raise GattError(GONE)
        if operation == "read":
            return {"value": (await hub.read(characteristic)).hex()}
        if operation == "subscribe":
            await hub.subscribe()
        elif await hub.write(data):
            raise GattError(REFUSED)
        return {}
