"""Classes of a hub: single inheritance, no attribute hooks, no descriptors, ``super()`` without ``object``."""

from __future__ import annotations

import builtins
from collections.abc import Callable
from types import FunctionType
from typing import Any

_MIRRORED = {"__lt__": "__gt__", "__gt__": "__lt__", "__le__": "__ge__", "__ge__": "__le__"}
_UNUSED = (
    *("__setattr__", "__delattr__", "__getattribute__", "__del__", "__get__", "__set__", "__delete__", "__set_name__"),
    *("__iand__", "__ior__", "__ixor__", "__missing__"),
)
_MADE_BY_CPYTHON = frozenset(
    (
        *("__dict__", "__weakref__", "__doc__", "__module__", "__qualname__", "__slotnames__", "__annotations__"),
        *("__firstlineno__", "__static_attributes__"),  # since Python 3.13
        *("__annotate__", "__annotate_func__", "__annotations_cache__"),  # since Python 3.14
    )
)
FIRMWARE = __name__.partition(".")[0] + "."
"""Beginning of the names of modules with native classes."""


def build_class(body: Any, class_name: str, *bases: Any, **keywords: Any) -> Any:
    """Implementation of the ``class`` statement. Raises NotImplementedError if there are several bases."""
    if len(bases) > 1:
        raise NotImplementedError("multiple inheritance not supported")
    cls = builtins.__build_class__(body, class_name, *bases, **keywords)
    for method in _UNUSED:
        if method in cls.__dict__:
            delattr(cls, method)
    for name, value in list(cls.__dict__.items()):
        if isinstance(value, FunctionType) and value.__module__.startswith(FIRMWARE):
            setattr(cls, name, staticmethod(value))  # builtins do not become methods
    for method, mirrored in _MIRRORED.items():
        if getattr(cls, mirrored) is not getattr(object, mirrored) and getattr(cls, method) is getattr(object, method):
            setattr(cls, method, _refusal(method))
    if cls.__init__ is object.__init__ and cls.__new__ is object.__new__:
        cls.__init__ = _ignore_arguments
    return cls


def _ignore_arguments(self: Any, *args: Any, **kwargs: Any) -> None:
    """A class without ``__init__`` ignores all arguments on a hub."""


def _refusal(method: str) -> Callable[[Any, Any], Any]:
    """A missing comparison; unlike CPython, a hub does not try the reflected one.

    If the other operand's class is a base class, CPython asks this one first, although it is second in the program.
    """

    def refuse(self: Any, other: Any) -> Any:
        if isinstance(self, type(other)) and type(self) is not type(other):
            return NotImplemented
        raise TypeError(f"unsupported types for {method}: '{type(self).__name__}', '{type(other).__name__}'")

    return refuse


def is_native(kind: type) -> bool:
    """Whether a class is not a program's."""
    return kind.__module__.startswith((FIRMWARE, "builtins", "_io"))


def defines(kind: type, name: str) -> bool:
    """Whether a name stands in the body of a program's class."""
    if is_native(kind) or name in _MADE_BY_CPYTHON or name not in kind.__dict__:
        return False
    value = kind.__dict__[name]
    is_own = not (isinstance(value, FunctionType) and value.__module__.startswith(FIRMWARE))
    return is_own and not (name == "__hash__" and value is None)


class HubStaticMethod(staticmethod):  # type: ignore[type-arg]
    """``staticmethod``: on a hub it can be called through a class only."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        raise TypeError("'staticmethod' object isn't callable")


class HubSuper(super):
    """``super()`` over the program's and native classes; ``object`` has no methods."""

    def __getattribute__(self, name: str) -> Any:
        instance, owner = super().__getattribute__("__self__"), super().__getattribute__("__thisclass__")
        ancestors = (instance if isinstance(instance, type) else type(instance)).__mro__
        for kind in ancestors[ancestors.index(owner) + 1 : -1]:
            if defines(kind, name) or (is_native(kind) and name in kind.__dict__ and (name == "__init__" or name[:2] != "__")):
                return super().__getattribute__(name)
        raise AttributeError(f"'super' object has no attribute '{name}'")


HubSuper.__name__ = HubSuper.__qualname__ = "super"
HubStaticMethod.__name__ = HubStaticMethod.__qualname__ = "staticmethod"
