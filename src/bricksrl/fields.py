"""Fields of dataclasses, checked against their annotations, as values from files and command lines may be of any type."""

from __future__ import annotations

import enum
import math
import types
import typing
from collections.abc import Container, Iterable
from typing import Any, Literal

from bricksrl.errors import DescriptionError


def check_fields(kind: type, values: dict[str, Any]) -> None:
    """Check values against the annotations of a dataclass's fields of these names; any other name passes. Raises DescriptionError
    if one is not of those that its annotation allows."""
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        if name in values:
            check_value(name, values[name], hint)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check a value against an annotation, whose limits are a container of the numbers that it may be. Raises DescriptionError if
    it is not one of the values that the annotation allows."""
    limits = next((one for one in getattr(hint, "__metadata__", ()) if isinstance(one, Container)), None)
    hint = hint.__origin__ if limits is not None else hint
    if value is None and _is(value, hint):
        return
    if limits is not None:
        if isinstance(value, float) and not math.isfinite(value):
            raise DescriptionError(f"{name} is {value}; give a finite number")
        if isinstance(value, bool) or not isinstance(value, int | float) or value not in limits:
            raise DescriptionError(f"{name} is {value!r}; give {limits}")
    if typing.get_origin(hint) is Literal and value not in typing.get_args(hint):
        raise DescriptionError(f"{name} is '{value}'; choose {_either(map(str, typing.get_args(hint)))}")
    if not _is(value, hint):
        shown = repr(value) if len(repr(value)) <= _LONGEST else f"of type {type(value).__name__}"
        raise DescriptionError(f"{name} is {shown}; give {_wanted(hint)}")


def _is(value: Any, hint: Any) -> bool:
    """Whether a value is of the annotated type; True for an annotation that is no type."""
    kind, parts = typing.get_origin(hint) or hint, typing.get_args(hint)
    if kind in _UNIONS:
        return any(_is(value, part) for part in parts)
    if kind is Any or not isinstance(kind, type):
        return True
    if kind in (int, float) and isinstance(value, bool):
        return False
    is_kind = isinstance(value, int | float if kind is float else kind)
    if not is_kind:
        return False
    if kind is not tuple or not parts:
        return True
    if parts[-1] is ...:
        return all(_is(part, parts[0]) for part in value)
    return len(value) == len(parts) and all(map(_is, value, parts))


def _wanted(hint: Any) -> str:
    """The values that an annotation allows, in words."""
    kind, parts = typing.get_origin(hint) or hint, typing.get_args(hint)
    if kind in _UNIONS:
        return _either(_wanted(part) for part in parts if part is not type(None))
    if kind is tuple and parts:
        return f"{'several' if parts[-1] is ... else len(parts)} values, each {_wanted(parts[0])}"
    if issubclass(kind, enum.Enum):
        return _either(map(str, kind))
    return _NAMES.get(kind, f"{kind.__name__}(...)")


def _either(words: Iterable[str]) -> str:
    """``"a, b or c"``."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


_UNIONS = (types.UnionType, typing.Union)
_LONGEST = 40
"""Characters of a value that a message shows."""
_NAMES: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "a text",
    tuple: "several values",
    dict: "a table of names and values",
}
