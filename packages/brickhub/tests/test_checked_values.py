"""Values of a user's, from JSON and command lines, as a function's annotations want them."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Optional

import pytest

from brickhub.errors import DescriptionError
from brickhub.fields import Count, Range, check_arguments, check_call, check_value


class Side(enum.Enum):
    LEFT = "l"
    RIGHT = "r"


def build(
    count: Count,
    share: Annotated[float, Range(0.0, 1.0)] = 0.5,
    name: str = "x",
    side: Side = Side.LEFT,
    path: Path | None = None,
    pair: tuple[int, float] = (1, 2.0),
    several: tuple[str, ...] = (),
    kind: Literal["a", "b"] = "a",
    free=1,
    wrong: int = None,  # type: ignore[assignment]  # noqa: RUF013
) -> None:
    """What a user may have written."""


@pytest.mark.parametrize(
    ("given", "made"),
    [
        ({"count": 1}, {"count": 1}),
        ({"count": 2, "share": 1}, {"count": 2, "share": 1}),
        # A command line reads a name that looks like a number as one.
        ({"count": 2, "name": 7}, {"count": 2, "name": "7"}),
        ({"count": 2, "name": True}, {"count": 2, "name": "true"}),
        ({"count": 2, "side": "r"}, {"count": 2, "side": Side.RIGHT}),
        ({"count": 2, "side": "LEFT"}, {"count": 2, "side": Side.LEFT}),
        ({"count": 2, "path": "a/b"}, {"count": 2, "path": Path("a/b")}),
        ({"count": 2, "path": None}, {"count": 2, "path": None}),
        ({"count": 2, "pair": [3, 4]}, {"count": 2, "pair": (3, 4)}),
        ({"count": 2, "several": ["u", 5]}, {"count": 2, "several": ("u", "5")}),
        ({"count": 2, "several": []}, {"count": 2, "several": ()}),
        # Without an annotation, a default of 1 does not forbid 1.5.
        ({"count": 2, "free": 1.5}, {"count": 2, "free": 1.5}),
        # Whoever wrote this default allows it, whatever the annotation says.
        ({"count": 2, "wrong": None}, {"count": 2, "wrong": None}),
    ],
)
def test_what_json_writes_differently_is_taken(given: dict[str, Any], made: dict[str, Any]) -> None:
    assert check_call("", build, given) == made


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "make: an option is missing; give count (a whole number)"),
        ({"count": 0}, "make: count is 0; give 1 or more, and up to 16,777,216"),
        ({"count": True}, "make: count is True; give 1 or more"),
        ({"count": 1.0}, "make: count is 1.0; give a whole number"),
        ({"count": 1, "share": 1.1}, "make: share is 1.1; give a number from 0 to 1"),
        ({"count": 1, "share": math.nan}, "make: share is nan; give a number"),
        ({"count": 1, "share": math.inf}, "make: share is inf; give a finite number"),
        ({"count": 1, "free": math.nan}, "make: free is nan; give a number"),
        ({"count": 1, "side": "up"}, "make: side is 'up'; give Side.LEFT or Side.RIGHT"),
        ({"count": 1, "kind": "c"}, "make: kind is 'c'; choose a or b"),
        (
            {"count": 1, "pair": [3, 4, 5]},
            "make: pair is (3, 4, 5); give 2 values, each a whole number",
        ),
        ({"count": 1, "pair": [3.5, 4]}, "make: pair is (3.5, 4); give 2 values"),
        ({"count": 1, "several": "u"}, "make: several is 'u'; give several values, each a text"),
        ({"count": 1, "several": [["u"]]}, "make: several is (['u'],); give several values"),
        ({"count": 1, "name": 1.5}, "make: name is 1.5; give a text"),
        ({"count": 1, "name": "x" * 9, "path": 3}, "make: path is 3; give the path of a file"),
        ({"count": 1, "free": "x"}, "make: free is 'x'; give a number"),
    ],
)
def test_other_values_are_refused_with_what_to_give(given: dict[str, Any], message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        check_call("make: ", build, given)
    assert str(caught.value).startswith(message)


def test_further_names_are_those_of_the_rest() -> None:
    def free(first: int, *, last: str = "", **rest: float) -> None: ...

    def anything(**rest: Any) -> None: ...

    assert check_call("", free, {"first": 1, "gain": 2}) == {"first": 1, "gain": 2}
    with pytest.raises(DescriptionError, match="gain is 'x'; give a number"):
        check_call("", free, {"first": 1, "gain": "x"})
    assert check_call("", anything, {"gain": "x"}) == {"gain": "x"}
    with pytest.raises(DescriptionError, match=r"give first \(a whole number\)$"):
        check_call("", free, {"last": "x"})


def test_an_annotation_that_fails_checks_nothing() -> None:
    def odd(first: "Missing", second) -> None: ...  # type: ignore[name-defined] # noqa: F821, UP037

    assert check_call("", odd, {"first": "x", "second": [1]}) == {"first": "x", "second": [1]}
    with pytest.raises(DescriptionError, match="give second$"):
        check_call("", odd, {"first": 1})


@pytest.mark.parametrize(
    ("hint", "taken", "refused"),
    [
        (int, [0, -1], [True, 1.0, None, "1"]),
        (float, [0, 0.5, math.inf], [False, "1", None]),
        (bool, [True, False], [0, 1, None]),
        (Optional[int], [None, 3], ["3", 3.0]),  # noqa: UP045
        (int | str, [3, "x"], [3.0, None]),
        (Literal[1, "a"], [1, "a"], [True, 1.0, "b"]),
        (list[int], [[], [1]], [(1,), [1.5], [True]]),
        (tuple[int, ...], [(), (1, 2)], [[1], (1.5,)]),
        (tuple[int, str], [(1, "a")], [(1,), (1, "a", "b"), ("a", 1)]),
        (dict[str, int], [{}, {"a": 1}], [{"a": "b"}, {1: 1}, []]),
        (set[int], [set(), {"what is in it shows later"}], [[]]),
        (Callable[[int], int], [len], [3]),
        (Any, [None, 3, object()], []),
        (None, [None], [0]),
    ],
)
def test_annotations(hint: Any, taken: list[Any], refused: list[Any]) -> None:
    for value in taken:
        check_value("x", value, hint)
    for value in refused:
        with pytest.raises(DescriptionError, match="^x is "):
            check_value("x", value, hint)


def test_a_long_value_is_named_by_its_type() -> None:
    for length, said in ((38, f"x is '{'y' * 38}'"), (39, "x is of type str;")):
        with pytest.raises(DescriptionError) as caught:
            check_value("x", "y" * length, int)
        assert str(caught.value).startswith(said)


def test_a_function_takes_as_many_arguments() -> None:
    def two(first: int, second: int = 0) -> None: ...

    check_arguments("f", two, ["a"])
    check_arguments("f", two, ["a", "b"])
    check_arguments("f", print, ["a", "b", "c"])
    for names in ([], ["a", "b", "c"]):
        with pytest.raises(DescriptionError, match=r"^f takes other arguments, \(first: 'int'"):
            check_arguments("f", two, names)
