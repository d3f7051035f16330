"""Numbers as text and back, against CPython where a hub documents the same, and by hand."""

from __future__ import annotations

import math
import struct
from decimal import Decimal

import pytest
from hub_programs import output
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.micropython.floats import (
    SMALL_MAX,
    SMALL_MIN,
    float_text,
    format_float,
    int_from_float,
    read_constant,
    read_float,
    to_single,
)
from brickhub.virtual.micropython.operators import to_int
from brickhub.virtual.micropython.text import format_text, format_value, percent

SINGLES = st.floats(width=32, allow_nan=False, allow_infinity=False, allow_subnormal=False)
USUAL = SINGLES.filter(lambda x: x == 0 or 1e-20 < abs(x) < 1e20)
ALIGNMENTS = ["<", ">", "^", "="]
FILLS = ["", "*", "0", " "]


def units_apart(written: str, exact: str) -> Decimal:
    """Difference of two numbers of equal form in units of the last written digit."""
    mantissa, _, exponent = exact.partition("e")
    _, _, decimals = mantissa.partition(".")
    unit = Decimal(10) ** (int(exponent or 0) - len(decimals))
    return abs(Decimal(written) - Decimal(exact)) / unit


@given(st.integers(-999_999, 999_999), st.integers(-12, 12))
def test_six_digits_are_read_and_written_unchanged(digits: int, exponent: int) -> None:
    """Any two numbers of six digits are different floats of 32 bits."""
    written = f"{digits}e{exponent}"
    shown = float_text(read_float(written))
    assert float(shown) == pytest.approx(float(written), rel=1e-12)
    significant = shown.lstrip("-").partition("e")[0].replace(".", "").strip("0")
    assert len(significant) <= 6


@given(st.integers(-(2**24), 2**24))
def test_whole_floats_end_with_point_zero(number: int) -> None:
    assert float_text(float(number)) == f"{number}.0"


@given(st.integers(-4000, 4000))
def test_eighths_are_exact(eighths: int) -> None:
    value = eighths / 8
    assert float_text(value) == repr(value)
    assert format_float(value, "f", 3) == f"{value:.3f}"
    assert read_float(f"{value}") == value


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0.0"),
        (-0.0, "-0.0"),
        (math.inf, "inf"),
        (-math.inf, "-inf"),
        (math.nan, "nan"),
        (1e-4, "0.0001"),
        (1.5e-4, "0.00015"),
        (9.5e-5, "9.5e-05"),
        (1e-5, "1e-05"),
        (-2.5e-5, "-2.5e-05"),
        (0.001, "0.001"),
        (0.012, "0.012"),
        (999999.0, "999999.0"),
        (1e6, "1000000.0"),
        (1e15, "1000000000000000.0"),
        (1e16, "1e+16"),
        (2.5e20, "2.5e+20"),
        (1e38, "1e+38"),
        (1.5e-38, "1.5e-38"),
    ],
)
def test_text_of_floats(value: float, shown: str) -> None:
    """An exponent is written below 0.0001 and from 1e16 on."""
    assert float_text(to_single(value)) == shown


@given(USUAL, st.integers(0, 5))
def test_exponents_are_written_as_by_python(value: float, digits: int) -> None:
    """Up to one unit of the last digit, as a hub computes in 32 bits."""
    written = format_float(value, "e", digits)
    exact = f"{value:.{digits}e}"
    assert units_apart(written, exact) <= 1
    assert format_float(value, "E", digits) == written.upper()


@given(st.floats(-9000, 9000, width=32), st.integers(0, 2))
def test_fixed_points_are_written_as_by_python(value: float, digits: int) -> None:
    written = format_float(value, "f", digits)
    exact = f"{value:.{digits}f}"
    assert units_apart(written, exact) <= 1
    assert len(written.partition(".")[2]) == digits


