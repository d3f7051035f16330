"""Attributes of types, restricted to those that exist on a hub."""

from __future__ import annotations

import inspect
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

from bricksrl.virtual_hub.micropython.byte_array import HubBytearray
from bricksrl.virtual_hub.micropython.classes import has_initializer
from bricksrl.virtual_hub.micropython.containers import HubDict, HubSet

_SEQUENCE_TEXT = (
    "count endswith find format index isalpha isdigit islower isspace isupper join lower lstrip replace rfind rindex rsplit "
    "rstrip split startswith strip upper"
)
_PRESENT: dict[type, str] = {
    str: _SEQUENCE_TEXT,
    bytes: _SEQUENCE_TEXT,
    HubBytearray: _SEQUENCE_TEXT + " append extend",
    int: "to_bytes from_bytes",
    bool: "to_bytes from_bytes",
    float: "",
    complex: "real imag",
    list: "append clear copy count extend index insert pop remove reverse sort",
    tuple: "count index",
    HubDict: "clear copy fromkeys get items keys pop popitem setdefault update values",
    HubSet: "add clear copy difference difference_update discard intersection intersection_update isdisjoint issubset issuperset "
    "pop remove symmetric_difference symmetric_difference_update union update",
}
_HIDDEN = {
    kind: frozenset(name for name in dir(kind) if not name.startswith("__")) - frozenset(names.split())
    for kind, names in _PRESENT.items()
}
_HIDDEN_SPECIAL = frozenset(
    """
    __name__ __qualname__ __dict__ __doc__ __module__ __bases__ __mro__ __subclasses__ __code__ __defaults__ __globals__
    __annotations__ __wrapped__ __closure__ __kwdefaults__ __file__ with_traceback __traceback__ __cause__ __context__
    """.split()  # noqa: SIM905  a list would take a line for each
)
_FIRST_ARGUMENT = frozenset(["errno", "value"])
"""Attributes of all exceptions on a hub, not only ``OSError`` and ``StopIteration``."""
_CLASS_ATTRIBUTES = ("__module__", "__qualname__")
"""Attributes of a program's classes; the second is the name without its enclosing scopes."""
_FIRMWARE = "bricksrl."
HIDDEN_NAMES = frozenset(["__class__", "__init__"]).union(_FIRST_ARGUMENT, *_HIDDEN.values(), _HIDDEN_SPECIAL)


def visible_attribute(value: Any, name: str) -> Any:
    """``value.name`` for a name that a hub's type may lack. Raises AttributeError as on the hub."""
    if isinstance(value, type):
        owner, message = value, f"type object '{value.__name__}' has no attribute '{name}'"
    else:
        owner, message = type(value), f"'{type(value).__name__}' object has no attribute '{name}'"
    if name in _HIDDEN.get(owner, ()) or name == "__class__":
        raise AttributeError(message)
    if name in _CLASS_ATTRIBUTES and owner.__module__ != "builtins" and not owner.__module__.startswith(_FIRMWARE):
        return owner.__module__ if name == "__module__" else owner.__name__
    hides_special = isinstance(value, type | FunctionType | BaseException) or (
        isinstance(value, ModuleType) and name != "__name__"
    )
    if name in _HIDDEN_SPECIAL and (hides_special or name == "__dict__"):
        raise AttributeError(message)
    if name == "__init__" and isinstance(value, type) and not has_initializer(value):
        raise AttributeError(message)
    if name in _FIRST_ARGUMENT and isinstance(value, BaseException) and not hasattr(value, name):
        return value.args[0] if value.args else None
    return getattr(value, name)


def store_attribute(value: Any, owner: Any, name: str) -> None:
    """``owner.name = value``; fails for functions, modules, types and firmware objects. Raises AttributeError as on the hub."""
    kind = type(owner)
    is_closed = (
        kind is FunctionType
        or (kind.__module__.startswith(_FIRMWARE) and "__setattr__" not in kind.__dict__)
        or (kind is ModuleType and "__builtins__" not in owner.__dict__)
        or (isinstance(owner, type) and (owner.__module__ == "builtins" or owner.__module__.startswith(_FIRMWARE)))
        or (isinstance(owner, BaseException) and kind.__module__ == "builtins")
    )
    if is_closed:
        raise AttributeError(f"'{kind.__name__}' object has no attribute '{name}'")
    setattr(owner, name, value)


def directory(value: Any) -> list[str]:
    """``dir(value)``."""
    kind = value if isinstance(value, type) else type(value)
    if any("__dir__" in base.__dict__ for base in kind.__mro__[:-1]) and kind is not value:
        return list(value.__dir__())
    names = {name for name in dir(value) if not name.startswith("_") and name not in _HIDDEN.get(kind, ())}
    for base in kind.__mro__:
        if base.__module__ != "builtins" and not base.__module__.startswith(_FIRMWARE):
            names |= base.__dict__.keys() - {"__dict__", "__weakref__", "__doc__", "__slotnames__"} | {"__qualname__"}
            names |= getattr(value, "__dict__", {}).keys() if base is kind and value is not kind else set()
            names -= {"__init__"} - ({"__init__"} if has_initializer(kind) else set())
    if isinstance(value, ModuleType):
        names.add("__name__")
    return sorted(name for name in names if "@" not in name)


_WITH_KEYWORDS = frozenset(["sort", "update", "sorted", "max", "min"])
_KINDS_WITHOUT_KEYWORDS = frozenset(
    [bool, HubBytearray, complex, enumerate, HubSet, list, map, range, reversed, slice, tuple, type, zip]
)


def with_keywords(function: Any) -> Any:
    """A callable that accepts keyword arguments, which few builtins do. Raises TypeError if it accepts none."""
    if isinstance(function, FunctionType):
        code = function.__code__
        accepts_keywords = (
            code.co_argcount > code.co_posonlyargcount or code.co_kwonlyargcount or code.co_flags & inspect.CO_VARKEYWORDS
        )
        refuses = function.__module__.startswith(_FIRMWARE) and not accepts_keywords
    elif isinstance(function, type):
        refuses = function in _KINDS_WITHOUT_KEYWORDS
    else:
        refuses = type(function) is BuiltinFunctionType and function.__name__ not in _WITH_KEYWORDS
    if refuses:
        raise TypeError("function doesn't take keyword arguments")
    return function
