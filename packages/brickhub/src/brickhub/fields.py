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
        # NaN compares as false with everything, so the tests are written such that it is in no
        # range.
        is_above = value > self.low if self.above else value >= self.low
        is_below = value < self.high if self.below else value <= self.high
        return is_above and is_below

    def __str__(self) -> str:
        if self.high == LARGEST and not self.above:
            return f"{self.low:g} or more, and up to {LARGEST:,}"
        is_whole = isinstance(self.low, int) and isinstance(self.high, int)
        kind = "a whole number" if is_whole else "a number"
        begin = "above" if self.above else "from"
        end = "and below" if self.below else "to"
        return f"{kind} {begin} {_end(self.low)} {end} {_end(self.high)}"


def _end(value: float) -> str:
    """An end of a range; a whole number in full, as ``g`` rounds to six digits."""
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


Count = Annotated[int, Range(1)]
"""A number of things, at least one."""


def check_fields(
    cls: type,
    values: dict[str, Any],
    **named: Any,
) -> None:
    """Check values against the annotations of a dataclass's fields, by name; unknown names are
    ignored. ``named``: types that annotations name and their module does not import. Raises
    DescriptionError if an annotation does not allow a value."""
    hints = typing.get_type_hints(cls, localns=named, include_extras=True)
    for name, hint in hints.items():
        if name in values:
            check_value(name, values[name], hint)


def check_value(
    name: str,
    value: Any,
    hint: Any,
) -> None:
    """Check a value against an annotation; limits in it are a container of the allowed numbers.
    Raises DescriptionError if the annotation does not allow the value."""
    limits = _limits_of(hint)
    hint = _without_remarks(hint)
    # An option that may be None may be left out; limits apply to given values only.
    if value is None and _matches(value, hint):
        return
    if limits is not None:
        _check_limits(name, value, limits)
    if _matches(value, hint):
        return
    if typing.get_origin(hint) is Literal:
        choices = _either(map(str, typing.get_args(hint)))
        raise DescriptionError(f"{name} is '{value}'; choose {choices}")
    text = repr(value)
    if len(text) > _MAX_SHOWN:
        text = f"of type {type(value).__name__}"
    raise DescriptionError(f"{name} is {text}; give {_describe(hint)}")


def _limits_of(hint: Any) -> Container[Any] | None:
    """Limits in an annotation: what is a container among its remarks."""
    for remark in getattr(hint, "__metadata__", ()):
        if isinstance(remark, Container):
            return remark
    return None


def _check_limits(
    name: str,
    value: Any,
    limits: Container[Any],
) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise DescriptionError(f"{name} is {value}; give a finite number")
    # In Python True counts as 1, but whoever wrote it meant no number.
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or value not in limits:
        raise DescriptionError(f"{name} is {value!r}; give {limits}")


