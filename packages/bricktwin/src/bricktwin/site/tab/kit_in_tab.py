"""Virtual devices of LEGO's kits in a tab: LEGO's own package, the program and the world in one
thread.

In a browser the package waits by ``run_sync`` of Pyodide, which not every browser can. Here a loop
of asyncio takes its place, whose time is that of the devices: while the package waits, the world
goes on.
"""

import asyncio
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from brickhub.errors import HubTimeoutError
from brickhub.kits.virtual_kit import Delivery, VirtualKit
from bricktwin.site.tab.mailbox_loop import alone

_T = TypeVar("_T")
_LONGEST_STEP_S = 60.0
"""Longest time in which nothing arrives, when nothing else is planned."""


class OneThreadKit(VirtualKit):
    """A :class:`VirtualKit` without threads: its world goes on while the program waits."""

    limit_s: float | None = None

    def run(
        self,
        function: Callable[[], _T],
        limit_s: float | None = None,
    ) -> _T:
        """Run a function that uses LEGO's package. Raises HubTimeoutError after ``limit_s``."""
        self.limit_s = None if limit_s is None else self.now_s() + limit_s
        self._world = _WorldLoop(self)
        try:
            with waiting_by(self._until):
                return function()
        finally:
            self._world.close()

    def wait(self, seconds: float) -> None:
        self._until(asyncio.sleep(seconds))

    def _until(self, coroutine: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine of the package to its end."""
        with alone():
            return self._world.run_until_complete(coroutine)


class _WorldLoop(asyncio.BaseEventLoop):
    """An event loop in the time of virtual devices."""

    def __init__(self, kit: OneThreadKit) -> None:
        super().__init__()
        self._kit = kit
        # What the loop waits in is its own world.
        self._selector = self
        self._tasks: set[asyncio.Task[Any]] = set()

    def time(self) -> float:
        return self._kit.now_s()

    def select(self, timeout_s: float | None) -> list[Delivery]:
        """Let the world go on until something arrives, or the time is over."""
        kit = self._kit
        end_s = self.time() + (_LONGEST_STEP_S if timeout_s is None else timeout_s)
        while self.time() < end_s:
            arrived = kit.step()
            if kit.limit_s is not None and self.time() >= kit.limit_s:
                raise HubTimeoutError("the time limit of the program is over")
            if arrived:
                return arrived
        return []

    def _process_events(self, event_list: list[Delivery]) -> None:
        for notify, packet in event_list:
            task = self.create_task(notify(None, packet))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)


@contextmanager
def waiting_by(wait: Callable[[Coroutine[Any, Any, Any]], Any]) -> Iterator[None]:
    """Context in which Pyodide's ``run_sync`` is this function."""
    ffi: Any = sys.modules["pyodide.ffi"]
    before = ffi.run_sync
    ffi.run_sync = wait
    try:
        yield
    finally:
        ffi.run_sync = before
