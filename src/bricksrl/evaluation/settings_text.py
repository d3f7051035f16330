"""Parsing of an agent's settings, from the command line or a JSON file. Importing this loads no torch."""

from __future__ import annotations

import dataclasses
import json
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, TypeVar

from bricksrl.errors import DescriptionError, hint

S = TypeVar("S")


def with_changes(settings: S, changes: Iterable[str]) -> S:
    """A copy of the settings, a frozen dataclass, with changes such as ``"learning_rate=3e-4"`` or ``"hidden=128,128"``. Raises
    DescriptionError if there is no such setting, or its value is invalid."""
    given: dict[str, str] = {}
    for change in changes:
        name, equals, value = change.partition("=")
        if not equals:
            raise DescriptionError(f"'{change}' changes nothing; write NAME=VALUE, such as learning_rate=3e-4")
        given[name.strip().replace("-", "_")] = value.strip()
    kinds = _kinds(settings, given)
    return _replaced(settings, {name: _parsed(name, kinds[name], text) for name, text in given.items()})


def read_settings(path: Path, settings: S) -> S:
    """A copy of the settings with the values of a JSON file, such as `bricksrl tune` writes; others are unchanged. Raises
    DescriptionError if the file cannot be read, or names an unknown setting or an invalid value."""
    try:
        data = json.loads(path.read_text())
    except OSError as error:
        raise DescriptionError(f"cannot read the settings {path} ({error.strerror}); give a JSON file") from None
    except (ValueError, RecursionError):
        raise DescriptionError(f'{path} is not JSON; write settings as {{"learning_rate": 3e-4}}') from None
    given = data.get("settings", data) if isinstance(data, dict) else None
    if not isinstance(given, dict):
        raise DescriptionError(f'{path} holds no names and values; write settings as {{"learning_rate": 3e-4}}')
    kinds = _kinds(settings, given)
    values = {name: _parsed(name, kinds[name], _as_text(value)) for name, value in given.items()}
    return _replaced(settings, values)


def _kinds(settings: Any, names: Iterable[str]) -> dict[str, Any]:
    hints = typing.get_type_hints(type(settings))
    kinds = {field.name: hints[field.name] for field in dataclasses.fields(settings)}
    for name in names:
        if name not in kinds:
            raise DescriptionError(f"there is no setting '{name}'{hint(name, kinds)}; choose one of {', '.join(kinds)}")
    return kinds


def _replaced(settings: S, values: dict[str, Any]) -> S:
    changed: S = dataclasses.replace(settings, **values)  # type: ignore[type-var]
    return changed


def _as_text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _parsed(name: str, kind: Any, text: str) -> Any:
    origin = typing.get_origin(kind)
    if origin in (types.UnionType, typing.Union):
        rest = [one for one in typing.get_args(kind) if one is not type(None)]
        return None if text.lower() == "none" else _parsed(name, rest[0], text)
    if origin is Literal:
        choices = typing.get_args(kind)
        for choice in choices:
            if text == str(choice):
                return choice
        raise DescriptionError(f"{name} is '{text}'; choose one of {', '.join(map(str, choices))}")
    try:
        if origin is tuple:
            return tuple(typing.get_args(kind)[0](part) for part in text.strip("()[]").split(",") if part.strip())
        if kind is bool:
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[text.lower()]
        return kind(text)
    except (ValueError, KeyError):
        words = {int: "a whole number", float: "a number", bool: "true or false"}
        wanted = words.get(kind, "numbers, such as 256,256")
        raise DescriptionError(f"{name} is '{text}'; give {wanted}") from None
