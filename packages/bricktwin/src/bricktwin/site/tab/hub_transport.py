"""Transport to a real hub from a tab, by Bluetooth or cable, in the worker's own event loop."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from brickhub.errors import HubError
from brickhub.hub.transports.connection import HubConnection, Port
from brickhub.hub.transports.event_loop import LoopRunner
from brickhub.hub.transports.pybricks_hub import ProfileTransport
from bricktwin.site.tab.mailbox_loop import MailboxRunner, Message
from bricktwin.site.tab.web_port import CablePort, HubPage, PagePort, WebPort

_FIRST_SEARCH_S = 20.0
_SEARCH_AGAIN_S = 45.0
"""Time to find a hub again after a loss: its program first has to end, ten seconds later."""
_LOOK_S = 0.2
"""Longest wait for output between two looks at what the person at the page wants."""
_OF_PERSON = ("stop", "go on")
_PORTS: dict[str, Callable[[HubPage], PagePort]] = {"bluetooth": WebPort, "cable": CablePort}
"""Ports by what carries their bytes."""


class WebTransport(ProfileTransport):
    """A :class:`~brickhub.hub.transport.Transport` through the Bluetooth, or the cable, of a page.

    Args:
        page: the page.
        on_look: called between two looks at the link, also while something waits for it.

    Attributes:
        on_person: called, within the loop, with what the person at the page wants: ``stop``, or
            ``go on``.
        by: what carries the bytes of the next connection: ``bluetooth`` or ``cable``.
    """

    def __init__(self, page: HubPage, on_look: Callable[[], None]) -> None:
        super().__init__(timeout_s=_FIRST_SEARCH_S)
        self.on_person: Callable[[str], None] = lambda _: None
        self.by = "bluetooth"
        self._page = page
        self._on_look = on_look
        self._runner: MailboxRunner | None = None
        self._port: PagePort | None = None

    @property
    def connection(self) -> HubConnection | None:
        """The present connection; it may be broken."""
        return self._connection

    @property
    def emergency_stop(self) -> bytes:
        """What the page itself writes to stop the hub of the present connection."""
        return b"" if self._port is None else self._port.stop

    def read(self, timeout_s: float) -> bytes:
        end_s = self.now_s() + timeout_s
        connection = self._require_connection()
        while True:
            left_s = max(0.0, end_s - self.now_s())
            self._run(
                connection.wait_until_readable(min(left_s, _LOOK_S)),
                timeout_s,
                "read what the program says",
            )
            self._on_look()
            if connection.output.is_readable or left_s <= _LOOK_S:
                return connection.output.read(0.0)

    def stop(self) -> None:
        runner = self._runner
        if runner is None or not runner.is_running:
            super().stop()
            return
        # The person at the page stops what waits in the loop now.
        connection = self._connection
        if connection is not None and connection.is_connected:
            self._stopping = runner.loop.create_task(_stopped(connection))

    def attend(self) -> None:
        """Take what the page has sent."""
        self.pause(0.0)

    def pause(self, seconds: float) -> None:
        """Listen to the page for some time."""
        if self._runner is not None:
            self._runner.run(asyncio.sleep(seconds), seconds + _LOOK_S, "listen to the page")

    def _new_loop(self) -> LoopRunner:
        self._runner = MailboxRunner(self._page, self._take)
        return self._runner

    def _take(self, message: Message) -> None:
        if message["kind"] in _OF_PERSON:
            self.on_person(message["kind"])
        elif self._port is not None:
            self._port.take(message)

    def _search_s(self) -> float:
        return _FIRST_SEARCH_S if self._first_hub is None else _SEARCH_AGAIN_S

    async def _find(self, timeout_s: float) -> Port:
        self._on_look()
        self._port = _PORTS[self.by](self._page)
        return self._port


async def _stopped(connection: HubConnection) -> None:
    """Stop the program; a link that is lost meanwhile is noticed by what waits for it."""
    with suppress(HubError):
        await connection.stop_program()