@pytest.mark.parametrize(
    ("value", "code", "digits", "sign", "shown"),
    [
        (0.0, "f", 2, "", "0.00"),
        (0.0, "e", 0, "", "0e+00"),
        (0.0, "e", 2, "", "0.00e+00"),
        (0.0, "g", 6, "", "0"),
        (1.5, "f", 0, "", "2"),
        (2.5, "f", 2, "+", "+2.50"),
        (-2.5, "f", 2, "+", "-2.50"),
        (2.5, "f", 1, " ", " 2.5"),
        (9.96, "f", 1, "", "10.0"),
        (9.96, "e", 1, "", "1.0e+01"),
        (9.96, "g", 2, "", "10"),
        (99.6, "g", 2, "", "1e+02"),
        (99.6, "g", 3, "", "99.6"),
        (0.5, "g", 1, "", "0.5"),
        (0.05, "g", 3, "", "0.05"),
        (0.00025, "g", 3, "", "0.00025"),
        (0.000025, "g", 3, "", "2.5e-05"),
        (123456.0, "g", 6, "", "123456"),
        (1234567.0, "g", 6, "", "1.23457e+06"),
        (100000.0, "g", 6, "", "100000"),
        (1000000.0, "g", 6, "", "1e+06"),
        (100.0, "g", 3, "", "100"),
        (1000.0, "g", 3, "", "1e+03"),
        (1.25e10, "e", 3, "", "1.250e+10"),
        (1.25e-10, "e", 2, "", "1.25e-10"),
        (12345.0, "E", 4, "", "1.2345E+04"),
        (math.inf, "f", 2, "+", "+inf"),
        (-math.inf, "F", 2, "", "-INF"),
        (math.nan, "F", 2, "", "NAN"),
        (0.125, "f", 3, "", "0.125"),
        (0.0125, "f", 4, "", "0.0125"),
        (0.00125, "f", 5, "", "0.00125"),
        (0.000125, "f", 6, "", "0.000125"),
        (0.0000128, "f", 6, "", "0.000013"),
        (0.0000125, "f", 3, "", "0.000"),
    ],
)
def test_formatted_floats(value: float, code: str, digits: int, sign: str, shown: str) -> None:
    assert format_float(to_single(value), code, digits, sign) == shown


@pytest.mark.parametrize(
    ("value", "integer"),
    [
        (0.0, 0),
        (2.9, 2),
        (-2.9, -2),
        (1073741760.0, 1073741760),
        (float(SMALL_MIN), SMALL_MIN),
        (float(SMALL_MAX), SMALL_MAX),
    ],
)
def test_floats_become_integers_towards_zero(value: float, integer: int) -> None:
    assert int_from_float(value) == integer


@pytest.mark.parametrize(
    ("value", "kind", "says"),
    [
        (SMALL_MAX + 1.0, ValueError, "float too big"),
        (SMALL_MIN - 1.0, ValueError, "float too big"),
        (math.nan, ValueError, "can't convert NaN to int"),
        (math.inf, OverflowError, "can't convert inf to int"),
        (-math.inf, OverflowError, "can't convert inf to int"),
    ],
)
def test_floats_that_are_no_integer(value: float, kind: type[Exception], says: str) -> None:
    with pytest.raises(kind, match=says):
        int_from_float(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0.0),
        ("1.", 1.0),
        (".5", 0.5),
        ("  -2.5\n", -2.5),
        ("+1e3", 1000.0),
        ("1_000.5", 1000.5),
        ("12e-1", 1.2),
        ("-0", -0.0),
        ("inf", math.inf),
        ("-Infinity", -math.inf),
        ("1e39", math.inf),
        ("1e-60", 0.0),
        ("16777217", 16777216.0),
        ("0.10000000149011612", 0.1),
        ("1000000000000000000000", 1e21),
    ],
)
def test_texts_are_read_as_the_nearest_float(text: str, value: float) -> None:
    read = read_float(text)
    assert read == to_single(value)
    assert math.copysign(1, read) == math.copysign(1, value)


@given(USUAL)
def test_shown_digits_are_read_back_closely(value: float) -> None:
    """Within one step of a float of 32 bits, whose mantissa has 24 bits."""
    read = read_float(float_text(value))
    assert read == pytest.approx(value, rel=2.0**-22)
    assert read_float(repr(value)) == pytest.approx(value, rel=2.0**-21)


