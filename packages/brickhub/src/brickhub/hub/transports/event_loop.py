"""Asyncio event loop in a background thread, for use from synchronous code."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar

from brickhub.errors import HubError, HubTimeoutError

_T = TypeVar("_T")
_GRACE_S = 1.0


class EventLoopThread:
    """Thread that runs coroutines for other threads, with a timeout on every call."""

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name=name, daemon=True)
        self._thread.start()

    def run(self, coroutine: Coroutine[Any, Any, _T], timeout_s: float, operation: str) -> _T:
        """Run a coroutine and return its result; it is cancelled after ``timeout_s``.

        Raises:
            HubTimeoutError: it took longer; ``operation`` describes it in the message.
            HubError: the loop is closed.
        """
        try:
            future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        except RuntimeError:
            coroutine.close()
            raise HubError(f"could not {operation}: the link is closed; open it again") from None
        try:
            return future.result(timeout_s)
        except concurrent.futures.CancelledError:
            raise HubError(f"could not {operation}: the link was closed meanwhile; open it again") from None
        except concurrent.futures.TimeoutError:
            if future.done():
                raise
            raise HubTimeoutError(f"could not {operation} within {timeout_s:g} s; switch the hub off and on") from None
        finally:
            future.cancel()

    def close(self) -> None:
        """Cancel all coroutines and end the thread; one that does not end is left behind as a daemon."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2 * _GRACE_S)

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            if tasks:
                self._loop.run_until_complete(asyncio.wait(tasks, timeout=_GRACE_S))
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        finally:
            self._loop.close()
