"""Arguments of a program's calls: conversions, limits, refusals."""

from __future__ import annotations

import math
from typing import Any

import pytest

from brickhub.virtual.pybricks.arguments import (
    expect,
    expect_type,
    get_array,
    get_exact_int,
    get_int,
    get_number,
    get_scaled,
    get_text,
    os_error,
    percentage,
    truncated,
)

LARGEST, SMALLEST = 2**31 - 1, -(2**31)


@pytest.mark.parametrize(
    ("value", "integer"),
    [
        (3, 3),
        (True, 1),
        (2.9, 2),
        (-2.9, -2),
        (1e20, LARGEST),
        (-1e20, SMALLEST),
        (math.inf, LARGEST),
        (-math.inf, SMALLEST),
        (math.nan, 0),
    ],
)
def test_numbers_become_integers_towards_zero(value: float, integer: int) -> None:
    assert get_int(value) == truncated(value) == integer


@pytest.mark.parametrize(
    ("value", "percent"), [(-1, 0), (0, 0), (1, 1), (99.9, 99), (100, 100), (101, 100), (1e9, 100)]
)
def test_percentages_end_at_0_and_100(value: float, percent: int) -> None:
    assert percentage(value) == percent


@pytest.mark.parametrize(
    ("value", "scaled"), [(55, 55_000), (55.5, 55_500), (-0.0004, 0), (1e9, LARGEST)]
)
def test_scale_comes_before_the_truncation(value: float, scaled: int) -> None:
    assert get_scaled(value, 1000) == scaled


@pytest.mark.parametrize("value", ["3", None, [3], (3,)])
def test_what_is_no_number_is_refused(value: Any) -> None:
    says = f"can't convert {type(value).__name__} to "
    for convert in (get_int, get_exact_int, percentage):
        with pytest.raises(TypeError, match=f"{says}int"):
            convert(value)
    with pytest.raises(TypeError, match=f"{says}float"):
        get_number(value)


def test_exact_integers_and_floats() -> None:
    assert get_exact_int(7) == 7 and type(get_exact_int(True)) is int
    with pytest.raises(TypeError, match="can't convert float to int"):
        get_exact_int(7.0)
    assert get_number(7) == 7.0 and type(get_number(7)) is float


def test_texts_and_arrays() -> None:
    assert get_text("ü") == "ü" and get_text(b"\xfc") == "ü", "a byte is a character"
    with pytest.raises(TypeError, match="'int' object"):
        get_text(3)
    for array in ([1, "a"], (1, "a")):
        assert get_array(array) is array
    with pytest.raises(TypeError, match="object 'str' isn't a tuple or list"):
        get_array("ab")


def test_refusals_have_the_firmwares_words() -> None:
    expect([0])
    with pytest.raises(ValueError, match="^Invalid argument$"):
        expect([])
    expect_type(True, int)
    with pytest.raises(TypeError, match="can't convert str to int"):
        expect_type("3", int)
    error = os_error(19)
    assert error.args[0] == 19 and "not connected to the specified port" in str(error)