def test_a_constant_is_read_by_the_compilers_digits() -> None:
    """The text that is nearest, if it means the same number."""
    texts = ["0.1", "2.5", "1e20"]
    assert read_constant(0.1, texts) == read_float("0.1")
    assert read_constant(2.5000000000000004, texts) == 2.5
    assert read_constant(2.6, texts) == read_float("2.6"), "none of the texts is that number"
    assert read_constant(2.6, []) == read_float("2.6")


# ---- formats


@given(
    st.integers(SMALL_MIN, SMALL_MAX),
    st.sampled_from(["", "d", "b", "o", "x", "X"]),
    st.sampled_from(["", "+", "-", " "]),
    st.sampled_from(["", "#"]),
    st.sampled_from(["", *(fill + align for fill in FILLS for align in ALIGNMENTS)]),
    st.sampled_from(["", "0", "1", "7", "12", "012"]),
)
def test_integers_are_formatted_as_by_python(
    value: int, code: str, sign: str, prefix: str, align: str, width: str
) -> None:
    if width == "0":
        width = ""
    spec = f"{align}{sign}{prefix}{width}{code}"
    assert format_value(value, spec) == format(value, spec)


@given(
    st.text(st.characters(codec="ascii", exclude_characters="\x00"), max_size=9),
    st.sampled_from(["", *(fill + align for fill in FILLS for align in "<>^")]),
    st.integers(0, 12),
    st.integers(-1, 10),
)
def test_texts_are_formatted_as_by_python(
    value: str, align: str, width: int, precision: int
) -> None:
    limit = "" if precision < 0 else f".{precision}"
    spec = f"{align}{width or ''}{limit}s"
    assert format_value(value, spec) == format(value, spec)


@given(
    st.integers(SMALL_MIN, SMALL_MAX),
    st.sampled_from("diuxXo"),
    st.lists(st.sampled_from("-+ #0"), max_size=3, unique=True),
    st.integers(0, 14),
)
def test_integers_after_a_percent_sign_are_as_by_python(
    value: int, code: str, flags: list[str], width: int
) -> None:
    if "-" in flags and "0" in flags:
        flags.remove("0")
    template = f"<%{''.join(flags)}{width or ''}{code}>"
    assert percent(template, value) == template % value


@given(
    st.text(st.characters(codec="ascii", exclude_characters="\x00"), max_size=9),
    st.sampled_from(["", "-"]),
    st.integers(0, 12),
    st.integers(-1, 10),
)
def test_texts_after_a_percent_sign_are_as_by_python(
    value: str, flag: str, width: int, precision: int
) -> None:
    limit = "" if precision < 0 else f".{precision}"
    template = f"<%{flag}{width or ''}{limit}s>"
    assert percent(template, value) == template % value
    assert percent(template.encode(), value.encode()) == template.encode() % value.encode()


@pytest.mark.parametrize(
    ("template", "values", "written"),
    [
        ("%*d|", (5, 42), "   42|"),
        ("%-*d|", (5, 42), "42   |"),
        ("%*d|", (-5, 42), "42|"),
        ("%.*f|", (1, 2.26), "2.3|"),
        ("%*.*f|", (6, 2, 1.5), "  1.50|"),
        ("%.*s|", (2, "abcd"), "ab|"),
        ("%c%c%c", (65, "b", 256 + 67), "AbC"),
        ("%3c|%-3c|", ("a", "b"), "  a|b  |"),
        ("%5.1f|%-6.1f|%06.1f|", (2.5, 2.5, -2.5), "  2.5|2.5   |-002.5|"),
        ("%+.1f|% .1f|%+5.1f|", (2.5, 2.5, 2.5), "+2.5| 2.5| +2.5|"),
        ("%-05d|%-07.1f|", (42, 2.5), "42000|2.50000|"),
        ("%05d|%+05d|% 05d|", (42, 42, 42), "00042|+0042| 0042|"),
        ("%.3d|%6.3d|%-6.3d|", (7, 7, 7), "007|   007|007   |"),
        ("%(a)s %(b)d", {"a": 1, "b": 2, "c": 3}, "1 2"),
        ("%s", ((1, 2),), "(1, 2)"),
        ("%s %r", ("a", "a"), "a 'a'"),
        ("%d %i %u", (1.9, -1.9, True), "1 -1 1"),
        ("%g %G", (1e-5, 1e-5), "1e-05 1E-05"),
        ("100%%", (), "100%"),
    ],
)
def test_percent_signs(template: str, values: object, written: str) -> None:
    assert percent(template, values) == written


