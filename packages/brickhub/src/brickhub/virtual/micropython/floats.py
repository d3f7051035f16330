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
"""Greatest integer of a hub, whose references keep the lowest bit for themselves."""
SMALL_MIN = -(2**30)
_SINGLE = struct.Struct("<f")
_BITS = struct.Struct("<I")
_EXPONENT_BITS = 0x7F800000
_EXACT_POWERS_OF_FIVE = 10
"""The highest power of five by which the hub divides; 5**10 is exact in single precision."""
_INFINITE_POWER = 60
"""Any power of five from here on is infinite in single precision."""
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
"""Largest mantissa that takes another digit: beyond it, the digits may need more than 32 bits."""
_DECIMAL = re.compile(r"(\d*)(?:\.(\d*))?(?:e([+-]?\d+))?", re.IGNORECASE)
_MAX_DIGITS = 9
"""Digits that tell any two floats of 32 bits apart."""
_SAFE_DIGITS = 6
"""Digits that survive any rounding."""
_BUFFER_CHARS = 33
"""Buffer of the hub for a formatted float, without its last zero byte."""
_REPR_EXPONENT = 16
"""``repr`` writes larger numbers with an exponent."""
_ALL_BEHIND = 255
"""Place of a decimal point that stands before all digits, or behind them."""


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
    # The exponent of a float begins at its 23rd bit. It wraps around, as in C.
    (bits,) = _BITS.unpack(_SINGLE.pack(x))
    exponent_bits = bits + (exponent << 23) & _EXPONENT_BITS
    bits = bits & ~_EXPONENT_BITS | exponent_bits
    (x,) = _SINGLE.unpack(_BITS.pack(bits))
    # Dividing by an exact power rounds once, but 5**-3 would itself be rounded.
    if -_EXACT_POWERS_OF_FIVE <= exponent < 0:
        return to_single(x / 5.0**-exponent)
    power = _ROUGH_POWERS.get(exponent)
    if power is None:
        power = to_single(5.0 ** min(exponent, _INFINITE_POWER))
    return to_single(x * power)


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
    # Without digits, this is infinity or no number.
    if match is None:
        return value
    whole, fraction, written_exponent = match.groups()
    fraction = fraction or ""
    all_digits = whole + fraction
    significant = all_digits.rstrip("0")
    digits = count = 0
    # Digits that do not fit are cut off, not rounded.
    while count < len(significant) and digits < _FULL_MANTISSA:
        digits = 10 * digits + int(significant[count])
        count += 1
    left_out = len(all_digits) - count
    exponent = int(written_exponent or 0) - len(fraction) + left_out
    unsigned_value = scaled(to_single(digits), exponent)
    return math.copysign(unsigned_value, value)


def read_constant(value: float, texts: Collection[str]) -> float:
    """The float that a hub reads for a constant from a compiled program, whose floats are the
    ``texts``."""
    nearest = min(texts, key=lambda text: abs(float(text) - value), default="nan")
    # The compiler's rounding makes the text differ a little.
    is_that = math.isclose(float(nearest), value, rel_tol=1e-14)
    return read_float(nearest if is_that else repr(value))


def float_text(x: float) -> str:
    """``str`` and ``repr`` of a float."""
    text = format_float(x, "g", None)
    # A point, an exponent, or the n of inf and nan shows that a text is no integer.
    return text if any(mark in text for mark in ".en") else text + ".0"


def format_float(
    x: float,
    code: str,
    precision: int | None,
    sign: str = "",
) -> str:
    """``x`` formatted by ``%e``, ``%f`` or ``%g``.

    Args:
        code: one of ``eEfFgG``.
        precision: of the format; ``None`` for as many digits as reading back needs.
        sign: prefix of positive numbers.
    """
    if math.copysign(1, x) < 0 and not math.isnan(x):
        x = -x
        sign = "-"
    if math.isfinite(x):
        width = _BUFFER_CHARS - len(sign)
        text = _unsigned(x, code.lower(), precision, width)
    else:
        text = f"{x:g}"
    return sign + (text.upper() if code.isupper() else text)


