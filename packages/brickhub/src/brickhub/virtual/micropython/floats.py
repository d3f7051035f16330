"""Floats of a hub in single precision: their parsing, their text, their conversion to 31-bit
integers.

Text goes by MicroPython 1.26 (``py/formatfloat.c``): digits are computed in single precision, read
back, and searched nearby for ones that read back as the same float, so the last digits may differ
from CPython's.
"""

import math
import re
import struct
from collections.abc import Collection

SMALL_MAX = 2**30 - 1
SMALL_MIN = -(2**30)
_SINGLE = struct.Struct("<f")
_BITS = struct.Struct("<I")
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
_DECIMAL = re.compile(r"(\d*)(?:\.(\d*))?(?:e([+-]?\d+))?", re.IGNORECASE)
_MAX_DIGITS = 9
_SAFE_DIGITS = 6
_BUFFER_CHARS = 33
_REPR_EXPONENT = 16
_ALL_BEHIND = 255  # no decimal point among the digits


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
    """``x * 10**exponent`` with single precision errors: by a power of two in the bits, then by one
    of five."""
    if exponent == 0 or x == 0:
        return x
    (bits,) = _BITS.unpack(_SINGLE.pack(x))
    bits = bits & ~_EXPONENT_BITS | bits + (exponent << 23) & _EXPONENT_BITS
    (x,) = _SINGLE.unpack(_BITS.pack(bits))
    if -_EXACT_POWERS_OF_FIVE <= exponent < 0:
        return to_single(x / 5.0**-exponent)
    power = _ROUGH_POWERS.get(exponent)
    return to_single(
        x * (to_single(5.0 ** min(exponent, _INFINITE_POWER)) if power is None else power)
    )


def read_digits(digits: int, exponent: int) -> float:
    """The float that a hub reads from ``digits`` and a decimal exponent."""
    while digits and digits % 10 == 0:
        digits = digits // 10
        exponent = exponent + 1
    return scaled(to_single(digits), exponent)


def read_float(text: str) -> float:
    """Parse a float as a hub does: digits that fit into 32 bits, then :func:`scaled`. Raises
    ValueError if the text is not a number."""
    value = float(text)
    unsigned = text.strip().lstrip("+-").replace("_", "")
    match = _DECIMAL.fullmatch(unsigned)
    if match is None:  # inf, nan
        return value
    all_digits = match[1] + (match[2] or "")
    fraction = match[2] or ""
    significant = all_digits.rstrip("0")
    digits = count = 0
    while count < len(significant) and digits < _FULL_MANTISSA:
        digits = 10 * digits + int(significant[count])
        count += 1
    exponent = int(match[3] or 0) - len(fraction) + len(all_digits) - count
    return math.copysign(scaled(to_single(digits), exponent), value)


def read_constant(value: float, texts: Collection[str]) -> float:
    """The float that a hub reads for a constant from a compiled program, whose floats are the
    ``texts``."""
    text = min(texts, key=lambda text: abs(float(text) - value), default="nan")
    # The text differs by the rounding of the compiler.
    return read_float(text if math.isclose(float(text), value, rel_tol=1e-14) else repr(value))


def float_text(x: float) -> str:
    """``str`` and ``repr`` of a float."""
    text = format_float(x, "g", None)
    return text if any(mark in text for mark in ".en") else text + ".0"


def format_float(x: float, code: str, precision: int | None, sign: str = "") -> str:
    """``x`` formatted by ``%e``, ``%f`` or ``%g``.

    Args:
        code: one of ``eEfFgG``.
        precision: of the format; ``None`` for as many digits as reading back needs.
        sign: prefix of positive numbers.
    """
    if math.copysign(1, x) < 0 and not math.isnan(x):
        x = -x
        sign = "-"
    text = (
        f"{x:g}"
        if not math.isfinite(x)
        else _unsigned(x, code.lower(), precision, _BUFFER_CHARS - len(sign))
    )
    return sign + (text.upper() if code.isupper() else text)