@pytest.mark.parametrize(
    ("template", "values", "error", "says"),
    [
        ("%d", (), TypeError, "format string needs more arguments"),
        ("%*d", (1,), TypeError, "format string needs more arguments"),
        ("%d", (1, 2), TypeError, "format string didn't convert all arguments"),
        ("a", 5, TypeError, "format string didn't convert all arguments"),
        ("%*d", ("a", 1), TypeError, "can't convert str to int"),
        ("%", (), ValueError, "incomplete format"),
        ("%5", 1, ValueError, "incomplete format"),
        ("%(a", {"a": 1}, ValueError, "incomplete format key"),
        ("%(a)d", (1,), TypeError, "format needs a dict"),
        ("ab%y", 1, ValueError, r"unsupported format character 'y' \(0x79\) at index 3"),
        ("%5q", 1, ValueError, r"unsupported format character 'q' \(0x71\) at index 2"),
        ("%c", "ab", TypeError, "%c needs int or char"),
        ("%c", "", TypeError, "%c needs int or char"),
        ("%c", 1.5, TypeError, "integer needed"),
        ("%d", "a", TypeError, "can't convert str to int"),
        ("%x", 1.5, TypeError, "can't convert float to int"),
        ("%f", "a", TypeError, "can't convert str to float"),
        ("%d", 1e10, ValueError, "float too big"),
    ],
)
def test_refusals_of_percent_signs(
    template: str, values: object, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=f"^{says}$"):
        percent(template, values)


@pytest.mark.parametrize(
    ("value", "spec", "written"),
    [
        (5, "c", "\x05"),
        (65 + 256, "c", "A"),
        (65, "*>3c", "**A"),
        (1234567, ",", "1,234,567"),
        (1234567, "_", "1_234_567"),
        (0xABCDEF, "_x", "ab_cdef"),
        (0xABCDEF, ",x", "ab,cdef"),
        (0b10101, ",b", "1,0101"),
        (42, "n", "42"),
        (True, "d", "1"),
        (True, "", "True"),
        (True, "5", "    1"),
        (-42, "06", "-00042"),
        (42, "=+6", "+   42"),
        (255, "#06x", "0x00ff"),
        (-255, "#08x", "-0x000ff"),
        (255, "#X", "0XFF"),
        (5, "#b", "0b101"),
        (2.5, "", "2.5"),
        (2.5, "6", "   2.5"),
        (2.5, "<6", "2.5   "),
        (2.5, "06", "0002.5"),
        (-2.5, "07.2f", "-002.50"),
        (2.5, "*=7.1f", "****2.5"),
        (-2.5, "*=7.1f", "-***2.5"),
        (0.256, "%", "25.600000%"),
        (0.256, ".1%", "25.6%"),
        (0.256, ">8.0%", "     26%"),
        (1234.5, "n", "1234.5"),
        (3, ".2f", "3.00"),
        (True, ".1f", "1.0"),
        (16777217, ".0f", "16777216"),
        ("ab", "5", "ab   "),
        ("ab", "05", "ab000"),
        ("ab", ">5", "   ab"),
        ("ab", "^5", " ab  "),
        ("abc", ".2", "ab"),
        ("abc", "*^7.1", "***a***"),
        (b"ab", "4", "ab  "),
        ("\u00e9", "4", "\u00e9  "),
    ],
)
def test_specifications(value: object, spec: str, written: str) -> None:
    """A letter outside ASCII is two bytes, which a hub counts."""
    assert format_value(value, spec) == written


