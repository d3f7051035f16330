"""Event loop of a worker: while it waits it sleeps in the worker's mailbox, into which the page
puts what happens.

A worker that runs Python hears no event of the browser until Python ends. This loop hears the page
meanwhile, so that what is written for asyncio, and what waits for it, run in a tab unchanged.
"""

import asyncio
import json
import math
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from brickhub.errors import HubError, HubTimeoutError

_T = TypeVar("_T")
_LONGEST_WAIT_MS = 1000.0
"""Longest sleep; a loop with nothing to do looks again after it."""

Message = Mapping[str, Any]


class Mailbox(Protocol):
    """The mailbox, as Python in the worker sees it."""

    def take(self) -> str:
        """What has come since the last call: a JSON list of messages, empty for none."""

    def wait(self, longest_ms: float) -> None:
        """Wait until something has come, at most so long."""


class _Waiting:
    """What an event loop of asyncio waits in."""

    def __init__(self, mailbox: Mailbox) -> None:
        self._mailbox = mailbox

    def select(self, timeout_s: float | None) -> list[Message]:
        """Messages, as soon as there are some or the time is up."""
        longest_ms = math.inf if timeout_s is None else 1000.0 * timeout_s
        sent = self._mailbox.take()
        if not sent and longest_ms > 0:
            self._mailbox.wait(min(longest_ms, _LONGEST_WAIT_MS))
            sent = self._mailbox.take()
        return json.loads(sent) if sent else []


class MailboxLoop(asyncio.BaseEventLoop):
    """An event loop that waits in a mailbox.

    Args:
        mailbox: the mailbox.
        on_message: called, within the loop, with each message of the page.
    """

    def __init__(self, mailbox: Mailbox, on_message: Callable[[Message], None]) -> None:
        super().__init__()
        self._selector = _Waiting(mailbox)
        self._on_message = on_message

    def _process_events(self, event_list: list[Message]) -> None:
        for message in event_list:
            self._on_message(message)


class MailboxRunner:
    """Runs coroutines of one link in a `MailboxLoop`; a
    :class:`~brickhub.hub.transports.event_loop.LoopRunner`."""

    def __init__(self, mailbox: Mailbox, on_message: Callable[[Message], None]) -> None:
        self.loop = MailboxLoop(mailbox, on_message)

    @property
    def is_running(self) -> bool:
        """Whether this is a call from within the loop."""
        return self.loop.is_running()

    def run(
        self,
        coroutine: Coroutine[Any, Any, _T],
        timeout_s: float,
        operation: str,
    ) -> _T:
        """Run a coroutine and return its result; it is cancelled after ``timeout_s``. Raises
        HubTimeoutError if it took longer; ``operation`` describes it in the message."""
        if self.loop.is_closed():
            # Python would warn about a coroutine that was never awaited.
            coroutine.close()
            raise HubError(f"could not {operation}: the link is closed; open it again")

        async def limited() -> _T:
            async with asyncio.timeout(timeout_s):
                return await coroutine

        with alone():
            try:
                return self.loop.run_until_complete(limited())
            except TimeoutError as error:
                # A HubTimeoutError is also a TimeoutError, but has its reason already.
                if isinstance(error, HubError):
                    raise
                raise HubTimeoutError(
                    f"could not {operation} within {timeout_s:g} s; switch the hub off and on"
                ) from None

    def close(self) -> None:
        """Cancel all coroutines, and run none any more."""
        if self.loop.is_closed():
            return
        with alone():
            tasks = asyncio.all_tasks(self.loop)
            for task in tasks:
                task.cancel()
            if tasks:
                self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self.loop.close()


@contextmanager
def alone() -> Iterator[None]:
    """Context without the loop of the browser, which runs all the time, and in which no other one
    could run."""
    before = asyncio._get_running_loop()
    asyncio._set_running_loop(None)
    try:
        yield
    finally:
        asyncio._set_running_loop(before)
