"""Single precision floats and how a hub prints them."""

from __future__ import annotations

import math
import struct

_SINGLE = struct.Struct("<f")
_FEWEST_DIGITS, _MOST_DIGITS = 6, 9


def to_single(x: float) -> float:
    """The nearest 32-bit float; beyond its range, infinity."""
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(x))[0])
    except OverflowError:
        return math.copysign(math.inf, x)


def float_text(x: float) -> str:
    """``str`` and ``repr`` of a float: the shortest text that reads back as the same 32-bit float, as firmware 4.1 prints it.

    Exponents appear from 1e16 on and below 1e-4, as in CPython.
    """
    if not math.isfinite(x):
        return f"{x:g}"
    for digits in range(_FEWEST_DIGITS, _MOST_DIGITS + 1):
        shortest = float(f"{x:.{digits}g}")
        if to_single(shortest) == x:
            break
    return repr(shortest)


def halves_up(x: float, digits: int) -> float:
    """What ``%f`` with these decimals has to print so that halves round away from zero, as on the hub."""
    if digits < 16 and math.isfinite(x) and (abs(x) * 10**digits) % 1 == 0.5:
        return math.nextafter(x, math.copysign(math.inf, x))
    return x
