"""``str`` and ``repr`` of values on a hub."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from inspect import CO_GENERATOR
from types import (
    BuiltinFunctionType,
    FunctionType,
    GeneratorType,
    MethodDescriptorType,
    MethodType,
    ModuleType,
    WrapperDescriptorType,
)
from typing import Any

from brickhub.virtual.micropython.containers import DictView, HubDict, HubSet, Mapped, TableIterator
from brickhub.virtual.micropython.exceptions import ERROR_NAMES, FIRMWARE, class_name
from brickhub.virtual.micropython.floats import float_text, format_float
from brickhub.virtual.micropython.streams import HubBytearray

_ESCAPES = {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t", ord("\\"): "\\\\"}
_PLAIN = (BaseException.__str__, OSError.__str__, KeyError.__str__, SyntaxError.__str__)


def text(value: Any) -> str:
    """``str(value)``."""
    kind: Any = type(value)
    if kind is str:
        return str.__str__(value)
    if kind is int:
        return int.__repr__(value)
    if kind is float:
        return float_text(value)
    if isinstance(value, BaseException) and kind.__str__ in _PLAIN:
        return _exception_text(value)
    if kind.__str__ is not object.__str__ and kind not in _REPRESENTATIONS and not isinstance(value, _PRIVATE):
        return _returned(kind.__str__(value))
    native = _native_base(value)  # goes before the ``__repr__`` of a subclass
    return representation(value) if native is None else _REPRESENTATIONS[native](_COPIES[native](value))


def _native_base(value: object) -> Any:
    """The native class of which the object's class is a program's subclass."""
    return next((base for base in _COPIES if type(value) is not base and isinstance(value, base)), None)


def _returned(result: Any) -> str:
    """Text that ``__str__`` or ``__repr__`` returns; on a hub they may return anything."""
    return result if isinstance(result, str) else text(result)


def representation(value: object) -> str:
    """``repr(value)``."""
    kind = type(value)
    if kind in _REPRESENTATIONS:
        return _REPRESENTATIONS[kind](value)
    if isinstance(value, BaseException) and kind.__repr__ is BaseException.__repr__:
        return f"{class_name(kind)}{representation(value.args)}"
    if isinstance(value, type):
        return repr(value) if kind.__repr__ is not type.__repr__ else f"<class '{type_name(value)}'>"
    if kind.__repr__ is object.__repr__:
        is_native = kind.__module__.startswith(FIRMWARE)
        return f"<{kind.__name__}>" if is_native else f"<{kind.__name__} object at {_address(value)}>"
    native = _native_base(value)
    if native is None or kind.__repr__ is not native.__repr__:
        return _returned(kind.__repr__(value))
    return _REPRESENTATIONS[native](_COPIES[native](value))


_ITERATORS: set[type] = {type(iter(kind())) for kind in (list, tuple, str, bytes, bytearray)}
_ITERATORS |= {type(iter(range(0))), type(iter("\u00e4")), TableIterator, Mapped}
_REVERSED: list[type] = [reversed, type(reversed([]))]
_TYPE_NAMES: dict[type, str] = {
    **dict.fromkeys(_ITERATORS, "iterator"),
    **dict.fromkeys(_REVERSED, "reversed"),
    BuiltinFunctionType: "function",
    MethodType: "bound_method",
    MethodDescriptorType: "function",
    WrapperDescriptorType: "function",
}


def type_name(kind: type) -> str:
    """Name of a class on a hub."""
    return class_name(kind) if issubclass(kind, BaseException) else _TYPE_NAMES.get(kind, kind.__name__)


def _address(value: object) -> str:
    return f"{0x20000000 + id(value) % 0x50000:x}"


def format_traceback(error: BaseException, filename: str) -> str:
    """The traceback as a hub prints it, with only the program's lines, ending with a newline.

    The last line goes by the class's ``__repr__``, not its ``__str__``.
    """
    lines = []
    for frame, line in traceback.walk_tb(error.__traceback__):
        if "@n" in frame.f_builtins:
            lines.append(f'  File "{frame.f_code.co_filename}", line {line}, in {frame.f_code.co_name}')
    if isinstance(error, SyntaxError) and error.lineno is not None:
        block = f", in {error.text}" if error.text and error.offset is None else ""
        lines.append(f'  File "{error.filename or filename}", line {error.lineno}{block}')
    if lines:
        lines.insert(0, "Traceback (most recent call last):")
    has_own = type(error).__repr__ is not BaseException.__repr__
    lines.append(repr(error) if has_own else f"{class_name(type(error))}: {_exception_text(error)}")
    return "\n".join(lines) + "\n"


def _exception_text(error: BaseException) -> str:
    args = (error.msg,) if isinstance(error, SyntaxError) else error.args
    if isinstance(error, OSError) and 0 < len(args) < 3 and args[0] in ERROR_NAMES:
        return f"[Errno {args[0]}] {ERROR_NAMES[args[0]]}" + (f": {text(args[1])}" if len(args) == 2 else "")
    return "" if not args else text(args[0]) if len(args) == 1 else representation(args)


def _quoted(codes: Iterable[int], quote: str) -> str:
    out = []
    for code in codes:
        if code == ord(quote):
            out.append("\\" + quote)
        elif code in _ESCAPES:
            out.append(_ESCAPES[code])
        elif 32 <= code < 127:
            out.append(chr(code))
        elif code < 256:
            out.append(f"\\x{code:02x}")
        else:
            out.append(f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}")
    return quote + "".join(out) + quote


def _bytes(value: Any) -> str:
    return "b" + _quoted(value, '"' if b"'" in value and b'"' not in value else "'")


def _joined(values: Iterable[object]) -> str:
    return ", ".join(map(representation, values))


def _dict(value: Any) -> str:
    return "{" + ", ".join(f"{representation(k)}: {representation(v)}" for k, v in value.items()) + "}"


def _complex(value: complex) -> str:
    real, imaginary = (format_float(part, "g", None) for part in (value.real, value.imag))
    if value.real == 0:
        return f"{imaginary}j"
    return f"({real}{'' if value.imag < 0 else '+'}{imaginary}j)"


def _method(value: Any) -> str:
    return f"<bound_method {_address(value)} {representation(value.__self__)}.<function>>"


_REPRESENTATIONS: dict[type, Callable[[Any], str]] = {
    str: lambda v: _quoted(map(ord, v), '"' if "'" in v and '"' not in v else "'"),
    bytes: _bytes,
    HubBytearray: lambda v: f"bytearray({_bytes(v)})",
    int: int.__repr__,
    bool: bool.__repr__,
    float: float_text,
    complex: _complex,
    type(None): lambda v: "None",
    type(...): lambda v: "Ellipsis",
    list: lambda v: f"[{_joined(v)}]",
    tuple: lambda v: f"({_joined(v)},)" if len(v) == 1 else f"({_joined(v)})",
    HubDict: _dict,
    dict: lambda v: _dict({name: value for name, value in v.items() if name not in ("__builtins__", "__doc__")}),
    HubSet: lambda v: "{" + _joined(v) + "}" if v else "set()",
    range: lambda v: f"range({v.start}, {v.stop}" + (")" if v.step == 1 else f", {v.step})"),
    object: lambda v: "<object>",
    DictView: lambda v: f"dict_{v.kind}([{_joined(v)}])",
    GeneratorType: lambda v: f"<generator object '{v.__name__}' at {_address(v)}>",
    FunctionType: lambda v: "<generator>" if v.__code__.co_flags & CO_GENERATOR else "<function>",
    BuiltinFunctionType: lambda v: "<function>" if isinstance(v.__self__, ModuleType | None) else _method(v),
    MethodType: _method,
    **dict.fromkeys((zip, map, enumerate, *_REVERSED, *_ITERATORS), lambda v: f"<{type_name(type(v))}>"),
    ModuleType: lambda v: f"<module '{v.__name__}'>",
    memoryview: lambda v: "<memoryview>",
}
_COPIES: dict[type, Callable[[Any], Any]] = {
    list: list.copy,
    tuple: lambda v: tuple(tuple.__iter__(v)),
    HubDict: HubDict.copy,
    HubSet: HubSet.copy,
}  # for objects of a program's subclasses, regardless of overridden methods
_PRIVATE = (type, FunctionType, ModuleType)
