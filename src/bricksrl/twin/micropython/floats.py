"""Single precision floats and how a hub prints them."""

from __future__ import annotations

import math
import struct

_SINGLE = struct.Struct("<f")
SIGNIFICANT_DIGITS = 7


def to_single(x: float) -> float:
    """The nearest 32-bit float; beyond its range, infinity."""
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(x))[0])
    except OverflowError:
        return math.copysign(math.inf, x)


def float_text(x: float) -> str:
    """``str`` and ``repr`` of a float: seven digits, always recognisable as a float."""
    text = f"{x:.{SIGNIFICANT_DIGITS}g}"
    return text if "." in text or "e" in text or "n" in text else text + ".0"


def halves_up(x: float, digits: int) -> float:
    """What ``%f`` with these decimals has to print so that halves round away from zero, as on the hub."""
    if digits < 16 and math.isfinite(x) and (abs(x) * 10**digits) % 1 == 0.5:
        return math.nextafter(x, math.copysign(math.inf, x))
    return x
