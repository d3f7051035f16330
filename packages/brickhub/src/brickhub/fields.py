"""Checks of a user's values: dataclass fields against their annotations, functions against the
arguments that they get."""

import enum
import inspect
import json
import math
import types
import typing
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from brickhub.errors import DescriptionError

LARGEST = 2**24
"""Largest number where nothing else is said, as values come from files."""


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high``, as limits in an annotation; ``above`` excludes ``low``,
    ``below`` excludes ``high``."""

    low: float = 0.0
    high: float = LARGEST
    above: bool = False
    below: bool = False

    def __contains__(self, value: float) -> bool:
        over = value > self.low if self.above else value >= self.low
        return over and (value < self.high if self.below else value <= self.high)

    def __str__(self) -> str:
        if self.high == LARGEST and not self.above:
            return f"{self.low:g} or more, and up to {LARGEST:,}"
        kind = (
            "a whole number"
            if isinstance(self.low, int) and isinstance(self.high, int)
            else "a number"
        )
        low, high = (end if isinstance(end, int) else f"{end:g}" for end in (self.low, self.high))
        return (
            f"{kind} {'above' if self.above else 'from'} {low} "
            f"{'and below' if self.below else 'to'} {high}"
        )


Count = Annotated[int, Range(1)]
"""A number of things, at least one."""


def check_fields(cls: type, values: dict[str, Any], **named: Any) -> None:
    """Check values against the annotations of a dataclass's fields, by name; unknown names are
    ignored. ``named``: types that annotations name and their module does not import. Raises
    DescriptionError if an annotation does not allow a value."""
    for name, hint in typing.get_type_hints(cls, localns=named, include_extras=True).items():
        if name in values:
            check_value(name, values[name], hint)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check a value against an annotation; limits in it are a container of the allowed numbers.
    Raises DescriptionError if the annotation does not allow the value."""
    limits = next(
        (item for item in getattr(hint, "__metadata__", ()) if isinstance(item, Container)), None
    )
    hint = _without_remarks(hint)
    if value is None and _matches(value, hint):
        return
    if limits is not None:
        if isinstance(value, float) and not math.isfinite(value):
            raise DescriptionError(f"{name} is {value}; give a finite number")
        if isinstance(value, bool) or not isinstance(value, int | float) or value not in limits:
            raise DescriptionError(f"{name} is {value!r}; give {limits}")
    if typing.get_origin(hint) is Literal and not _matches(value, hint):
        raise DescriptionError(
            f"{name} is '{value}'; choose {_either(map(str, typing.get_args(hint)))}"
        )
    if not _matches(value, hint):
        text = repr(value) if len(repr(value)) <= _MAX_SHOWN else f"of type {type(value).__name__}"
        raise DescriptionError(f"{name} is {text}; give {_describe(hint)}")