def check_arguments(
    name: str,
    function: Callable[..., Any],
    arguments: Iterable[str],
) -> None:
    """Check that a function takes so many arguments; ``arguments`` are their names. Raises
    DescriptionError if it does not."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        # Some functions in C have no signature, so nothing can be checked.
        return
    names = tuple(arguments)
    try:
        # Values are given by position, so only their number matters.
        signature.bind(*names)
    except TypeError:
        wanted = ", ".join(names)
        raise DescriptionError(
            f"{name} takes other arguments, {signature}; write a function of ({wanted})"
        ) from None


def check_call(
    where: str,
    function: Callable[..., Any],
    values: Mapping[str, Any],
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
        # An annotation is any expression and may raise anything; one that fails checks nothing.
        signature = inspect.signature(function)
    parameters = signature.parameters
    # All missing options are named at once, so that nobody has to try once for each.
    missing = [
        _wanted(parameter)
        for name, parameter in parameters.items()
        if name not in values and _is_required(parameter)
    ]
    if missing:
        raise DescriptionError(f"{where}an option is missing; give {', '.join(missing)}")
    rest = _rest_of(parameters.values())
    checked = {}
    for name, value in values.items():
        parameter = parameters.get(name, rest)
        hint = Any if parameter is None else _hint_of(parameter)
        checked[name] = _converted(value, hint)
        # Python's JSON reader accepts NaN, which JSON does not have and no option means.
        if isinstance(value, float) and math.isnan(value):
            raise DescriptionError(f"{where}{name} is {value}; give a number")
        # A default may contradict its annotation, as in `x: int = None`, which is not the user's
        # mistake.
        is_default = parameter is not None and value is parameter.default
        if not is_default:
            check_value(f"{where}{name}", checked[name], hint)
    return checked


def _rest_of(parameters: Iterable[inspect.Parameter]) -> inspect.Parameter | None:
    """The parameter that takes all further names, ``**options``."""
    for parameter in parameters:
        if parameter.kind is parameter.VAR_KEYWORD:
            return parameter
    return None


def _is_required(parameter: inspect.Parameter) -> bool:
    takes_rest = parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
    return parameter.default is parameter.empty and not takes_rest


def _hint_of(parameter: inspect.Parameter) -> Any:
    """Annotation of a parameter, or else the type of its default; any number where that is a whole
    one."""
    if parameter.annotation is not parameter.empty:
        # An annotation that is still text could not be evaluated, and so says nothing.
        return Any if isinstance(parameter.annotation, str) else parameter.annotation
    kind = type(parameter.default)
    return _HINT_OF_DEFAULT.get(kind, Any)


def _wanted(parameter: inspect.Parameter) -> str:
    """Name of a parameter, and what it wants, in words, if it says so."""
    hint = _hint_of(parameter)
    if hint is Any:
        return parameter.name
    return f"{parameter.name} ({_describe(hint)})"


def _converted(value: Any, hint: Any) -> Any:
    """A value from JSON as what an annotation wants, where that is the same thing written
    differently; else as it is."""
    hint = _without_remarks(hint)
    if _matches(value, hint):
        return value
    cls = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if cls in _UNIONS:
        # Several alternatives may fit, so the first one counts, in the order of the annotation.
        for part in parts:
            converted = _converted(value, part)
            if _matches(converted, hint):
                return converted
        return value
    if cls is tuple and isinstance(value, list):
        return _tuple_of(value, parts)
    # A command line reads `--option name=7` as a number, and `true` as a truth value, although a
    # text is wanted here.
    if cls is str and isinstance(value, int):
        return json.dumps(value)
    if isinstance(value, str) and isinstance(cls, type):
        if issubclass(cls, Path):
            return Path(value)
        if issubclass(cls, enum.Enum):
            return _member_of(cls, value)
    return value


def _tuple_of(values: list[Any], parts: tuple[Any, ...]) -> tuple[Any, ...]:
    """A list of JSON as the tuple of these annotations."""
    has_length = bool(parts) and parts[-1] is not ...
    kinds = parts if has_length else parts[:1] * len(values)
    # A list of the wrong length stays as it is, because the check then tells how many there should
    # be.
    if len(kinds) != len(values):
        return tuple(values)
    converted = map(_converted, values, kinds)
    return tuple(converted)


def _member_of(cls: type[enum.Enum], value: str) -> Any:
    """The member with this name or value, or else the value as it is, which the check refuses."""
    for member in cls:
        if value in (member.name, member.value):
            return member
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
        # Types are compared too, because 1 equals True.
        return any(type(value) is type(part) and value == part for part in parts)
    if cls is Any or not isinstance(cls, type):
        return True
    # In Python True counts as 1, but whoever wrote it meant no number.
    if cls in (int, float) and isinstance(value, bool):
        return False
    # A whole number is accepted as a float, as by type checkers.
    accepted: Any = int | float if cls is float else cls
    if not isinstance(value, accepted):
        return False
    return not parts or _items_match(value, cls, parts)


def _items_match(
    value: Any,
    cls: Any,
    parts: tuple[Any, ...],
) -> bool:
    """Whether what is in a container is of the types of its annotation."""
    if cls is dict:
        key_hint, item_hint = parts
        keys_match = all(_matches(key, key_hint) for key in value)
        return keys_match and all(_matches(item, item_hint) for item in value.values())
    has_any_length = cls is list or parts[-1] is ...
    if cls in (list, tuple) and has_any_length:
        return all(_matches(item, parts[0]) for item in value)
    if cls is tuple:
        has_length = len(value) == len(parts)
        return has_length and all(map(_matches, value, parts))
    # What is in other containers, and what a function takes, shows only when it is used.
    return True


def _without_remarks(hint: Any) -> Any:
    """The type of an ``Annotated`` one."""
    return hint.__origin__ if hasattr(hint, "__metadata__") else hint


def _describe(hint: Any) -> str:
    """The values that an annotation allows, in words."""
    hint = _without_remarks(hint)
    cls = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if cls in _UNIONS:
        # A message never advises to leave an option out, so None is not described.
        return _either(_describe(part) for part in parts if part is not type(None))
    if cls is tuple and parts:
        number = "several" if parts[-1] is ... else len(parts)
        return f"{number} values, each {_describe(parts[0])}"
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
    if not others:
        return last
    return f"{', '.join(others)} or {last}"


_UNIONS = (types.UnionType, typing.Union)
"""Origins of ``A | B`` and of ``Optional[A]``, which differ up to Python 3.13."""
_HINT_OF_DEFAULT: dict[Any, Any] = {
    bool: bool,
    # A default of 1 seldom means that 1.5 would be wrong.
    int: float,
    float: float,
    str: str,
    tuple: tuple,
}
"""What a parameter without annotation wants, by the type of its default."""
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
