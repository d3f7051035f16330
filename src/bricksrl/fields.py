"""Fields of dataclasses, checked against their annotations, as values from files and command lines may be of any type."""

from __future__ import annotations

import math
import typing
from collections.abc import Container
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
    kinds = typing.get_args(hint) if type(None) in typing.get_args(hint) else (hint,)
    if value is None and type(None) in kinds:
        return
    if limits is not None:
        if isinstance(value, float) and not math.isfinite(value):
            raise DescriptionError(f"{name} is {value}; give a finite number")
        if isinstance(value, bool) or not isinstance(value, int | float) or value not in limits:
            raise DescriptionError(f"{name} is {value!r}; give {limits}")
    for kind in {typing.get_origin(kind) or kind for kind in kinds} & _NAMES.keys():
        if type(value) is not kind and not (kind is float and type(value) is int):
            raise DescriptionError(f"{name} is {value!r}; give {_NAMES[kind]}")
    if typing.get_origin(hint) is Literal and value not in typing.get_args(hint):
        *others, last = map(str, typing.get_args(hint))
        raise DescriptionError(f"{name} is '{value}'; choose {', '.join(others)} or {last}")


_NAMES: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "a text",
    tuple: "several values",
    dict: "a table of names and values",
}
