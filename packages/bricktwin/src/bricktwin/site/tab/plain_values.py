"""Plain values for JSON: robots and scenes as dicts of their fields, and back, equal.

A dataclass or an enum has its class' name under ``is``; tuples become lists, and are tuples again
when they are read; bytes, such as the pixels of a picture, are text.
"""

import base64
import dataclasses
import enum
from typing import Any

import brickhub.robot
from brickhub.errors import TwinError
from bricktwin.twin import objects, physics, scene

_KIND = "is"
_BYTES = "bytes"
_MODULES = (brickhub.robot, objects, scene, physics)


def _classes() -> dict[str, type]:
    """Classes of all values, by name."""
    found: dict[str, type] = {}
    for module in _MODULES:
        for name, value in vars(module).items():
            is_enum = isinstance(value, type) and issubclass(value, enum.Enum)
            if is_enum or (isinstance(value, type) and dataclasses.is_dataclass(value)):
                found[name] = value
    return found


_CLASSES = _classes()


def plain(value: Any) -> Any:
    """A robot, a scene, physics, or a part of them, for JSON. Raises TwinError for other values,
    such as functions."""
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if isinstance(value, bytes):
        return {_KIND: _BYTES, "base64": base64.b64encode(value).decode()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    kind = type(value).__name__
    if _CLASSES.get(kind) is type(value):
        if isinstance(value, enum.Enum):
            return {_KIND: kind, "name": value.name}
        names = [field.name for field in dataclasses.fields(_CLASSES[kind])]
        return {_KIND: kind, **{name: plain(getattr(value, name)) for name in names}}
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    raise TwinError(f"{value!r:.60} cannot be written to a file; give plain values")


def read_plain(value: Any) -> Any:
    """What :func:`plain` was given."""
    if isinstance(value, list):
        return tuple(read_plain(item) for item in value)
    if not isinstance(value, dict):
        return value
    kind = value.get(_KIND)
    if kind is None:
        return {name: read_plain(item) for name, item in value.items()}
    if kind == _BYTES:
        return base64.b64decode(value["base64"])
    known = _CLASSES[kind]
    if issubclass(known, enum.Enum):
        return known[value["name"]]
    fields = {name: read_plain(item) for name, item in value.items() if name != _KIND}
    return known(**fields)
