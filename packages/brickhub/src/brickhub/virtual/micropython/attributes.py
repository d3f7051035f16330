"""Classes of a hub and attributes of its types.

Classes have single inheritance, no attribute hooks, no descriptors, ``super()`` without ``object``;
attributes are restricted to those that exist on a hub.
"""

import builtins
import inspect
from collections.abc import Callable
from types import BuiltinFunctionType, FunctionType, GeneratorType, MethodType, ModuleType
from typing import Any

from brickhub.virtual.micropython.containers import HubDict, HubSet
from brickhub.virtual.micropython.exceptions import (
    CATCHABLE,
    FIRMWARE,
    HubOSError,
    SwitchedOff,
    function_name,
    is_native,
)
from brickhub.virtual.micropython.iterables import is_dropped
from brickhub.virtual.micropython.streams import BytesIO, HubBytearray
from brickhub.virtual.micropython.text import type_name

_MIRRORED = {"__lt__": "__gt__", "__gt__": "__lt__", "__le__": "__ge__", "__ge__": "__le__"}
"""The comparison that CPython asks of the other operand."""
_UNUSED = (
    "__setattr__",
    "__delattr__",
    "__getattribute__",
    "__del__",
    "__get__",
    "__set__",
    "__delete__",
    "__set_name__",
    "__iand__",
    "__ior__",
    "__ixor__",
    "__missing__",
)
"""Methods that CPython calls and a hub does not."""
_MADE_BY_CPYTHON = (
    "__dict__",
    "__weakref__",
    "__doc__",
    "__module__",
    "__qualname__",
    "__slotnames__",
    "__annotations__",
    # CPython 3.13 added these.
    "__firstlineno__",
    "__static_attributes__",
    # CPython 3.14 added these.
    "__annotate__",
    "__annotate_func__",
    "__annotations_cache__",
)
"""Names in a class that its body does not have."""
_SEQUENCE_TEXT = (
    "count endswith find format index isalpha isdigit islower isspace isupper join lower lstrip "
    "replace rfind rindex rsplit "
    "rstrip split startswith strip upper"
)
_PRESENT: dict[type, str] = {
    str: _SEQUENCE_TEXT,
    bytes: _SEQUENCE_TEXT,
    HubBytearray: _SEQUENCE_TEXT + " append extend",
    int: "to_bytes from_bytes",
    bool: "",
    float: "",
    complex: "real imag",
    range: "start stop step",
    slice: "start stop step",
    memoryview: "",
    GeneratorType: "send throw close",
    BytesIO: "read readinto readline write seek tell flush close getvalue",
    BaseException: "args",
    HubOSError: "args errno",
    list: "append clear copy count extend index insert pop remove reverse sort",
    tuple: "count index",
    HubDict: "clear copy fromkeys get items keys pop popitem setdefault update values",
    HubSet: "add clear copy difference difference_update discard intersection "
    "intersection_update isdisjoint issubset issuperset "
    "pop remove symmetric_difference symmetric_difference_update union update",
}
"""Methods and attributes that a hub has, of classes of which CPython has more."""


def _only_on_cpython(kind: type) -> frozenset[str]:
    names = {name for name in dir(kind) if not name.startswith("__")}
    return frozenset(names.difference(_PRESENT[kind].split()))


_HIDDEN = {kind: _only_on_cpython(kind) for kind in _PRESENT}
_SPECIAL: dict[type, tuple[str, ...]] = {
    object: ("__next__", "__enter__", "__exit__"),
    HubDict: ("__getitem__", "__setitem__", "__delitem__"),
    HubSet: ("__contains__",),
}
"""Special names that native objects have on a hub too, if they have them here."""
_FIRST_ARGUMENT = frozenset(["errno", "value"])
"""Attributes of all exceptions on a hub, not only ``OSError`` and ``StopIteration``."""
_CLASS_ATTRIBUTES = ("__module__", "__qualname__")
"""Attributes of a program's classes; the second is the name without its enclosing scopes."""
_OF_MODULES = frozenset(["__builtins__", *vars(ModuleType("")).keys() - {"__name__"}])
"""Names that CPython puts into modules."""
_HIDDEN_NAMES = _FIRST_ARGUMENT.union(*_HIDDEN.values())
_WITH_KEYWORDS = frozenset(["sort", "update", "sorted", "max", "min"])
"""The few builtin functions of a hub that take keywords."""
_KINDS_WITHOUT_KEYWORDS = frozenset(
    [
        bool,
        HubBytearray,
        complex,
        enumerate,
        HubSet,
        list,
        map,
        range,
        reversed,
        slice,
        tuple,
        type,
        zip,
    ]
)


