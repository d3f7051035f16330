"""Episodes on the page until they are ended, through emergency stops, resets and lost links."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from bricksrl.envs.env_interface import interface_of
from bricksrl.errors import BricksError, StoppedError
from bricksrl.page.live import LivePage

_COAST_MS = 500
"""Simulated time for which the coasting motors are shown after a stop."""


def play_endlessly(
    env: Any, page: LivePage, episode: Callable[[str], float | None], *, episodes: int | None, stop: threading.Event
) -> list[float]:
    """Play a number of episodes, or endlessly; returns the returns of the complete ones. Raises StoppedError if the robot was
    stopped, and ``stop`` is set.

    Args:
        episode: plays one, given its number; its return, or ``None`` if it was cut short.
        stop: set if a stop is to end the playing, as by a key in the terminal.
    """
    returns: list[float] = []
    page.attach(env)
    while episodes is None or len(returns) < episodes:
        number = f"{len(returns) + 1}"
        try:
            page.begin()
            return_ = episode(number)
            if return_ is not None:
                returns.append(return_)
                page.end(return_, number)
        except BricksError as error:
            message = f"{error}. Reset tries again."
            if isinstance(error, StoppedError):
                if stop.is_set():
                    raise
                message = "The robot was stopped by hand. Reset lets it start again."
                page.mark_stopped()
                env.close(raise_if_closed=False)  # a virtual hub ends its program in this thread only
                if (twin := interface_of(env).twin) is not None:
                    for _ in range(_COAST_MS // 10):
                        twin.machine.advance(10)
                        time.sleep(0.01)
            page.board.update_status(message=message)
            page.wait_for_reset(stop.is_set)
            if stop.is_set():
                raise StoppedError("the robot was stopped by hand") from error
            page.release()
            page.board.update_status(message="")
    return returns
