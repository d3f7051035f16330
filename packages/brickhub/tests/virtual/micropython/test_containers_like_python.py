"""Sets, dicts, lists, texts and bytes of a hub against Python's own, where both have the same
contents: only the order of a set or a dict is the hub's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from brickhub.virtual.micropython.containers import FixedDict, HubDict, HubSet
from brickhub.virtual.micropython.iterables import sorted_list
from brickhub.virtual.micropython.operators import operators
from brickhub.virtual.micropython.streams import HubBytearray, as_bytes, part_of

OPERATORS = operators([])
FEW = settings(max_examples=30)
NUMBERS = st.lists(st.integers(-9, 9), max_size=8, unique=True)
ASCII = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=12)


@pytest.mark.parametrize(
    "name",
    ["union", "intersection", "difference", "symmetric_difference"],
)
@FEW
@given(first=NUMBERS, second=NUMBERS)
def test_sets_are_combined_as_by_python(name: str, first: list[int], second: list[int]) -> None:
    ours = HubSet(first)
    expected = getattr(set(first), name)(second)
    assert set(getattr(ours, name)(HubSet(second))) == expected
    assert set(getattr(ours, name)(second)) == expected
    assert set(ours) == set(first), "the set itself stays"


@pytest.mark.parametrize(
    ("operate", "name"),
    [
        (lambda a, b: a | b, "union"),
        (lambda a, b: a & b, "intersection"),
        (lambda a, b: a - b, "difference"),
        (lambda a, b: a ^ b, "symmetric_difference"),
    ],
)
@FEW
@given(first=NUMBERS, second=NUMBERS)
def test_operators_of_sets(
    operate: Callable[[Any, Any], Any], name: str, first: list[int], second: list[int]
) -> None:
    result = operate(HubSet(first), HubSet(second))
    assert type(result) is HubSet
    assert list(result) == list(getattr(HubSet(first), name)(HubSet(second)))
    with pytest.raises(TypeError):
        operate(HubSet(first), second)


@pytest.mark.parametrize(
    "name",
    ["update", "intersection_update", "difference_update", "symmetric_difference_update"],
)
@FEW
@given(first=NUMBERS, second=NUMBERS)
def test_sets_change_as_by_python(name: str, first: list[int], second: list[int]) -> None:
    ours, theirs = HubSet(first), set(first)
    assert getattr(ours, name)(HubSet(second)) is None
    getattr(theirs, name)(set(second))
    assert set(ours) == theirs and len(list(ours)) == len(ours)


@pytest.mark.parametrize("name", ["union", "intersection", "difference", "symmetric_difference"])
def test_a_set_with_itself(name: str) -> None:
    ours = HubSet([1, 2, 3])
    result = getattr(ours, name)(ours)
    assert set(result) == getattr({1, 2, 3}, name)({1, 2, 3})
    assert result is not ours and set(ours) == {1, 2, 3}


def test_what_comes_twice_is_toggled_twice() -> None:
    """A hub looks at the items one by one (``py/objset.c``), where Python makes a set of them."""
    assert list(HubSet([1]).symmetric_difference([2, 2])) == [1]


def test_a_set_is_emptied_by_itself() -> None:
    ours = HubSet([1, 2, 3])
    ours.difference_update(ours)
    assert list(ours) == [] and len(ours) == 0
    ours.add(7)
    assert list(ours) == [7]


def test_refusals_of_sets_and_dicts() -> None:
    empty: HubSet = HubSet()
    with pytest.raises(KeyError, match="pop from an empty set"):
        empty.pop()
    with pytest.raises(KeyError, match="5"):
        empty.remove(5)
    empty.discard(5)
    with pytest.raises(TypeError, match="function expected at most 1 arguments, got 2"):
        HubSet([1], [2])
    names: HubDict = HubDict()
    with pytest.raises(KeyError, match="dictionary is empty"):
        names.popitem()
    with pytest.raises(KeyError, match="5"):
        names.pop(5)
    with pytest.raises(KeyError, match="5"):
        del names[5]
    for wrong in ([(1,)], [(1, 2, 3)], ["a"]):
        with pytest.raises(ValueError, match="dict update sequence has wrong length"):
            names.update(wrong)
    assert names.pop(5, None) is None and names.pop(5, 7) == 7


@FEW
@given(st.lists(st.tuples(st.integers(-9, 9), st.integers()), max_size=9), NUMBERS)
def test_dicts_have_the_contents_of_pythons(pairs: list[tuple[int, int]], keys: list[int]) -> None:
    ours, theirs = HubDict(pairs), dict(pairs)
    for key in keys:
        assert ours.setdefault(key, key) == theirs.setdefault(key, key)
        assert (key in ours.keys()) and ours.get(key) == theirs.get(key)  # noqa: SIM118
    assert dict(ours.items()) == theirs
    assert sorted(ours.values()) == sorted(theirs.values())
    assert sorted(ours) == sorted(ours.keys()) == sorted(theirs)
    for key, value in theirs.items():
        assert value in ours.values() and (key, value) in ours.items()
    assert 10 not in ours.keys() and (10, 10) not in ours.items()  # noqa: SIM118
    other = ours.copy()
    assert list(other) == list(ours) and other == ours
    other.clear()
    assert list(other) == [] and dict(ours) == theirs
    assert dict(HubDict.fromkeys(keys, 5)) == dict.fromkeys(keys, 5)
    assert dict(HubDict.fromkeys(iter(keys))) == dict.fromkeys(keys)


def test_a_fixed_dict_does_not_change() -> None:
    fixed = FixedDict.of({3: "c", 1: "a", 2: "b"})
    assert list(fixed) == [3, 1, 2] and fixed[1] == "a"
    for change in (
        lambda: fixed.pop(1),
        fixed.popitem,
        fixed.clear,
        lambda: fixed.update({}),
        lambda: fixed.setdefault(9),
        lambda: fixed.__setitem__(1, 2),
        lambda: fixed.__delitem__(1),
    ):
        with pytest.raises(TypeError, match="^$"):
            change()
    assert list(fixed.copy()) == [3, 1, 2]


@FEW
@given(st.lists(st.floats(allow_nan=False), unique=True, max_size=12), st.booleans())
def test_different_items_are_sorted_as_by_python(items: list[float], reverse: bool) -> None:
    assert sorted_list(items, reverse=reverse) == sorted(items, reverse=reverse)
    keyed = sorted_list(items, key=lambda value: -value, reverse=reverse)
    assert keyed == sorted(items, key=lambda value: -value, reverse=reverse)
    pairs = [(int(value > 0), value) for value in items]
    assert sorted_list(pairs, reverse=reverse) == sorted(pairs, reverse=reverse)


@FEW
@given(st.lists(st.lists(st.integers(0, 2), max_size=3), max_size=6))
def test_lists_are_sorted_by_their_first_difference(items: list[list[int]]) -> None:
    assert sorted_list(items) == sorted(items)


@FEW
@given(st.lists(st.integers(-(2**30), 2**30 - 1), max_size=6), st.binary(max_size=6))
def test_bytearrays_keep_eight_bits(numbers: list[int], data: bytes) -> None:
    low = bytes(number & 0xFF for number in numbers)
    ours = HubBytearray(numbers)
    assert bytes(ours) == low
    assert bytes(ours + data) == low + data
    ours += numbers
    assert bytes(ours) == low + low
    ours.extend(data)
    for number in numbers:
        ours.append(number)
    assert bytes(ours) == low + low + data + low
    for index, number in enumerate(numbers):
        ours[index] = number + 1
        assert ours[index] == (number + 1) & 0xFF
    assert type(ours[1:3]) is HubBytearray and type(ours + b"") is HubBytearray


@pytest.mark.parametrize(
    "name", ["lower", "upper", "isalpha", "isdigit", "islower", "isupper", "isspace"]
)
@FEW
@given(text=ASCII)
def test_letters_of_ascii(name: str, text: str) -> None:
    assert OPERATORS[f"@{name}"](text) == getattr(text, name)()
    assert OPERATORS[f"@{name}"](text.encode()) == getattr(text.encode(), name)()


@pytest.mark.parametrize("name", ["strip", "lstrip", "rstrip"])
@FEW
@given(text=ASCII, chars=st.one_of(st.none(), ASCII))
def test_texts_are_stripped_as_by_python(name: str, text: str, chars: str | None) -> None:
    arguments = () if chars is None else (chars,)
    assert OPERATORS[f"@{name}"](text, *arguments) == getattr(text, name)(*arguments)


@pytest.mark.parametrize("name", ["split", "rsplit"])
@FEW
@given(text=ASCII, mark=st.sampled_from([",", "a", " ", "ab"]), most=st.integers(-1, 4))
def test_texts_are_split_as_by_python(name: str, text: str, mark: str, most: int) -> None:
    split = OPERATORS[f"@{name}"]
    assert split(text) == getattr(text, name)()
    assert split(text, mark) == getattr(text, name)(mark)
    assert split(text, mark, most) == getattr(text, name)(mark, most)


@pytest.mark.parametrize(
    ("name", "text", "arguments", "result"),
    [
        ("lower", "\u00c4B", (), "\u00c4b"),
        ("upper", "\u00e4b", (), "\u00e4B"),
        ("isalpha", "\u00e4", (), False),
        ("isdigit", "\u0663", (), False),
        ("strip", "\u00a0a ", (), "\u00a0a"),
        ("split", "\u00e4,b", (",",), ["\u00e4", "b"]),
    ],
)
def test_only_letters_of_ascii_are_letters(
    name: str, text: str, arguments: tuple[str, ...], result: object
) -> None:
    assert OPERATORS[f"@{name}"](text, *arguments) == result


@FEW
@given(st.integers(-(2**30), 2**30 - 1), st.integers(4, 8), st.sampled_from(["little", "big"]))
def test_integers_become_bytes_as_by_python(value: int, length: int, order: Any) -> None:
    assert OPERATORS["@to_bytes"](value, length, order) == value.to_bytes(
        length, order, signed=True
    )


@FEW
@given(st.integers(0, 2**30 - 1), st.sampled_from(["little", "big"]))
def test_bytes_become_integers_as_by_python(value: int, order: Any) -> None:
    data = value.to_bytes(4, order)
    assert OPERATORS["@from_bytes"](int, data, order) == value
    if order == "big":
        assert OPERATORS["@from_bytes"](int, data) == value


@pytest.mark.parametrize(
    ("part", "data"),
    [
        ((), b"abcdef"),
        ((2,), b"ab"),
        ((0,), b""),
        ((9,), b"abcdef"),
        ((-1,), b"abcdef"),
        ((2, 3), b"cde"),
        ((2, 0), b""),
        ((2, -1), b"cdef"),
        ((9, 1), b""),
    ],
)
def test_parts_of_what_is_written(part: tuple[int, ...], data: bytes) -> None:
    for content in (b"abcdef", "abcdef", bytearray(b"abcdef"), memoryview(b"abcdef")):
        assert part_of(content, *part) == data
    with pytest.raises(TypeError, match="object with buffer protocol required"):
        as_bytes(5)


@pytest.mark.parametrize(
    ("item", "container", "found"),
    [
        (97, b"abc", True),
        (300, b"abc", False),
        (-1, b"abc", False),
        (0, b"\0", True),
        (255, b"\xff", True),
        (256, b"\xff\0", False),
        ("b", b"abc", True),
        (b"bc", b"abc", True),
        (b"cb", b"abc", False),
        (None, b"abc", False),
        ([98], b"abc", False),
        ("b", "abc", True),
        (2, [1, 2], True),
        (2, (1, 3), False),
    ],
)
def test_what_is_in_a_container(item: object, container: object, found: bool) -> None:
    assert OPERATORS["@in"](item, container) is found
