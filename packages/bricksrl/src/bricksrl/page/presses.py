"""Values of presses on a page, which may be anything that JSON can say."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeGuard

from bricksrl.errors import PageError

_MAX_SHOWN = 40


def chosen(noun: str, value: object, names: Iterable[str]) -> str:
    """The value, one of the names. Raises PageError if it is none of them."""
    *others, last = names
    if isinstance(value, str) and value in (*others, last):
        return value
    known = f"{', '.join(others)} or {last}" if others else last
    raise PageError(f"there is no {noun} {value!r:.{_MAX_SHOWN}}; choose {known}")


def is_finite(value: object) -> TypeGuard[int | float]:
    """Whether the value is a finite number."""
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:
        return False