def _unsigned(x: float, kind: str, precision: int | None, width: int) -> str:
    """A positive number formatted by ``%e``, ``%f`` or ``%g`` (``kind``), in a buffer of ``width``
    characters."""
    exponent = _exponent(x)
    count = _MAX_DIGITS if precision is None else precision
    max_exponent = _REPR_EXPONENT if precision is None else min(count, width - 3)
    if kind == "f" and exponent > 0 and exponent + count + 2 > width:
        kind = "g"
        count = count + 1
    lead_zeros = 0
    if kind == "f":
        count = min(count, width - 3)
        if exponent >= 0:
            count += exponent + 1
        elif count > 2 and exponent < -2:
            lead_zeros = min(-exponent, count) - 2
            count -= lead_zeros
        else:
            count += 1
    elif kind == "e" or count == 0:
        count += 1
    max_digits = min(count, _MAX_DIGITS)
    zeros = min(count - max_digits, width - max_digits - (3 if kind == "f" else 7))
    for digits in range(min(_SAFE_DIGITS, max_digits), max_digits + 1):
        shift = digits - 1 - exponent
        point = 0
        lead = ""
        if x == 0:
            shift = 0
        elif kind == "f" and exponent >= 0:
            point = exponent
        elif kind == "f":
            shift = digits - 1
            if lead_zeros > 0:
                shift = shift + lead_zeros + 1
                point = _ALL_BEHIND
                lead = "0." + "0" * lead_zeros
        mantissa, is_exact = _search(x, kind, digits, shift)
        if is_exact:
            break
    return _written(
        mantissa, kind, digits, point, lead, zeros + max_digits - digits, exponent, max_exponent
    )


def _written(
    mantissa: int,
    kind: str,
    digits: int,
    point: int,
    lead: str,
    zeros: int,
    exponent: int,
    max_exponent: int,
) -> str:
    """So many digits with a point after the one at index ``point``, a prefix, zeros behind, and the
    exponent of the first digit, for which ``g`` writes zeros up to ``max_exponent``."""
    if mantissa >= 10**digits and kind == "f":
        digits = digits + 1
        point = point + 1
    elif mantissa >= 10**digits:
        mantissa = mantissa // 10
        exponent = exponent + 1
    if kind == "g" and 0 < exponent < max_exponent:
        point = point + exponent
        exponent = 0
        zeros = point - (digits - 1) if point >= digits else zeros
    elif kind == "g" and -4 <= exponent < 0:
        written = digits
        while exponent < 0 and mantissa % 10 == 0:
            mantissa = mantissa // 10
            exponent = exponent + 1
            digits = digits - 1
        point, exponent, lead = _ALL_BEHIND, 0, "0." + "0" * (written - digits - exponent - 1)
    text = f"{mantissa:0{digits}}"[-digits:]
    if point + 1 < digits:
        text = f"{text[: point + 1]}.{text[point + 1 :]}"
    before_point = point + 1 - digits
    if 0 <= before_point < zeros:
        text += "0" * before_point + "." + "0" * (zeros - before_point)
    else:
        text += "0" * zeros
    text = lead + text
    if kind == "g" and "." in text:
        text = text.rstrip("0").rstrip(".")
    return f"{text}e{exponent:+03d}" if kind == "e" or (exponent and kind != "f") else text


def _exponent(x: float) -> int:
    """Decimal exponent of the first digit, up to rounding errors of the power."""
    if x == 0:
        return 0
    exponent = int((math.frexp(x)[1] - 1) * to_single(0.3010299956639812))
    if x >= 1:
        while x >= scaled(1.0, exponent + 1):
            exponent += 1
    else:
        while x < scaled(1.0, exponent):
            exponent -= 1
    return exponent


def _search(x: float, kind: str, digits: int, shift: int) -> tuple[int, bool]:
    """The mantissa that reads back as ``x`` or nearest to it, with the decimal exponent ``-shift``,
    and whether it does."""

    def difference_of(mantissa: int) -> float:
        carries = mantissa >= 10**digits and kind != "f"
        return to_single(
            read_digits(*((mantissa // 10, 1 - shift) if carries else (mantissa, -shift))) - x
        )

    extra = digits - _SAFE_DIGITS
    first = 1
    if extra > 0 and shift > 1:
        first = 100 if extra > 1 and shift > 2 else 10
    mantissa = first * int(to_single(scaled(x, shift - len(str(first)) + 1) + 0.5))
    difference = difference_of(mantissa)
    best = mantissa
    best_difference = difference
    step = 8**extra if extra > 0 else 1
    for _ in range(3 + 3 * (_MAX_DIGITS - _SAFE_DIGITS)):
        if difference == 0:
            return mantissa, True
        mantissa += step if difference < 0 else -step
        difference = difference_of(mantissa)
        gain = abs(best_difference) - abs(difference)
        if difference and (gain > 0 or (gain == 0 and mantissa % 10 == 0)):
            best = mantissa
            best_difference = difference
        if step == 1 and difference:
            return best, False
        step = max(1, step // 2)
    return (mantissa, True) if difference == 0 else (best, False)
