"""Bluetooth of a page, under the protocol in its worker: the page carries bytes and knows nothing
of them.

Web Bluetooth is the page's alone, so each operation is asked of it by a message, and its answer
comes through the mailbox, as do events of the hub.
"""

import asyncio
import itertools
from collections.abc import Callable
from typing import Protocol

from brickhub.errors import HubBusyError, HubDisconnectedError, HubError
from brickhub.hub.transports.profile import COMMAND_EVENT_UUID
from bricktwin.site.tab.mailbox_loop import Mailbox, Message

_NUMBERS = itertools.count(1)
"""Numbers of operations; they go on from one connection to the next, so that a late answer is
nobody's."""
_GONE = ("NetworkError", "InvalidStateError", "AbortError")
"""Errors of a browser, by name, after which there is no connection."""


class HubPage(Mailbox, Protocol):
    """The page of a real hub, as Python in the worker sees it."""

    def ask(
        self,
        number: int,
        operation: str,
        characteristic: str,
        data: str,
    ) -> None:
        """Begin an operation: ``connect``, ``read``, ``subscribe``, ``write`` or ``close``. A
        message ``answer`` with its number comes, with the ``value``, or the browser's ``error`` and
        its ``message``. Bytes are hexadecimal digits."""


class WebPort:
    """Port of a hub that a person has chosen in the page; a
    :class:`~brickhub.hub.transports.connection.Port`."""

    silence = "switch it off and on, and bring it near"

    def __init__(self, page: HubPage) -> None:
        self.name = ""
        self.address = ""
        self._page = page
        self._waiting: dict[int, asyncio.Future[Message]] = {}
        self._on_event: Callable[[bytes], None] = lambda _: None
        self._on_loss: Callable[[str], None] = lambda _: None

    async def open(
        self,
        on_event: Callable[[bytes], None],
        on_loss: Callable[[str], None],
    ) -> None:
        self._on_event = on_event
        self._on_loss = on_loss
        answer = await self._do("connect to the hub", "connect")
        self.name = answer["name"]
        # No page is told the address of a hub, but the browser has a name of its own for it.
        self.address = answer["id"]

    async def read(self, characteristic: str) -> bytes:
        answer = await self._do("connect to the hub", "read", characteristic)
        return bytes.fromhex(answer["value"])

    async def subscribe(self) -> None:
        await self._do("connect to the hub", "subscribe", COMMAND_EVENT_UUID)

    async def write(
        self,
        command: bytes,
        operation: str,
    ) -> None:
        await self._do(operation, "write", COMMAND_EVENT_UUID, command)

    async def close(self) -> None:
        self._on_event = lambda _: None
        await self._do("disconnect", "close")

    def take(self, message: Message) -> None:
        """Take a message of the page."""
        match message["kind"]:
            case "answer":
                waiting = self._waiting.get(message["number"])
                # Nobody waits any more for what was cancelled.
                if waiting is not None and not waiting.done():
                    waiting.set_result(message)
            case "event":
                self._on_event(bytes.fromhex(message["data"]))
            case "lost":
                self._on_loss("it is out of reach, or was switched off")

    async def _do(
        self,
        purpose: str,
        operation: str,
        characteristic: str = "",
        data: bytes = b"",
    ) -> Message:
        number = next(_NUMBERS)
        waiting = asyncio.get_running_loop().create_future()
        self._waiting[number] = waiting
        try:
            self._page.ask(
                number,
                operation,
                characteristic,
                data.hex(),
            )
            answer: Message = await waiting
        finally:
            del self._waiting[number]
        if answer.get("error"):
            raise _error_of(purpose, operation, answer)
        return answer


def _error_of(
    purpose: str,
    operation: str,
    answer: Message,
) -> HubError:
    """Error of ours for a browser's."""
    said = " ".join(answer["message"].split())
    if operation == "write" and answer["error"] not in _GONE:
        # A hub says why it refuses a command, but a browser does not pass that on. It refuses
        # mostly what comes too early, so the command is tried again, as a busy hub's.
        return HubBusyError(
            f"could not {purpose}: the hub refuses it, and this browser does not tell why "
            f"({said}); stop its program, or update its firmware on code.pybricks.com"
        )
    return HubDisconnectedError(
        f"could not {purpose} ({said}); switch the hub on, bring it near, and close other pages "
        "and programs that are connected to it"
    )
