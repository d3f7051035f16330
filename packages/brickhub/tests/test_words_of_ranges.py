"""Ranges and annotations in the words of a refusal."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from brickhub.errors import DescriptionError
from brickhub.fields import LARGEST, Count, Range, check_fields, check_value


class Side(enum.Enum):
    LEFT = "l"
    RIGHT = "r"


@dataclass
class Wheel:
    """A thing of ours."""

    size_mm: Annotated[float, Range(0.0, 100.0, above=True)] = 1.0
    side: Side | None = None


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Range(1), "1 or more, and up to 16,777,216"),
        (Range(), "0 or more, and up to 16,777,216"),
        (Range(0.5), "0.5 or more, and up to 16,777,216"),
        (Range(0.0, above=True), "a number above 0 to 16,777,216"),
        (Range(0, 5), "a whole number from 0 to 5"),
        (Range(0, 2**32 - 1), "a whole number from 0 to 4,294,967,295"),
        (Range(0, 5, above=True), "a whole number above 0 to 5"),
        (Range(0.0, 1.0, below=True), "a number from 0 and below 1"),
        (Range(-0.5, 5), "a number from -0.5 to 5"),
        (Range(0, 0.5), "a number from 0 to 0.5"),
    ],
)
def test_words_of_a_range(limits: Range, words: str) -> None:
    assert str(limits) == words


@pytest.mark.parametrize(
    ("limits", "inside", "outside"),
    [
        (Range(0.0, 1.0), [0.0, 0.5, 1.0], [-0.01, 1.01, math.nan]),
        (Range(0.0, 1.0, above=True), [0.01, 1.0], [0.0, math.nan]),
        (Range(0.0, 1.0, below=True), [0.0, 0.99], [1.0, math.nan]),
        (Range(1), [1, LARGEST], [0, LARGEST + 1]),
    ],
)
def test_numbers_of_a_range(limits: Range, inside: list[float], outside: list[float]) -> None:
    assert all(number in limits for number in inside)
    assert not any(number in limits for number in outside)


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (int, "a whole number"),
        (float, "a number"),
        (bool, "True or False"),
        (str, "a text"),
        (Path, "the path of a file"),
        (dict, "a table of names and values"),
        (dict[str, int], "a table of names and values"),
        (Mapping[str, int], "a table of names and values"),
        (list, "a list"),
        (list[int], "a list, each a whole number"),
        (tuple, "several values"),
        (tuple[int, ...], "several values, each a whole number"),
        (tuple[float, float, float], "3 values, each a number"),
        (Side, "Side.LEFT or Side.RIGHT"),
        (int | None, "a whole number"),
        (int | str | Side, "a whole number, a text or Side.LEFT or Side.RIGHT"),
        (Callable[[int], int], "a function"),
        (Wheel, "Wheel(...)"),
        (Annotated[int, 3], "a whole number"),
    ],
)
def test_words_of_an_annotation(hint: Any, words: str) -> None:
    class Odd:
        """What no annotation allows."""

        def __repr__(self) -> str:
            return "odd"

    with pytest.raises(DescriptionError) as caught:
        check_value("x", Odd(), hint)
    assert str(caught.value) == f"x is odd; give {words}"


@pytest.mark.parametrize(
    ("hint", "words"),
    [(Literal["a"], "a"), (Literal["a", "b"], "a or b"), (Literal[1, 2, 3], "1, 2 or 3")],
)
def test_words_of_choices(hint: Any, words: str) -> None:
    with pytest.raises(DescriptionError, match=f"^x is 'c'; choose {words}$"):
        check_value("x", "c", hint)


def test_value_that_is_left_out_has_no_limits() -> None:
    check_value("x", None, Annotated[float | None, Range(1.0, 2.0)])
    with pytest.raises(DescriptionError, match="^x is 0.5; give a number from 1 to 2$"):
        check_value("x", 0.5, Annotated[float | None, Range(1.0, 2.0)])
    with pytest.raises(DescriptionError, match="^x is None; give 1 or more"):
        check_value("x", None, Count)


def test_choice_of_numbers_is_a_container_of_them() -> None:
    check_value("x", 3, Annotated[int, (1, 3)])
    with pytest.raises(DescriptionError, match=r"^x is 2; give \(1, 3\)$"):
        check_value("x", 2, Annotated[int, (1, 3)])


def test_fields_are_checked_by_their_names() -> None:
    check_fields(Wheel, {"size_mm": 5, "side": Side.LEFT, "unknown": object()})
    with pytest.raises(DescriptionError, match="^size_mm is 0.0; give a number above 0 to 100$"):
        check_fields(Wheel, {"size_mm": 0.0})
    with pytest.raises(DescriptionError, match="^side is 'l'; give Side.LEFT or Side.RIGHT$"):
        check_fields(Wheel, {"side": "l"})
    with pytest.raises(DescriptionError, match="^size_mm is inf; give a finite number$"):
        check_fields(Wheel, {"size_mm": math.inf})
