"""Futures between threads: one computes, another waits for it and can be interrupted meanwhile."""

import concurrent.futures
import math
import time
from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")
_PIECE_S = 0.2
"""Longest wait in which a Ctrl-C is not noticed on Windows."""


def is_done(future: concurrent.futures.Future[Any], limit_s: float | None) -> bool:
    """Whether a future is done, or is so within a time; ``None`` for no limit. The wait is in
    pieces, as Windows tells of a Ctrl-C only when one is over."""
    end_s = math.inf if limit_s is None else time.monotonic() + limit_s
    while not future.done():
        left_s = end_s - time.monotonic()
        if left_s <= 0.0:
            break
        concurrent.futures.wait([future], min(left_s, _PIECE_S))
    # The future may have ended within the last piece, so it is asked once more.
    return future.done()


def settle(future: concurrent.futures.Future[_T], function: Callable[[], _T]) -> None:
    """Call a function in this thread, for another one that waits for what it returns or raises."""
    try:
        future.set_result(function())
    except BaseException as error:  # noqa: BLE001  raised again in the thread that waits for it
        future.set_exception(error)
