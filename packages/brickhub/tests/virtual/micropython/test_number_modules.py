"""Modules `struct`, `random` and `math`: sizes, edges of buffers and ranges, refusals."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from brickhub.virtual.micropython.floats import to_single
from brickhub.virtual.micropython.numbers import math_module, random_module, struct_module
from brickhub.virtual.micropython.operators import operators

STRUCT = struct_module()
MATH = math_module()
BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "l": 32, "L": 32, "q": 64, "Q": 64}


@pytest.mark.parametrize("order", ["<", ">", "!"])
@pytest.mark.parametrize(
    "codes", ["b", "H", "i", "L", "q", "e", "f", "d", "5s", "3x", "2hb", "xbHi"]
)
def test_standard_sizes_are_those_of_python(order: str, codes: str) -> None:
    assert STRUCT.calcsize(order + codes) == struct.calcsize(order + codes)


@pytest.mark.parametrize(
    ("layout", "size"),
    [
        ("l", 4),
        ("L", 4),
        ("@l", 4),
        ("P", 4),
        ("O", 4),
        ("bl", 8),
        ("hl", 8),
        ("bh", 4),
        ("<bl", 5),
    ],
)
def test_native_sizes_are_those_of_32_bits(layout: str, size: int) -> None:
    assert STRUCT.calcsize(layout) == size


@given(
    st.sampled_from(sorted(BITS)),
    st.one_of(st.integers(-(2**30), 2**30 - 1), st.integers(-300, 300), st.integers(-70000, 70000)),
)
def test_integers_wrap_around(code: str, value: int) -> None:
    """Its lowest bytes are written."""
    size = BITS[code] // 8
    low = value & (1 << BITS[code]) - 1
    assert STRUCT.pack(f"<{code}", value) == low.to_bytes(size, "little")
    assert STRUCT.pack(f">{code}", value) == low.to_bytes(size, "big")


@pytest.mark.parametrize(
    ("layout", "values", "data"),
    [
        ("<h", (), b"\0\0"),
        ("<hh", (1,), b"\1\0\0\0"),
        ("<h", (1, 2, 3), b"\1\0"),
        ("<2b", (1, 2), b"\1\2"),
        ("<3s", (b"ab",), b"ab\0"),
        ("<2s", (b"abc",), b"ab"),
        ("<2s", ("ab",), b"ab"),
        ("<bxb", (1, 2), b"\1\0\2"),
        ("<e", (1.5,), struct.pack("<e", 1.5)),
        ("<e", (65519.0,), struct.pack("<e", 65504.0)),
        ("<e", (65520.0,), struct.pack("<e", math.inf)),
        ("<e", (-70000.0,), struct.pack("<e", -math.inf)),
        ("<f", (3.5e38,), struct.pack("<f", math.inf)),
        ("<f", (2,), struct.pack("<f", 2.0)),
        ("<d", (0.1,), struct.pack("<d", 0.1)),
    ],
)
def test_packed_values(layout: str, values: tuple[Any, ...], data: bytes) -> None:
    """Missing values are zero, further ones are ignored, and what is too large is infinite."""
    assert STRUCT.pack(layout, *values) == data


@pytest.mark.parametrize(
    ("layout", "value", "says"),
    [
        ("<h", 1.5, "can't convert float to int"),
        ("<h", None, "can't convert NoneType to int"),
        ("<f", "a", "can't convert str to float"),
    ],
)
def test_values_that_cannot_be_packed(layout: str, value: Any, says: str) -> None:
    with pytest.raises(TypeError, match=says):
        STRUCT.pack(layout, value)


@pytest.mark.parametrize("layout", ["<z", "h<", "5", "<h ", "\u00e4"])
def test_unknown_layouts(layout: str) -> None:
    with pytest.raises(ValueError, match="bad typecode"):
        STRUCT.calcsize(layout)


def test_layouts_are_texts_or_bytes() -> None:
    assert STRUCT.calcsize(b"<hb") == 3
    with pytest.raises(TypeError, match="can't convert 'int' object to str implicitly"):
        STRUCT.calcsize(5)


@pytest.mark.parametrize(
    ("offset", "data"),
    [
        (0, b"\1\2\0\0"),
        (1, b"\0\1\2\0"),
        (2, b"\0\0\1\2"),
        (-2, b"\0\0\1\2"),
        (-3, b"\0\1\2\0"),
        (-4, b"\1\2\0\0"),
    ],
)
def test_packing_into_a_buffer(offset: int, data: bytes) -> None:
    buffer = bytearray(4)
    STRUCT.pack_into("<bb", buffer, offset, 1, 2)
    assert buffer == data


@pytest.mark.parametrize("offset", [3, 4, -1, -5])
def test_a_buffer_that_is_too_small_stays_as_it_was(offset: int) -> None:
    buffer = bytearray(4)
    with pytest.raises(ValueError, match="buffer too small"):
        STRUCT.pack_into("<bb", buffer, offset, 1, 2)
    assert buffer == bytes(4)
    with pytest.raises(TypeError, match="object with buffer protocol required"):
        STRUCT.pack_into("<bb", b"1234", 0, 1, 2)


@pytest.mark.parametrize(
    ("layout", "offset", "values"),
    [
        ("<h", 0, (0x0201,)),
        ("<h", 2, (0x0403,)),
        (">h", 1, (0x0203,)),
        ("<b", -1, (4,)),
        ("<2s", 1, (b"\2\3",)),
        ("<bxb", 0, (1, 3)),
    ],
)
def test_unpacking(layout: str, offset: int, values: tuple[Any, ...]) -> None:
    assert STRUCT.unpack_from(layout, b"\1\2\3\4", offset) == values


@pytest.mark.parametrize("offset", [3, 4, -1, -5])
def test_unpacking_beyond_the_end(offset: int) -> None:
    with pytest.raises(ValueError, match="buffer too small"):
        STRUCT.unpack_from("<h", b"\1\2\3\4", offset)


def test_unpacked_numbers_are_those_of_a_hub() -> None:
    assert STRUCT.unpack("<i", struct.pack("<i", 2**30 - 1)) == (2**30 - 1,)
    assert STRUCT.unpack("<i", struct.pack("<i", -(2**30))) == (-(2**30),)
    for value in (2**30, -(2**30) - 1):
        with pytest.raises(OverflowError, match="small int overflow"):
            STRUCT.unpack("<i", struct.pack("<i", value))
    assert STRUCT.unpack("<d", struct.pack("<d", 0.1)) == (to_single(0.1),)
    assert STRUCT.unpack("<h", "ab") == (0x6261,)


# ---- random


def drawn(draw: Callable[[ModuleType], Any], count: int = 400) -> list[Any]:
    source = random_module(5)
    return [draw(source) for _ in range(count)]


@pytest.mark.parametrize(
    ("arguments", "values"),
    [
        ((4,), {0, 1, 2, 3}),
        ((1,), {0}),
        ((-2, 3), {-2, -1, 0, 1, 2}),
        ((0, 10, 3), {0, 3, 6, 9}),
        ((0, 9, 3), {0, 3, 6}),
        ((10, 0, -3), {10, 7, 4, 1}),
        ((10, 1, -3), {10, 7, 4}),
        ((5, 6, 100), {5}),
        ((0, -2, -1), {0, -1}),
    ],
)
def test_a_drawn_number_is_one_of_the_range(arguments: tuple[int, ...], values: set[int]) -> None:
    assert values == set(range(*arguments))
    assert set(drawn(lambda source: source.randrange(*arguments))) == values


@pytest.mark.parametrize(
    "arguments", [(0,), (-1,), (5, 5), (5, 4), (0, 5, -1), (5, 0, 1), (0, 5, 0)]
)
def test_an_empty_range_has_no_number(arguments: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="^$"):
        random_module(1).randrange(*arguments)


@pytest.mark.parametrize("arguments", [(1.0,), (1, 2.0), (1, 2, 1.0), ("a",), (None,)])
def test_ranges_are_of_integers(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(TypeError, match="can't convert"):
        random_module(1).randrange(*arguments)


def test_both_ends_are_drawn() -> None:
    assert set(drawn(lambda source: source.randint(-1, 1))) == {-1, 0, 1}
    assert set(drawn(lambda source: source.randint(7, 7))) == {7}
    with pytest.raises(ValueError, match="^$"):
        random_module(1).randint(2, 1)


@pytest.mark.parametrize("bits", [1, 2, 5])
def test_random_bits(bits: int) -> None:
    assert set(drawn(lambda source: source.getrandbits(bits))) == set(range(2**bits))


def test_no_bits_draw_nothing_and_more_than_32_are_refused() -> None:
    with_none, without = random_module(3), random_module(3)
    assert with_none.getrandbits(0) == 0
    assert with_none.getrandbits(20) == without.getrandbits(20)
    assert max(drawn(lambda source: source.getrandbits(30))) < 2**30
    for bits in (33, -1):
        with pytest.raises(ValueError, match="bits must be 32 or less"):
            without.getrandbits(bits)
    # Of 32 bits, one in four fits into a hub's integers.
    outcomes = []
    for _ in range(50):
        try:
            outcomes.append(without.getrandbits(32) < 2**30)
        except OverflowError:
            outcomes.append(False)
    assert True in outcomes and False in outcomes


def test_choices() -> None:
    assert set(drawn(lambda source: source.choice("abc"))) == {"a", "b", "c"}
    with pytest.raises(IndexError, match="^$"):
        random_module(1).choice([])


def test_fractions_have_23_bits_and_fill_the_range() -> None:
    fractions = drawn(lambda source: source.random(), 2000)
    assert all(0 <= fraction < 1 and (fraction * 2**23).is_integer() for fraction in fractions)
    assert min(fractions) < 0.01 and max(fractions) > 0.99
    assert sum(fractions) / 2000 == pytest.approx(0.5, abs=0.03)


def test_a_uniform_number_is_a_share_of_the_span() -> None:
    first, second = random_module(9), random_module(9)
    for low, high in ((0, 1), (-5, 5), (2.5, 2.5), (10, -10)):
        share = first.random()
        expected = to_single(low + to_single((high - low) * share))
        assert second.uniform(low, high) == expected


def test_without_a_number_the_seed_is_the_clocks() -> None:
    by_clock, seeded = random_module(77), random_module(5)
    first = [by_clock.getrandbits(16) for _ in range(5)]
    seeded.seed(77)
    assert [seeded.getrandbits(16) for _ in range(5)] == first
    by_clock.seed()
    assert [by_clock.getrandbits(16) for _ in range(5)] == first
    by_clock.seed(78)
    assert [by_clock.getrandbits(16) for _ in range(5)] != first
    by_clock.seed(77 + 2**32)
    assert [by_clock.getrandbits(16) for _ in range(5)] == first, "a seed has 32 bits"


# ---- math


@pytest.mark.parametrize(
    "name", ["sin", "cos", "tan", "atan", "exp", "sqrt", "fabs", "asin", "acos"]
)
@given(value=st.floats(0, 1, width=32))
def test_functions_of_one_float_round_once(name: str, value: float) -> None:
    assert getattr(MATH, name)(value) == to_single(getattr(math, name)(value))


@pytest.mark.parametrize("name", ["atan2", "pow", "fmod", "copysign"])
@given(a=st.floats(0.5, 8, width=32), b=st.floats(0.5, 8, width=32))
def test_functions_of_two_floats_round_once(name: str, a: float, b: float) -> None:
    assert getattr(MATH, name)(a, b) == to_single(getattr(math, name)(a, b))


@pytest.mark.parametrize(
    ("call", "value"),
    [
        (lambda: MATH.log(8, 2), 3.0),
        (lambda: MATH.log(100, 10), 2.0),
        (lambda: MATH.log(1), 0.0),
        (lambda: MATH.log(4, 0.5), -2.0),
        (lambda: MATH.ldexp(1.5, 4), 24.0),
        (lambda: MATH.ldexp(3, -1), 1.5),
        (lambda: MATH.ceil(1.2), 2),
        (lambda: MATH.floor(-1.2), -2),
        (lambda: MATH.trunc(-1.8), -1),
        (lambda: MATH.frexp(8.0), (0.5, 4)),
        (lambda: MATH.isnan(math.nan), True),
        (lambda: MATH.isinf(1.0), False),
        (lambda: MATH.isfinite(2), True),
        (lambda: MATH.sqrt(math.inf), math.inf),
    ],
)
def test_values_of_functions(call: Callable[[], Any], value: Any) -> None:
    assert call() == value


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: MATH.log(0), "math domain error"),
        (lambda: MATH.log(-1), "math domain error"),
        (lambda: MATH.log(2, 0), "math domain error"),
        (lambda: MATH.log(2, -2), "math domain error"),
        (lambda: MATH.log(2, 1), "divide by zero"),
        (lambda: MATH.exp(100), "math domain error"),
        (lambda: MATH.exp(1000), "math domain error"),
        (lambda: MATH.pow(10, 39), "math domain error"),
        (lambda: MATH.sqrt(-1), "math domain error"),
        (lambda: MATH.asin(2), "math domain error"),
        (MATH.sin, "function takes 1 positional arguments but 0 were given"),
        (lambda: MATH.sin(1, 2), "function takes 1 positional arguments but 2 were given"),
        (lambda: MATH.atan2(1), "function takes 2 positional arguments but 1 were given"),
        (lambda: MATH.ldexp(1, 1.0), "can't convert float to int"),
        (lambda: MATH.ceil(math.nan), "can't convert NaN to int"),
        (lambda: MATH.floor(math.inf), "can't convert inf to int"),
        (lambda: MATH.trunc(2.0**30), "float too big"),
    ],
)
def test_refusals_of_functions(call: Callable[[], Any], error: str) -> None:
    with pytest.raises((ValueError, TypeError, OverflowError, ZeroDivisionError), match=error):
        call()


# ---- operators


OPERATORS = operators([])
LARGEST, SMALLEST = 2**30 - 1, -(2**30)


@given(st.integers(SMALLEST, LARGEST), st.integers(SMALLEST, LARGEST))
def test_integers_are_divided_as_floats(a: int, b: int) -> None:
    if b == 0:
        b = 1
    assert OPERATORS["@div"](a, b) == to_single(to_single(a) / to_single(b))
    if a // b <= LARGEST:
        assert OPERATORS["@floordiv"](a, b) == a // b
    assert OPERATORS["@mod"](a, b) == a % b


@given(st.integers(2**24 - 9, LARGEST), st.floats(1, 1000, width=32))
def test_a_large_integer_beside_a_float_loses_digits(a: int, b: float) -> None:
    for sign in (1, -1):
        single = to_single(sign * a)
        assert OPERATORS["@floordiv"](sign * a, b) == to_single(single // b)
        assert OPERATORS["@mod"](b, sign * a) == to_single(b % single)


@pytest.mark.parametrize("value", [LARGEST, SMALLEST, 0, -1])
def test_integers_of_31_bits_stay(value: int) -> None:
    assert OPERATORS["@n"](value) == value


@pytest.mark.parametrize("value", [LARGEST + 1, SMALLEST - 1, 2**31, -(2**40)])
def test_integers_of_more_bits_overflow(value: int) -> None:
    with pytest.raises(OverflowError, match="small int overflow"):
        OPERATORS["@n"](value)


@pytest.mark.parametrize(
    ("a", "b", "result"),
    [
        (2, 29, 2**29),
        (-2, 29, -(2**29)),
        (0, 100, 0),
        (1, 100, 1),
        (-1, 100, 1),
        (-1, 101, -1),
        (2, -1, 0.5),
        (2.0, 200, math.inf),
        (2, 200.0, math.inf),
        (10.0, 39, math.inf),
        (2.0, 0.5, to_single(math.sqrt(2))),
    ],
)
def test_powers(a: float, b: float, result: float) -> None:
    assert OPERATORS["@pow"](a, b) == result


@pytest.mark.parametrize(("a", "b"), [(2, 30), (-2, 30), (2, 31), (3, 31), (-2, 31), (10, 10)])
def test_powers_that_are_too_large(a: int, b: int) -> None:
    with pytest.raises(OverflowError, match="small int overflow"):
        OPERATORS["@pow"](a, b)


@pytest.mark.parametrize(
    ("value", "rounded"),
    [
        (0.1, to_single(0.1)),
        (3.4028234663852886e38, 3.4028234663852886e38),
        (3.5e38, math.inf),
        (-3.5e38, -math.inf),
        (1e-60, 0.0),
        (complex(0.1, 1e60), complex(to_single(0.1), math.inf)),
    ],
)
def test_floats_are_rounded_to_32_bits(value: Any, rounded: Any) -> None:
    assert OPERATORS["@n"](value) == rounded