def build_class(
    body: Any,
    class_name: str,
    *bases: Any,
    **keywords: Any,
) -> Any:
    """Implementation of the ``class`` statement. Raises NotImplementedError if there are several
    bases."""
    if len(bases) > 1:
        raise NotImplementedError("multiple inheritance not supported")
    cls = builtins.__build_class__(
        body,
        class_name,
        *bases,
        **keywords,
    )
    # CPython looks for these in the class, so they have to be taken out of it.
    for method in _UNUSED:
        if method in cls.__dict__:
            delattr(cls, method)
    # The firmware's functions are Python functions here, and would become methods of a class that
    # keeps them. No builtin function does that.
    for name, value in list(cls.__dict__.items()):
        if isinstance(value, FunctionType) and value.__module__.startswith(FIRMWARE):
            setattr(cls, name, staticmethod(value))
    for method, mirrored in _MIRRORED.items():
        has_mirrored = getattr(cls, mirrored) is not getattr(object, mirrored)
        has_method = getattr(cls, method) is not getattr(object, method)
        if has_mirrored and not has_method:
            setattr(cls, method, _refusal(method))
    # On a hub, a class without `__init__` ignores all arguments.
    if cls.__init__ is object.__init__ and cls.__new__ is object.__new__:
        cls.__init__ = lambda self, *args, **kwargs: None
    return cls


def _refusal(method: str) -> Callable[[Any, Any], Any]:
    """A missing comparison; unlike CPython, a hub does not try the reflected one.

    If the other operand's class is a base class, CPython asks this one first, although it is second
    in the program.
    """

    def refuse(self: Any, other: Any) -> Any:
        if isinstance(self, type(other)) and type(self) is not type(other):
            return NotImplemented
        raise TypeError(
            f"unsupported types for {method}: '{type(self).__name__}', '{type(other).__name__}'"
        )

    return refuse


def defines(kind: type, name: str) -> bool:
    """Whether a name stands in the body of a program's class."""
    if is_native(kind) or name in _MADE_BY_CPYTHON or name not in kind.__dict__:
        return False
    value = kind.__dict__[name]
    is_of_firmware = isinstance(value, FunctionType) and value.__module__.startswith(FIRMWARE)
    # CPython sets `__hash__` to None in a class that has only `__eq__`.
    is_made_unhashable = name == "__hash__" and value is None
    return not is_of_firmware and not is_made_unhashable


class HubStaticMethod(staticmethod):  # type: ignore[type-arg]
    """``staticmethod``: on a hub it can be called through a class only."""

    def __call__(
        self,
        *args: Any,
        **kwargs: Any,
    ) -> Any:
        raise TypeError("'staticmethod' object isn't callable")


class HubSuper(super):
    """``super()`` over the program's and native classes; ``object`` has no methods."""

    def __getattribute__(self, name: str) -> Any:
        instance = super().__getattribute__("__self__")
        owner = super().__getattribute__("__thisclass__")
        # In a class method, `instance` is the class itself.
        kind_of_instance = instance if isinstance(instance, type) else type(instance)
        ancestors = kind_of_instance.__mro__
        # The last ancestor, `object`, has no methods on a hub and is left out.
        for kind in ancestors[ancestors.index(owner) + 1 : -1]:
            is_public = name == "__init__" or name[:2] != "__"
            is_in_native = is_native(kind) and name in kind.__dict__ and is_public
            if is_in_native or defines(kind, name):
                return super().__getattribute__(name)
        raise AttributeError(f"'super' object has no attribute '{name}'")


HubSuper.__name__ = HubSuper.__qualname__ = "super"
HubStaticMethod.__name__ = HubStaticMethod.__qualname__ = "staticmethod"


