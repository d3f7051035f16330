"""Event loop of a link, for callers that know nothing of asyncio."""

import asyncio
import concurrent.futures
import contextlib
import threading
from collections.abc import Coroutine
from typing import Any, Protocol, TypeVar

from brickhub import errors
from brickhub.futures import is_done, settle

_T = TypeVar("_T")
_THREAD_END_S = 1.0
"""Time in which cancelled coroutines have to end."""


class LoopRunner(Protocol):
    """What runs coroutines, with a timeout on every call."""

    def run(
        self,
        coroutine: Coroutine[Any, Any, _T],
        timeout_s: float,
        operation: str,
    ) -> _T:
        """Run a coroutine and return its result; it is cancelled after ``timeout_s``. Raises
        HubTimeoutError if it took longer; ``operation`` describes it in the message."""

    def close(self) -> None:
        """Cancel all coroutines, and run none any more."""


class EventLoopThread:
    """Thread that runs coroutines for other threads, with a timeout on every call."""

    def __init__(self, name: str) -> None:
        # The thread is a daemon, so that a backend that hangs does not keep a program from ending.
        made: concurrent.futures.Future[asyncio.AbstractEventLoop] = concurrent.futures.Future()
        self._thread = threading.Thread(
            target=self._serve,
            args=(made,),
            name=name,
            daemon=True,
        )
        self._thread.start()
        self._loop = made.result()

    def run(
        self,
        coroutine: Coroutine[Any, Any, _T],
        timeout_s: float,
        operation: str,
    ) -> _T:
        """Run a coroutine and return its result; it is cancelled after ``timeout_s``.

        Raises:
            HubTimeoutError: it took longer; ``operation`` describes it in the message.
            HubError: the loop is closed.
        """
        try:
            future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        except RuntimeError:
            # Python would warn about a coroutine that was never awaited.
            coroutine.close()
            raise errors.HubError(
                f"could not {operation}: the link is closed; open it again"
            ) from None
        try:
            if not is_done(future, timeout_s):
                raise errors.HubTimeoutError(
                    f"could not {operation} within {timeout_s:g} s; switch the hub off and on"
                )
            return future.result()
        except concurrent.futures.CancelledError:
            raise errors.HubError(
                f"could not {operation}: the link was closed meanwhile; open it again"
            ) from None
        finally:
            # The call is cancelled even if Ctrl-C interrupts the wait; on one that is done this has
            # no effect.
            future.cancel()

    def close(self) -> None:
        """Cancel all coroutines and end the thread; one that does not end is left behind as a
        daemon."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2 * _THREAD_END_S)

    def _serve(self, made: concurrent.futures.Future[asyncio.AbstractEventLoop]) -> None:
        # The loop is made in this thread, because on Windows one made in the main thread would take
        # the signals of a command.
        settle(made, asyncio.new_event_loop)
        if made.exception() is not None:
            return
        loop = made.result()
        asyncio.set_event_loop(loop)
        try:
            loop.run_forever()
            # The loop was stopped: what still runs is cancelled and gets its time to disconnect.
            tasks = asyncio.all_tasks(loop)
            for task in tasks:
                task.cancel()
            if tasks:
                loop.run_until_complete(asyncio.wait(tasks, timeout=_THREAD_END_S))
            loop.run_until_complete(loop.shutdown_asyncgens())
        finally:
            loop.close()
