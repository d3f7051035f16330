"""Single precision floats on a hub, their parsing, and their conversion to its 31-bit integers."""

from __future__ import annotations

import math
import re
import struct

SMALL_MAX = 2**30 - 1
SMALL_MIN = -(2**30)
_SINGLE, _BITS = struct.Struct("<f"), struct.Struct("<I")
_EXPONENT_BITS = 0x7F800000
_EXACT_POWERS_OF_FIVE = 10
_INFINITE_POWER = 60
_FULL_MANTISSA = 0x19999998
_DECIMAL = re.compile(r"(\d*)(?:\.(\d*))?(?:e([+-]?\d+))?", re.IGNORECASE)


def to_single(x: float) -> float:
    """The nearest 32-bit float; infinity beyond the range."""
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(x))[0])
    except OverflowError:
        return math.copysign(math.inf, x)


def int_from_float(value: float) -> int:
    """``int(value)``."""
    if math.isinf(value):
        raise OverflowError("can't convert inf to int")
    if math.isnan(value):
        raise ValueError("can't convert NaN to int")
    if not SMALL_MIN <= value <= SMALL_MAX:
        raise ValueError("float too big")
    return int(value)


def scaled(x: float, exponent: int) -> float:
    """``x * 10**exponent`` with single precision errors: by a power of two in the bits, then by one of five."""
    if exponent == 0 or x == 0:
        return x
    (bits,) = _BITS.unpack(_SINGLE.pack(x))
    bits = bits & ~_EXPONENT_BITS | bits + (exponent << 23) & _EXPONENT_BITS
    (x,) = _SINGLE.unpack(_BITS.pack(bits))
    if -_EXACT_POWERS_OF_FIVE <= exponent < 0:
        return to_single(x / 5.0**-exponent)
    return to_single(x * to_single(5.0 ** min(exponent, _INFINITE_POWER)))


def read_digits(digits: int, exponent: int) -> float:
    """The float that a hub reads from ``digits`` and a decimal exponent."""
    while digits and digits % 10 == 0:
        digits, exponent = digits // 10, exponent + 1
    return scaled(to_single(digits), exponent)


def read_float(text: str) -> float:
    """Parse a float as a hub does: digits that fit into 32 bits, then :func:`scaled`. Raises ValueError if the text is not a
    number."""
    value = float(text)
    unsigned = text.strip().lstrip("+-").replace("_", "")
    match = _DECIMAL.fullmatch(unsigned)
    if match is None:  # inf, nan
        return value
    integer, fraction = match[1], match[2] or ""
    exponent = int(match[3] or 0) - len(fraction)
    digits = 0
    for index, digit in enumerate(integer + fraction):
        if digits >= _FULL_MANTISSA:
            exponent += len(integer + fraction) - index
            break
        digits = 10 * digits + int(digit)
    return math.copysign(read_digits(digits, exponent), value)