@pytest.mark.parametrize(
    ("value", "spec", "error", "says"),
    [
        (5, "z", ValueError, "invalid format specifier"),
        (5, "5x5", ValueError, "invalid format specifier"),
        ("a", "+s", ValueError, "sign not allowed in string format specifier"),
        (5, "+s", ValueError, "sign not allowed in string format specifier"),
        (5, "+c", ValueError, "sign not allowed with integer format specifier 'c'"),
        ("a", "=5", ValueError, "'=' alignment not allowed in string format specifier"),
        (5, "s", ValueError, "unknown format code 's' for object of type 'int'"),
        (2.5, "d", ValueError, "unknown format code 'd' for object of type 'float'"),
        ("a", "d", ValueError, "unknown format code 'd' for object of type 'str'"),
        ([], "5", TypeError, "can't convert 'list' object to str implicitly"),
        (None, "s", TypeError, "can't convert 'NoneType' object to str implicitly"),
    ],
)
def test_refusals_of_specifications(
    value: object, spec: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=f"^{says}$"):
        format_value(value, spec)


@pytest.mark.parametrize(
    ("template", "args", "kwargs", "written"),
    [
        ("{} {}", (1, "a"), {}, "1 a"),
        ("{1} {0}", (1, 2), {}, "2 1"),
        ("{a} {b}", (), {"a": 1, "b": 2}, "1 2"),
        ("{} {a} {}", (1, 2), {"a": 3}, "1 3 2"),
        ("{!r} {!s}", ("a", "a"), {}, "'a' a"),
        ("{:{}}|", (1, 5), {}, "    1|"),
        ("{:{w}.{p}f}|", (1.5,), {"w": 6, "p": 2}, "  1.50|"),
        ("{{{}}}", (1,), {}, "{1}"),
    ],
)
def test_templates(
    template: str, args: tuple[object, ...], kwargs: dict[str, object], written: str
) -> None:
    assert format_text(template, args, kwargs) == written


@pytest.mark.parametrize(
    ("template", "args", "error", "says"),
    [
        ("{} {}", (1,), IndexError, "tuple index out of range"),
        ("{1}", (1,), IndexError, "tuple index out of range"),
        ("{a}", (), KeyError, "'a'"),
        ("{} {0}", (1,), ValueError, "can't switch from automatic field numbering to manual"),
        ("{0} {}", (1,), ValueError, "can't switch from manual field specification to automatic"),
        ("{0.real}", (1,), NotImplementedError, "attributes not supported"),
        ("{0[0]}", ([1],), NotImplementedError, "attributes not supported"),
        ("{1.real}", (1,), IndexError, "tuple index out of range"),
        ("{!x}", (1,), ValueError, "unknown conversion specifier x"),
    ],
)
def test_refusals_of_templates(
    template: str, args: tuple[object, ...], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=f"^{says}"):
        format_text(template, args, {})


# ---- in programs


@pytest.mark.parametrize(
    ("value", "digits", "rounded"),
    [
        ("2.5", "", "2"),
        ("3.5", "", "4"),
        ("-2.5", "", "-2"),
        ("2.567", ", 1", "2.6"),
        ("-0.04", ", 1", "-0.0"),
        ("1234.5", ", -2", "1200.0"),
        ("2.5", ", 0", "2.0"),
        ("3.5", ", 0", "4.0"),
        ("3e38", ", 2", "inf"),
        ("float('inf')", ", 2", "inf"),
    ],
)
def test_rounding(value: str, digits: str, rounded: str) -> None:
    assert output(f"print(round({value}{digits}))") == rounded


@given(st.integers(SMALL_MIN, SMALL_MAX), st.integers(2, 36))
def test_integers_are_read_in_any_base(value: int, base: int) -> None:
    digits = "0123456789abcdefghijklmnopqrstuvwxyz"
    number = abs(value)
    text = ""
    while number:
        number, digit = divmod(number, base)
        text = digits[digit] + text
    text = ("-" if value < 0 else "") + (text or "0")
    # Digits are read before the sign, so the smallest integer is too large.
    if value == SMALL_MIN:
        return
    assert to_int(text, base) == to_int(f" {text.upper()}\n", base) == value


@given(SINGLES)
def test_floats_have_32_bits(value: float) -> None:
    assert to_single(value) == value
    (rounded,) = struct.unpack("<f", struct.pack("<f", value / 3))
    assert to_single(value / 3) == rounded