def _unsigned(
    x: float,
    kind: str,
    precision: int | None,
    width: int,
) -> str:
    """A positive number formatted by ``%e``, ``%f`` or ``%g`` (``kind``), in a buffer of ``width``
    characters."""
    exponent = _exponent(x)
    if precision is None:
        count = _MAX_DIGITS
        max_exponent = _REPR_EXPONENT
    else:
        count = precision
        max_exponent = min(precision, width - 3)
    # A number that does not fit into the buffer with a point gets an exponent.
    if kind == "f" and exponent > 0 and exponent + count + 2 > width:
        kind = "g"
        count = count + 1

    # `%f` counts the digits behind the point, and `%e` those behind the first one.
    lead_zeros = 0
    if kind == "f":
        count = min(count, width - 3)
        if exponent >= 0:
            count += exponent + 1
        elif count > 2 and exponent < -2:
            # Zeros behind the point need no search.
            lead_zeros = min(-exponent, count) - 2
            count -= lead_zeros
        else:
            count += 1
    elif kind == "e" or count == 0:
        count += 1
    max_digits = min(count, _MAX_DIGITS)
    reserved = 3 if kind == "f" else 7
    zeros = min(count - max_digits, width - max_digits - reserved)

    # The fewest digits that read back as the same float are wanted. Up to the safe number of digits
    # all do, so fewer are not tried.
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
    zeros += max_digits - digits
    return _written(
        mantissa,
        kind,
        digits,
        point,
        lead,
        zeros,
        exponent,
        max_exponent,
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
    # Rounding up may have carried into one more digit, as from 9.99 to 10.0.
    has_carried = mantissa >= 10**digits
    if has_carried and kind == "f":
        digits = digits + 1
        point = point + 1
    elif has_carried:
        mantissa = mantissa // 10
        exponent = exponent + 1

    # For small exponents `%g` writes a point, or zeros, instead of the exponent.
    if kind == "g" and 0 < exponent < max_exponent:
        point = point + exponent
        exponent = 0
        if point >= digits:
            zeros = point - (digits - 1)
    elif kind == "g" and -4 <= exponent < 0:
        written = digits
        while exponent < 0 and mantissa % 10 == 0:
            mantissa = mantissa // 10
            exponent = exponent + 1
            digits = digits - 1
        lead = "0." + "0" * (written - digits - exponent - 1)
        point = _ALL_BEHIND
        exponent = 0

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
    has_exponent = kind == "e" or (exponent and kind != "f")
    return f"{text}e{exponent:+03d}" if has_exponent else text


def _exponent(x: float) -> int:
    """Decimal exponent of the first digit, up to rounding errors of the power."""
    if x == 0:
        return 0
    # The first guess is the binary exponent times log10(2).
    binary_exponent = math.frexp(x)[1] - 1
    exponent = int(binary_exponent * to_single(0.3010299956639812))
    # Powers of ten are computed as on the hub, to be off by as much as there.
    if x >= 1:
        while x >= scaled(1.0, exponent + 1):
            exponent += 1
    else:
        while x < scaled(1.0, exponent):
            exponent -= 1
    return exponent


def _search(
    x: float,
    kind: str,
    digits: int,
    shift: int,
) -> tuple[int, bool]:
    """The mantissa that reads back as ``x`` or nearest to it, with the decimal exponent ``-shift``,
    and whether it does."""

    def difference_of(mantissa: int) -> float:
        # With an exponent there is no place for another digit.
        if mantissa >= 10**digits and kind != "f":
            read_back = read_digits(mantissa // 10, 1 - shift)
        else:
            read_back = read_digits(mantissa, -shift)
        return to_single(read_back - x)

    # Beyond the safe number of digits, the last one or two are left out at first and then searched
    # for.
    extra = digits - _SAFE_DIGITS
    first = 1
    if extra > 0 and shift > 1:
        first = 100 if extra > 1 and shift > 2 else 10
    left_out = len(str(first)) - 1
    rounded = int(to_single(scaled(x, shift - left_out) + 0.5))
    mantissa = first * rounded
    difference = difference_of(mantissa)
    best = mantissa
    best_difference = difference
    # The search moves towards the float and halves its steps, down to 1.
    step = 8**extra if extra > 0 else 1
    for _ in range(3 + 3 * (_MAX_DIGITS - _SAFE_DIGITS)):
        if difference == 0:
            return mantissa, True
        mantissa += step if difference < 0 else -step
        difference = difference_of(mantissa)
        gain = abs(best_difference) - abs(difference)
        # If two are equally near, the one that ends with a zero is better, because that zero is not
        # written.
        is_better = gain > 0 or (gain == 0 and mantissa % 10 == 0)
        if difference and is_better:
            best = mantissa
            best_difference = difference
        if step == 1 and difference:
            return best, False
        step = max(1, step // 2)
    return (mantissa, True) if difference == 0 else (best, False)
