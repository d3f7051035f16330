"""Call stack of a hub: how deep the functions of a program can call each other.

Source: the firmware (Pybricks 4.1: ``_common/micropython.c``, ``py/objfun.c``), compiled for each hub with GCC 12 and
``-fstack-usage``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, NamedTuple

from brickhub.robot import HubKind
from brickhub.virtual.micropython.exceptions import is_own


class _Sizes(NamedTuple):
    """Bytes of the stack, which are those that static data leaves of the memory, and of the frames of a call."""

    stack: int
    call: int


_SIZES = {
    HubKind.PRIME: _Sizes(15_412, 208),
    HubKind.ESSENTIAL: _Sizes(36_400, 216),
    HubKind.TECHNIC: _Sizes(22_968, 208),
    HubKind.CITY: _Sizes(6_688, 224),
    HubKind.MOVE: _Sizes(3_528, 232),
}
_KEPT_BYTES = 1024
"""Kept free for what interrupts a program."""
_MAIN_BYTES = 250
"""Before the first line of a program, and to look at the stack."""
_VARIABLES_BYTES = 40
"""Variables of a small function. They take 24 to 64 bytes; those that need more are on the heap."""


def most_nested_calls(hub: HubKind) -> int:
    """How many functions, and the program itself, can wait for each other on a kind of hub."""
    sizes = _SIZES[hub]
    return (sizes.stack - _KEPT_BYTES - _MAIN_BYTES) // (sizes.call + _VARIABLES_BYTES)


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
