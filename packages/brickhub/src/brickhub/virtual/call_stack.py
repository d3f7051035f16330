"""Call stack of a hub: how deep the functions of a program can call each other.

Source: the firmware (Pybricks 4.1: ``_common/micropython.c``, ``py/objfun.c``).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

from brickhub.robot import HubKind
from brickhub.virtual.micropython.exceptions import is_own

_KEPT_BYTES = 1024
"""Kept free for what interrupts a program."""
_MAIN_BYTES = 250
"""Before the first line of a program, and to look at the stack."""
_VARIABLES_BYTES = 40
"""Variables of a small function. They take 24 to 64 bytes; those that need more are on the heap."""


def most_nested_calls(hub: HubKind) -> int:
    """How many functions, and the program itself, can wait for each other on a kind of hub."""
    return (hub.model.stack_bytes - _KEPT_BYTES - _MAIN_BYTES) // (hub.model.call_bytes + _VARIABLES_BYTES)


def check_of_calls(most: int) -> Callable[[Any], Any]:
    """A function that returns its argument, which is called next. It raises RuntimeError if that is a function of the program
    and ``most`` calls are nested already."""

    def callee(function: Any) -> Any:
        if is_own(getattr(function, "__func__", function)):
            nested = 0
            frame: FrameType | None = sys._getframe(1)
            while frame is not None:
                nested += "@n" in frame.f_builtins
                frame = frame.f_back
            if nested >= most:
                raise RuntimeError("maximum recursion depth exceeded")
        return function

    return callee
