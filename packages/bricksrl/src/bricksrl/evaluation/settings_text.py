"""Parsing of an agent's settings, from the command line or a JSON file. Importing this loads no
torch."""

import ast
import dataclasses
import json
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from brickhub.fields import check_fields
from brickhub.files import reading
from bricksrl.errors import DescriptionError, hint
from bricksrl.training.config import code_in_settings
from bricksrl.training.trust import require_trusted

S = TypeVar("S")
SETTINGS_REMEDY = 'write settings as JSON, {"learning_rate": 3e-4}'
"""Remedy for a file of settings that cannot be read."""
_WORDS = {"true": True, "yes": True, "false": False, "no": False, "none": None}


def with_changes(settings: S, changes: Iterable[str]) -> S:
    """A copy of the settings, a frozen dataclass, with changes such as ``"learning_rate=3e-4"`` or
    ``"hidden=128,128"``. Raises DescriptionError if there is no such setting, or its value is
    invalid."""
    texts = dict[str, Any]()
    for change in changes:
        name, equals, value = change.partition("=")
        if not equals:
            raise DescriptionError(
                f"'{change}' changes nothing; write NAME=VALUE, such as learning_rate=3e-4"
            )
        texts[name.strip().replace("-", "_")] = value.strip()
    return _changed(settings, texts)


def read_settings(path: Path, settings: S) -> S:
    """A copy of the settings with the values of a JSON file, such as `bricksrl tune` writes; others
    are unchanged. Raises DescriptionError if the file cannot be read, or names an unknown setting
    or an invalid value, RunError if it names code, and was made elsewhere or changed."""
    with reading(
        "the settings",
        path,
        DescriptionError,
        SETTINGS_REMEDY,
    ):
        text = path.read_bytes()
        data = json.loads(text)
        table = dict(data.get("settings", data))
    changed = _changed(settings, table)
    read = {name: getattr(changed, name) for name in table}
    require_trusted(path, text, code_in_settings(read, type(settings)))
    return changed


def _changed(settings: S, values: Mapping[str, Any]) -> S:
    """A copy of the settings with other values, which may be texts."""
    hints = typing.get_type_hints(type(settings))
    fields = dataclasses.fields(settings)  # type: ignore[arg-type]
    names = [field.name for field in fields]
    for name in values:
        if name not in names:
            raise DescriptionError(
                f"there is no setting '{name}'{hint(name, names)}; choose one of {', '.join(names)}"
            )
    read = {name: _read(value, hints[name]) for name, value in values.items()}
    check_fields(type(settings), read)
    changed: S = dataclasses.replace(settings, **read)  # type: ignore[type-var]
    return changed


def _read(value: Any, type_: Any) -> Any:
    """A value, or the one that a text means, of an annotated type as far as it fits."""
    types = (type_, *typing.get_args(type_))
    # A text stays a text where the setting may be one, or where it is one of its literals.
    is_wanted = str in types or value in types
    if isinstance(value, str) and not is_wanted:
        # Python's own notation is accepted, so that --set takes what --help shows.
        try:
            value = ast.literal_eval(value or "()")
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            value = _WORDS.get(value.lower(), value)
    if typing.get_origin(type_) is tuple and not isinstance(value, str):
        return tuple(value) if isinstance(value, list | tuple) else (value,)
    # JSON and Python write 1 for 1.0, but a checkpoint tells them apart.
    if type(value) is int and float in types:
        return float(value)
    if type_ is bool and value in (0, 1):
        return bool(value)
    return value
