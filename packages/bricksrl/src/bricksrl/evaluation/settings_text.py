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
    texts: dict[str, str] = {}
    for change in changes:
        name, equals, value = change.partition("=")
        if not equals:
            raise DescriptionError(f"'{change}' changes nothing; write NAME=VALUE, such as learning_rate=3e-4")
        texts[name.strip().replace("-", "_")] = value.strip()
    return _changed(settings, texts)


def read_settings(path: Path, settings: S) -> S:
    """A copy of the settings with the values of a JSON file, such as `bricksrl tune` writes; others are unchanged. Raises
    DescriptionError if the file cannot be read, or names an unknown setting or an invalid value."""
    try:
        data = json.loads(path.read_bytes())
    except OSError as error:
        raise DescriptionError(f"cannot read the settings {path} ({error.strerror}); give a JSON file") from None
    except (ValueError, RecursionError):
        raise DescriptionError(f'{path} is not JSON; write settings as {{"learning_rate": 3e-4}}') from None
    table = data.get("settings", data) if isinstance(data, dict) else None
    if not isinstance(table, dict):
        raise DescriptionError(f'{path} holds no names and values; write settings as {{"learning_rate": 3e-4}}')
    texts = {name: ",".join(map(str, value)) if isinstance(value, list) else str(value) for name, value in table.items()}
    return _changed(settings, texts)


def _changed(settings: S, texts: dict[str, str]) -> S:
    """A copy of the settings with values from texts, by name."""
    hints = typing.get_type_hints(type(settings))
    names = [field.name for field in dataclasses.fields(settings)]  # type: ignore[arg-type]
    for name in texts:
        if name not in names:
            raise DescriptionError(f"there is no setting '{name}'{hint(name, names)}; choose one of {', '.join(names)}")
    values = {name: _parsed(name, hints[name], text) for name, text in texts.items()}
    changed: S = dataclasses.replace(settings, **values)  # type: ignore[type-var]
    return changed


def _parsed(name: str, type_: Any, text: str) -> Any:
    origin = typing.get_origin(type_)
    if origin in (types.UnionType, typing.Union):
        rest = [option for option in typing.get_args(type_) if option is not type(None)]
        return None if text.lower() == "none" else _parsed(name, rest[0], text)
    if origin is Literal:
        choices = typing.get_args(type_)
        for choice in choices:
            if text == str(choice):
                return choice
        raise DescriptionError(f"{name} is '{text}'; choose one of {', '.join(map(str, choices))}")
    try:
        if origin is tuple:
            return tuple(typing.get_args(type_)[0](part) for part in text.strip("()[]").split(",") if part.strip())
        if type_ is bool:
            return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}[text.lower()]
        return type_(text)
    except (ValueError, KeyError):
        names = {int: "a whole number", float: "a number", bool: "true or false"}
        expected = names.get(type_, "numbers, such as 256,256")
        raise DescriptionError(f"{name} is '{text}'; give {expected}") from None
