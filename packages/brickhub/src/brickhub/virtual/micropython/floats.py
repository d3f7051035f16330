"""Single precision floats on a hub, their parsing, and their conversion to its 31-bit integers."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Collection

SMALL_MAX = 2**30 - 1
SMALL_MIN = -(2**30)
_SINGLE, _BITS = struct.Struct("<f"), struct.Struct("<I")
_EXPONENT_BITS = 0x7F800000
_EXACT_POWERS_OF_FIVE = 10
_INFINITE_POWER = 60
_ROUGH_POWERS = {
    11: float.fromhex("0x1.74877p+25"),
    -18: float.fromhex("0x1.2725dcp-42"),
    -22: float.fromhex("0x1.e392p-52"),
    -36: float.fromhex("0x1.544848p-84"),
    -45: float.fromhex("0x1.6d601cp-105"),
    -49: float.fromhex("0x1.2b50c8p-114"),
    -51: float.fromhex("0x1.7f1fb8p-119"),
}
"""Powers of five that a hub's ``powf`` does not round to the nearest float."""
_FULL_MANTISSA = 0x19999998
_INEXACT = 1e-14
"""Relative error of the floats in a compiled program."""
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
    power = _ROUGH_POWERS.get(exponent)
    return to_single(x * (to_single(5.0 ** min(exponent, _INFINITE_POWER)) if power is None else power))


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
    all_digits, fraction = match[1] + (match[2] or ""), match[2] or ""
    significant = all_digits.rstrip("0")
    digits = count = 0
    while count < len(significant) and digits < _FULL_MANTISSA:
        digits = 10 * digits + int(significant[count])
        count += 1
    exponent = int(match[3] or 0) - len(fraction) + len(all_digits) - count
    return math.copysign(scaled(to_single(digits), exponent), value)


def read_constant(value: float, texts: Collection[str]) -> float:
    """The float that a hub reads for a constant from a compiled program, whose floats are the ``texts``."""
    text = min(texts, key=lambda text: abs(float(text) - value), default="nan")
    return read_float(text if math.isclose(float(text), value, rel_tol=_INEXACT) else repr(value))
