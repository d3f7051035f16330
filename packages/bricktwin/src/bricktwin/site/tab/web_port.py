"""Bluetooth and cable of a page, under the protocol in its worker: the page carries bytes and knows
nothing of them.

Web Bluetooth is the page's alone, so each operation is asked of it by a message, and its answer
comes through the mailbox, as do events of the hub. A cable is asked likewise.
"""

import asyncio
import itertools
from collections.abc import Callable
from typing import Protocol

from brickhub.errors import HubBusyError, HubDisconnectedError, HubError
from brickhub.hub.transports.connection import Port
from brickhub.hub.transports.framed_port import LOSS, UNSUBSCRIBED, FramedPort, command_frame
from brickhub.hub.transports.profile import COMMAND_EVENT_UUID, PybricksCommand
from brickhub.hub.transports.usb import PRODUCTS
from bricktwin.site.tab.mailbox_loop import Mailbox, Message

_NUMBERS = itertools.count(1)
"""Numbers of operations; they go on from one connection to the next, so that a late answer is
nobody's."""
_GONE = ("NetworkError", "InvalidStateError", "AbortError")
"""Errors of a browser, by name, after which there is no connection."""
_STOP = bytes((PybricksCommand.STOP_USER_PROGRAM,))


class HubPage(Mailbox, Protocol):
    """The page of a real hub, as Python in the worker sees it."""

    def ask(
        self,
        number: int,
        operation: str,
        characteristic: str,
        data: str,
    ) -> None:
        """Begin an operation: ``connect``, ``read``, ``subscribe``, ``write`` or ``close``; a cable
        has no characteristics, and does not read or subscribe. A message ``answer`` with its number
        comes, with the ``value``, or the browser's ``error`` and its ``message``. Bytes are
        hexadecimal digits."""


class PagePort(Port, Protocol):
    """A port that the page carries.

    Attributes:
        stop: what the page itself writes at an emergency stop, whatever Python does at that moment.
    """

    stop: bytes

    def take(self, message: Message) -> None:
        """Take a message of the page."""


class _Questions:
    """Operations that the page is asked for, and its answers."""

    def __init__(self, page: HubPage) -> None:
        self._page = page
        self._waiting: dict[int, asyncio.Future[Message]] = {}

    async def ask(
        self,
        operation: str,
        characteristic: str = "",
        data: bytes = b"",
    ) -> Message:
        """The page's answer."""
        number = next(_NUMBERS)
        waiting: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._waiting[number] = waiting
        try:
            self._page.ask(
                number,
                operation,
                characteristic,
                data.hex(),
            )
            return await waiting
        finally:
            del self._waiting[number]

    def take(self, answer: Message) -> None:
        """Take an answer."""
        waiting = self._waiting.get(answer["number"])
        # Nobody waits any more for what was cancelled.
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)


class WebPort:
    """Port of a hub with Bluetooth that a person has chosen in the page; a `PagePort`."""

    silence = "switch it off and on, and bring it near"
    stop = _STOP

    def __init__(self, page: HubPage) -> None:
        self.name = ""
        self.address = ""
        self._questions = _Questions(page)
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
                self._questions.take(message)
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
        answer = await self._questions.ask(operation, characteristic, data)
        if answer.get("error"):
            raise _error_of(purpose, operation, answer)
        return answer


class CablePort(FramedPort):
    """Port of a hub on a cable that a person has chosen in the page; a `PagePort`."""

    stop = command_frame(_STOP)

    def __init__(self, page: HubPage) -> None:
        # No page is told which brick is at the other end. As each connection has another address,
        # none believes that it knows the program there.
        super().__init__("", f"cable {next(_NUMBERS)}")
        self._questions = _Questions(page)

    async def close(self) -> None:
        self._on_event = lambda _: None
        # The hub should not write what nobody reads.
        try:
            await self._put(UNSUBSCRIBED, "disconnect")
        finally:
            await self._questions.ask("close")

    def take(self, message: Message) -> None:
        """Take a message of the page."""
        match message["kind"]:
            case "answer":
                self._questions.take(message)
            case "event":
                self._take(bytes.fromhex(message["data"]))
            case "lost":
                self._on_loss(LOSS)

    async def _open(self) -> None:
        answer = await self._do("connect to the hub", "connect")
        self.product = PRODUCTS.get(answer["product"], 0)

    async def _put(
        self,
        frame: bytes,
        operation: str,
    ) -> None:
        await self._do(operation, "write", frame)

    async def _do(
        self,
        purpose: str,
        operation: str,
        data: bytes = b"",
    ) -> Message:
        answer = await self._questions.ask(operation, data=data)
        if answer.get("error"):
            raise HubDisconnectedError(
                f"could not {purpose} ({_said(answer)}); plug the hub in, switch it on, and close "
                "other pages and programs that use it"
            )
        return answer


def _said(answer: Message) -> str:
    """The browser's own words for its error."""
    return " ".join(answer["message"].split())


def _error_of(
    purpose: str,
    operation: str,
    answer: Message,
) -> HubError:
    """Error of ours for a browser's."""
    said = _said(answer)
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
