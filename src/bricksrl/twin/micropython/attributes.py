"""Attributes that CPython's types have and a hub's have not."""

from __future__ import annotations

from types import FunctionType
from typing import Any

_SEQUENCE_TEXT = (
    "count endswith find format index isalpha isdigit islower isspace isupper join lower lstrip replace rfind rindex rsplit "
    "rstrip split startswith strip upper"
)
_PRESENT: dict[type, str] = {
    str: _SEQUENCE_TEXT,
    bytes: _SEQUENCE_TEXT,
    bytearray: _SEQUENCE_TEXT + " append extend",
    int: "to_bytes from_bytes",
    bool: "to_bytes from_bytes",
    float: "",
    complex: "real imag",
    list: "append clear copy count extend index insert pop remove reverse sort",
    tuple: "count index",
    dict: "clear copy fromkeys get items keys pop popitem setdefault update values",
    set: "add clear copy difference difference_update discard intersection intersection_update isdisjoint issubset issuperset "
    "pop remove symmetric_difference symmetric_difference_update union update",
}
_HIDDEN = {
    kind: frozenset(name for name in dir(kind) if not name.startswith("__")) - frozenset(names.split())
    for kind, names in _PRESENT.items()
}
_HIDDEN_SPECIAL = frozenset(
    [
        "__name__",
        "__qualname__",
        "__dict__",
        "__doc__",
        "__module__",
        "__bases__",
        "__mro__",
        "__subclasses__",
        "__code__",
        "__defaults__",
        "__globals__",
        "__annotations__",
        "__wrapped__",
        "__closure__",
        "__kwdefaults__",
        "__file__",
        "with_traceback",
        "__traceback__",
        "__cause__",
        "__context__",
    ]
)
HIDDEN_NAMES = frozenset(["__class__"]).union(*_HIDDEN.values(), _HIDDEN_SPECIAL)


def visible_attribute(value: Any, name: str) -> Any:
    """``value.name``, where the name is one that a hub's type may lack.

    Raises:
        AttributeError: as on the hub.
    """
    if isinstance(value, type):
        owner, message = value, f"type object '{value.__name__}' has no attribute '{name}'"
    else:
        owner, message = type(value), f"'{type(value).__name__}' object has no attribute '{name}'"
    if name in _HIDDEN.get(owner, ()) or name == "__class__":
        raise AttributeError(message)
    if name in _HIDDEN_SPECIAL and isinstance(value, type | FunctionType | BaseException):
        raise AttributeError(message)
    return getattr(value, name)