def check_arguments(name: str, function: Callable[..., Any], arguments: Iterable[str]) -> None:
    """Check that a function takes so many arguments; ``arguments`` are their names. Raises
    DescriptionError if it does not."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some functions in C have none
        return
    names = tuple(arguments)
    try:
        signature.bind(*names)
    except TypeError:
        raise DescriptionError(
            f"{name} takes other arguments, {signature}; write a function of ({', '.join(names)})"
        ) from None


def check_call(
    where: str, function: Callable[..., Any], values: Mapping[str, Any]
) -> dict[str, Any]:
    """Values for a function's parameters, by name, as its annotations want them: a list becomes a
    tuple, a text a path or a member of an enumeration, a whole number a text. A parameter without
    annotation wants what its default is.

    Args:
        where: begins each message.
        function: takes all these names.
        values: as they come from JSON or a command line.

    Raises:
        DescriptionError: an annotation does not allow a value, or a parameter without default is
            missing.
    """
    try:
        signature = inspect.signature(function, eval_str=True)
    except Exception:  # noqa: BLE001
        # - an annotation is any expression; one that fails checks nothing
        signature = inspect.signature(function)
    parameters = signature.parameters
    rest = next((each for each in parameters.values() if each.kind is each.VAR_KEYWORD), None)
    missing = [
        name
        for name, each in parameters.items()
        if each.default is each.empty
        and name not in values
        and each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
    ]
    if missing:
        wanted = ", ".join(
            f"{name} ({words})" if (words := _wanted(parameters[name])) else name
            for name in missing
        )
        raise DescriptionError(f"{where}an option is missing; give {wanted}")
    checked = {}
    for name, value in values.items():
        parameter = parameters.get(name, rest)
        hint = Any if parameter is None else _hint_of(parameter)
        checked[name] = _converted(value, hint)
        if isinstance(value, float) and math.isnan(value):
            raise DescriptionError(f"{where}{name} is {value}; give a number")
        is_default = parameter is not None and value is parameter.default
        if not is_default:
            check_value(f"{where}{name}", checked[name], hint)
    return checked


def _hint_of(parameter: inspect.Parameter) -> Any:
    """Annotation of a parameter, or else the type of its default; any number where that is a whole
    one."""
    if parameter.annotation is not parameter.empty:
        return Any if isinstance(parameter.annotation, str) else parameter.annotation
    kind = type(parameter.default)
    return {bool: bool, int: float, float: float, str: str, tuple: tuple}.get(kind, Any)


def _wanted(parameter: inspect.Parameter) -> str:
    """What a parameter wants, in words; empty if it does not say."""
    hint = _hint_of(parameter)
    return "" if hint is Any else _describe(hint)


def _converted(value: Any, hint: Any) -> Any:
    """A value from JSON as what an annotation wants, where that is the same thing written
    differently; else as it is."""
    hint = _without_remarks(hint)
    if _matches(value, hint):
        return value
    cls = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if cls in _UNIONS:
        tried = (_converted(value, part) for part in parts)
        return next((each for each in tried if _matches(each, hint)), value)
    if cls is tuple and isinstance(value, list):
        kinds = parts if parts and parts[-1] is not ... else parts[:1] * len(value)
        if len(kinds) != len(value):
            return tuple(value)
        return tuple(_converted(each, kind) for each, kind in zip(value, kinds, strict=True))
    if cls is str and isinstance(value, int):
        return json.dumps(value)
    if isinstance(value, str) and isinstance(cls, type):
        if issubclass(cls, Path):
            return Path(value)
        if issubclass(cls, enum.Enum):
            return next((each for each in cls if value in (each.name, each.value)), value)
    return value


def _matches(value: Any, hint: Any) -> bool:
    """Whether a value is of the annotated type; True for an annotation that is no type."""
    hint = _without_remarks(hint)
    cls = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if cls is None:
        return value is None
    if cls in _UNIONS:
        return any(_matches(value, part) for part in parts)
    if cls is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if cls is Any or not isinstance(cls, type):
        return True
    if cls in (int, float) and isinstance(value, bool):
        return False
    is_instance = isinstance(value, int | float if cls is float else cls)
    if not is_instance:
        return False
    if not parts:
        return True
    if cls is list:
        return all(_matches(part, parts[0]) for part in value)
    if cls is dict:
        return all(
            _matches(key, parts[0]) and _matches(part, parts[1]) for key, part in value.items()
        )
    if cls is not tuple:
        return True
    if parts[-1] is ...:
        return all(_matches(part, parts[0]) for part in value)
    return len(value) == len(parts) and all(map(_matches, value, parts))


def _without_remarks(hint: Any) -> Any:
    """The type of an ``Annotated`` one."""
    return hint.__origin__ if hasattr(hint, "__metadata__") else hint


def _describe(hint: Any) -> str:
    """The values that an annotation allows, in words."""
    hint = _without_remarks(hint)
    cls = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if cls in _UNIONS:
        return _either(_describe(part) for part in parts if part is not type(None))
    if cls is tuple and parts:
        return f"{'several' if parts[-1] is ... else len(parts)} values, each {_describe(parts[0])}"
    if cls is Literal:
        return _either(map(str, parts))
    if not isinstance(cls, type):
        return str(cls)
    if issubclass(cls, enum.Enum):
        return _either(map(str, cls))
    if cls is list and parts:
        return f"a list, each {_describe(parts[0])}"
    return _NAMES.get(cls, f"{cls.__name__}(...)")


def _either(words: Iterable[str]) -> str:
    """``"a, b or c"``."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


_UNIONS = (types.UnionType, typing.Union)
_MAX_SHOWN = 40
"""Maximum length of a value that a message shows."""
_NAMES: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "a text",
    tuple: "several values",
    list: "a list",
    Path: "the path of a file",
    dict: "a table of names and values",
    Mapping: "a table of names and values",
    Callable: "a function",
}
