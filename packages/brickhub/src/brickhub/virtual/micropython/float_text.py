"""Text of floats: the single precision algorithm of MicroPython 1.26 (``py/formatfloat.c``).

Digits are computed in single precision, read back, and searched nearby for ones that read back as the same float, so the last
digits may differ from CPython's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from brickhub.virtual.micropython.floats import read_digits, scaled, to_single

_MAX_DIGITS, _SAFE_DIGITS = 9, 6
_BUFFER_CHARS = 33
_REPR_EXPONENT = 16
_ALL_BEHIND = 255  # no decimal point among the digits


def float_text(x: float) -> str:
    """``str`` and ``repr`` of a float."""
    text = shortest_text(x)
    return text if any(mark in text for mark in ".en") else text + ".0"


def shortest_text(x: float) -> str:
    """Without ``.0`` for whole numbers, as in complex numbers."""
    return format_float(x, "g", None)


def format_float(x: float, code: str, precision: int | None, sign: str = "") -> str:
    """``x`` formatted by ``%e``, ``%f`` or ``%g``.

    Args:
        code: one of ``eEfFgG``.
        precision: of the format; ``None`` for as many digits as reading back needs.
        sign: prefix of positive numbers.
    """
    if math.copysign(1, x) < 0 and not math.isnan(x):
        x, sign = -x, "-"
    text = f"{x:g}" if not math.isfinite(x) else _unsigned(x, code.lower(), precision, _BUFFER_CHARS - len(sign))
    return sign + (text.upper() if code.isupper() else text)


@dataclass(frozen=True)
class _Layout:
    """Layout of the digits.

    Attributes:
        kind: ``e``, ``f`` or ``g``.
        digits: number of digits.
        point: index of the digit before the decimal point.
        lead: prefix of the digits.
        zeros: number of trailing zeros.
        exponent: of the first digit.
        max_exponent: largest exponent for which ``g`` writes zeros.
    """

    kind: str
    digits: int
    point: int
    lead: str
    zeros: int
    exponent: int
    max_exponent: int

    def write(self, mantissa: int) -> str:
        exponent, digits, point, lead, zeros = self.exponent, self.digits, self.point, self.lead, self.zeros
        if mantissa >= 10**digits:
            if self.kind == "f":
                digits, point = digits + 1, point + 1
            else:
                mantissa, exponent = mantissa // 10, exponent + 1
        if self.kind == "g" and 0 < exponent < self.max_exponent:
            point, exponent = point + exponent, 0
            if point >= digits:
                zeros = point - (digits - 1)
        elif self.kind == "g" and -4 <= exponent < 0:
            while exponent < 0 and mantissa % 10 == 0:
                mantissa, exponent, digits = mantissa // 10, exponent + 1, digits - 1
            lead = "0." + "0" * (self.digits - digits - exponent - 1)
            point, exponent = _ALL_BEHIND, 0
        text = f"{mantissa:0{digits}}"[-digits:]
        if point + 1 < digits:
            text = f"{text[: point + 1]}.{text[point + 1 :]}"
        before_point = point + 1 - digits
        if 0 <= before_point < zeros:
            text += "0" * before_point + "." + "0" * (zeros - before_point)
        else:
            text += "0" * zeros
        text = lead + text
        if self.kind == "g" and "." in text:
            text = text.rstrip("0").rstrip(".")
        if self.kind == "e" or (exponent and self.kind != "f"):
            text += f"e{exponent:+03d}"
        return text

    def value(self, mantissa: int, shift: int) -> float:
        """The float that a hub reads from `write`, for ``mantissa`` times 10 to the power of ``-shift``."""
        if mantissa >= 10**self.digits and self.kind != "f":
            return read_digits(mantissa // 10, 1 - shift)
        return read_digits(mantissa, -shift)


def _unsigned(x: float, kind: str, precision: int | None, width: int) -> str:
    exponent = _exponent(x)
    count = _MAX_DIGITS if precision is None else precision
    max_exponent = _REPR_EXPONENT if precision is None else min(count, width - 3)
    if kind == "f" and exponent > 0 and exponent + count + 2 > width:
        kind, count = "g", count + 1
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
        layout = _Layout(kind, digits, 0, "", zeros + max_digits - digits, exponent, max_exponent)
        shift = digits - 1 - exponent
        if x == 0:
            shift = 0
        elif kind == "f" and exponent >= 0:
            layout = replace(layout, point=exponent)
        elif kind == "f":
            shift = digits - 1
            if lead_zeros > 0:
                shift += lead_zeros + 1
                layout = replace(layout, lead="0." + "0" * lead_zeros, point=_ALL_BEHIND)
        mantissa, is_exact = _search(x, layout, shift)
        if is_exact:
            break
    return layout.write(mantissa)


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


def _search(x: float, layout: _Layout, shift: int) -> tuple[int, bool]:
    """The mantissa that reads back as ``x`` or nearest to it, and whether it does."""
    extra = layout.digits - _SAFE_DIGITS
    first = 1
    if extra > 0 and shift > 1:
        first = 100 if extra > 1 and shift > 2 else 10
    mantissa = first * int(to_single(scaled(x, shift - len(str(first)) + 1) + 0.5))
    difference = to_single(layout.value(mantissa, shift) - x)
    best, best_difference = mantissa, difference
    step = 8**extra if extra > 0 else 1
    for _ in range(3 + 3 * (_MAX_DIGITS - _SAFE_DIGITS)):
        if difference == 0:
            return mantissa, True
        mantissa += step if difference < 0 else -step
        difference = to_single(layout.value(mantissa, shift) - x)
        gain = abs(best_difference) - abs(difference)
        if difference and (gain > 0 or (gain == 0 and mantissa % 10 == 0)):
            best, best_difference = mantissa, difference
        if step == 1 and difference:
            return best, False
        step = max(1, step // 2)
    return (mantissa, True) if difference == 0 else (best, False)