def may_be_hidden(name: str) -> bool:
    """Whether :func:`visible_attribute` has to look for an attribute, as some type has it only on
    CPython."""
    return name in _HIDDEN_NAMES or (name.startswith("__") and name.endswith("__"))


def visible_attribute(value: Any, name: str) -> Any:
    """``value.name`` for a name that a hub's type may lack. Raises AttributeError as on the hub."""
    owner = value if isinstance(value, type) else type(value)
    is_of_error = isinstance(value, BaseException)
    if is_of_error and name in _FIRST_ARGUMENT and not hasattr(value, name):
        return value.args[0] if value.args else None
    if name in _CLASS_ATTRIBUTES and not is_native(owner):
        return owner.__module__ if name == "__module__" else owner.__name__
    if owner is HubSuper or _is_visible(value, owner, name):
        return getattr(value, name)
    # CPython calls the program's `__getattr__` only where it finds nothing itself.
    is_class = owner is value
    if not is_class and any(defines(kind, "__getattr__") for kind in owner.__mro__):
        return value.__getattr__(name)
    kind_name = type_name(owner)
    subject = f"type object '{kind_name}'" if is_class else f"'{kind_name}' object"
    raise AttributeError(f"{subject} has no attribute '{name}'")


def _is_visible(
    value: Any,
    owner: type,
    name: str,
) -> bool:
    if any(defines(kind, name) for kind in owner.__mro__):
        return True
    if owner is not value and name in getattr(value, "__dict__", ()):
        return name not in _OF_MODULES
    if name.startswith("__") and name.endswith("__"):
        return hasattr(value, name) and any(
            name in _SPECIAL.get(kind, ()) for kind in owner.__mro__
        )
    return not any(name in _HIDDEN.get(kind, ()) for kind in owner.__mro__)


def store_attribute(
    value: Any,
    owner: Any,
    name: str,
) -> None:
    """``owner.name = value``; fails for functions, modules, types and firmware objects. Raises
    AttributeError as on the hub."""
    if _is_closed(owner):
        kind = type(owner)
        label = function_name(owner) if kind is FunctionType else kind.__name__
        raise AttributeError(f"'{label}' object has no attribute '{name}'")
    setattr(owner, name, value)


def _is_closed(owner: Any) -> bool:
    """Whether a program cannot set attributes of a value."""
    kind = type(owner)
    if kind is FunctionType:
        return True
    # Few classes of the firmware have attributes that can be set.
    if kind.__module__.startswith(FIRMWARE) and "__setattr__" not in kind.__dict__:
        return True
    # A module without builtins is the firmware's; those of the program have them.
    if kind is ModuleType and "__builtins__" not in owner.__dict__:
        return True
    if isinstance(owner, type) and is_native(owner):
        return True
    # CPython's exceptions accept attributes, but a hub's do not.
    return isinstance(owner, BaseException) and kind.__module__ == "builtins"


def directory(value: Any) -> list[str]:
    """``dir(value)``."""
    if isinstance(value, ModuleType):
        return sorted(name for name in vars(value) if name != "__builtins__" and "@" not in name)
    kind = value if isinstance(value, type) else type(value)
    is_class = kind is value
    # Some classes of the firmware list their attributes themselves; `object` is left out, because
    # it lists all.
    lists_itself = any("__dir__" in base.__dict__ for base in kind.__mro__[:-1])
    if lists_itself and not is_class:
        return list(value.__dir__())
    names = {name for name in dir(value) if not name.startswith("_")}
    names.difference_update(_HIDDEN.get(kind, ()))
    # For a program's class, a hub lists all names, even those that begin with an underscore.
    for base in kind.__mro__:
        if is_native(base):
            continue
        names.update(name for name in base.__dict__ if defines(base, name))
        names.update(_CLASS_ATTRIBUTES)
        if base is kind and not is_class:
            names.update(getattr(value, "__dict__", {}))
    return sorted(name for name in names if "@" not in name)


def with_keywords(function: Any) -> Any:
    """A callable that refuses wrong keyword arguments as on a hub. Few builtins accept any; the
    firmware's functions look for those that they require first (``mp_arg_parse_all``)."""
    is_class = isinstance(function, type)
    if is_class and function in _KINDS_WITHOUT_KEYWORDS:
        return _without_keywords(function)
    method = function.__func__ if isinstance(function, MethodType) else function
    called: Any = function.__init__ if is_class else method
    if type(called) is BuiltinFunctionType and called.__name__ not in _WITH_KEYWORDS:
        return _without_keywords(function)
    if isinstance(called, FunctionType):
        called = inspect.unwrap(called)
    # CPython itself refuses wrong keywords of a program's function, and the message is reworded as
    # the hub's.
    if not isinstance(called, FunctionType) or not called.__module__.startswith(FIRMWARE):
        return function
    code = called.__code__
    # A bound method already has `self`, so that does not count.
    bound = called is not function
    takes_any_keyword = code.co_flags & inspect.CO_VARKEYWORDS
    takes_any_number = code.co_flags & inspect.CO_VARARGS
    first_with_name = max(code.co_posonlyargcount, bound)
    # This also holds where `self` is the first of any number of arguments.
    has_named = first_with_name != code.co_argcount
    if not (has_named or code.co_kwonlyargcount or takes_any_keyword):
        return _without_keywords(function)
    # Functions with other kinds of arguments look for them in their own ways, and are left alone.
    is_special = takes_any_number or takes_any_keyword
    if is_special or code.co_posonlyargcount or code.co_kwonlyargcount:
        return function
    names = code.co_varnames[bound : code.co_argcount]
    optional = len(called.__defaults__ or ())
    return _with_named_arguments(function, names, len(names) - optional)


def _with_named_arguments(
    function: Callable[..., Any],
    names: tuple[str, ...],
    required: int,
) -> Callable[..., Any]:
    """The function, as one of the firmware with these arguments, of which the first ones are
    ``required``."""

    # The refusals come in the firmware's order.
    def call(*args: Any, **kwargs: Any) -> Any:
        count = len(args)
        for name in names[count:required]:
            if name not in kwargs:
                raise TypeError(f"'{name}' argument required")
        if count > len(names):
            raise TypeError("extra positional arguments given")
        remaining = names[count:]
        if kwargs.keys() - {*remaining}:
            raise TypeError("extra keyword arguments given")
        return function(*args, **kwargs)

    return call


def _without_keywords(function: Any) -> Any:
    """The function, as one that refuses keyword arguments."""

    def call(*args: Any, **kwargs: Any) -> Any:
        if kwargs:
            raise TypeError("function doesn't take keyword arguments")
        return function(*args)

    return call


class Manager:
    """Context manager of a ``with`` statement as on a hub: a pair of attributes, which see no
    traceback.

    Args:
        value: the value of the expression.
        reword: gives an error the hub's message.
    """

    def __init__(
        self,
        value: Any,
        reword: Callable[[BaseException], BaseException],
    ) -> None:
        # `__exit__` is looked up first, because a hub's message for a value without both names that
        # one.
        self._exit = visible_attribute(value, "__exit__")
        self._enter = visible_attribute(value, "__enter__")
        self._reword = reword

    def __enter__(self) -> Any:
        return self._enter()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: object,
    ) -> Any:
        # Blocks are not left by a hub that is switched off, nor by a generator that is dropped.
        is_of_dropped = isinstance(error, GeneratorExit) and is_dropped()
        if isinstance(error, SwitchedOff) or is_of_dropped:
            return None
        if error is None or isinstance(error, CATCHABLE):
            return self._exit(kind, error and self._reword(error), None)
        # The program is being stopped from outside, which it sees as the button. It cannot prevent
        # that, whatever it answers.
        self._exit(SystemExit, SystemExit(), None)
        return None


ATTRIBUTE_FUNCTIONS: dict[str, Any] = {
    "@attr": visible_attribute,
    "@store": store_attribute,
    "@keywords": with_keywords,
    "@with": Manager,
    "super": HubSuper,
    "staticmethod": HubStaticMethod,
    "__build_class__": build_class,
}
"""Functions and classes by their names in the transformed program."""
