"""How a hub turns values into text: ``str``, ``repr``, ``%`` and ``str.format``."""

from __future__ import annotations

import re
import string
from collections.abc import Callable, Iterable, Mapping
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

from bricksrl.twin.micropython.errors import ERROR_NAMES, class_name
from bricksrl.twin.micropython.floats import float_text, halves_up, to_single

_ESCAPES = {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t", ord("\\"): "\\\\"}


def text(value: Any) -> str:
    """``str(value)``."""
    kind: Any = type(value)
    if kind is str:
        return str.__str__(value)
    if kind is int:
        return int.__repr__(value)
    if kind is float:
        return float_text(value)
    if isinstance(value, BaseException) and kind.__str__ in (BaseException.__str__, OSError.__str__, KeyError.__str__):
        return _exception_text(value)
    if kind.__str__ is not object.__str__ and kind not in _REPRESENTATIONS and not isinstance(value, _PRIVATE):
        return str(value)
    return representation(value)


def representation(value: object) -> str:
    """``repr(value)``."""
    kind = type(value)
    if kind in _REPRESENTATIONS:
        return _REPRESENTATIONS[kind](value)
    if isinstance(value, BaseException) and kind.__repr__ is BaseException.__repr__:
        return f"{class_name(kind)}{representation(value.args)}"
    if isinstance(value, type):
        if kind.__repr__ is not type.__repr__:
            return repr(value)
        return f"<class '{type_name(value)}'>"
    if kind.__repr__ is object.__repr__:
        return f"<{kind.__name__} object at {_address(value)}>"
    return repr(value)


_TYPE_NAMES: dict[type, str] = {
    BuiltinFunctionType: "function",
    MethodType: "bound_method",
    MethodDescriptorType: "function",
    WrapperDescriptorType: "function",
}


def type_name(kind: type) -> str:
    """What a hub calls a class."""
    return class_name(kind) if issubclass(kind, BaseException) else _TYPE_NAMES.get(kind, kind.__name__)


def _address(value: object) -> str:
    return f"{0x20000000 + id(value) % 0x50000:x}"


def uncaught(error: BaseException) -> str:
    """The last line of a traceback: a hub does not ask the class for its ``__str__`` there, but for its ``__repr__``."""
    if type(error).__repr__ is not BaseException.__repr__:
        return repr(error)
    return f"{class_name(type(error))}: {_exception_text(error)}"


def _exception_text(error: BaseException) -> str:
    args = error.args
    if isinstance(error, OSError) and 0 < len(args) < 3 and args[0] in ERROR_NAMES:
        return f"[Errno {args[0]}] {ERROR_NAMES[args[0]]}" + (f": {text(args[1])}" if len(args) == 2 else "")
    if not args:
        return ""
    return text(args[0]) if len(args) == 1 else representation(args)


def _quoted(codes: Iterable[int], quote: str, is_text: bool) -> str:
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


def _str(value: Any) -> str:
    return _quoted(map(ord, value), '"' if "'" in value and '"' not in value else "'", True)


def _bytes(value: Any) -> str:
    return "b" + _quoted(value, '"' if b"'" in value and b'"' not in value else "'", False)


def _joined(values: Iterable[object]) -> str:
    return ", ".join(map(representation, values))


def _tuple(value: Any) -> str:
    return f"({_joined(value)},)" if len(value) == 1 else f"({_joined(value)})"


def _dict(value: Any) -> str:
    return "{" + ", ".join(f"{representation(k)}: {representation(v)}" for k, v in value.items()) + "}"


def _range(value: Any) -> str:
    return f"range({value.start}, {value.stop}" + (")" if value.step == 1 else f", {value.step})")


def _complex(value: complex) -> str:
    sign = "+" if value.imag >= 0 else "-"
    return f"({float_text(value.real)}{sign}{float_text(abs(value.imag))}j)"


_REPRESENTATIONS: dict[type, Callable[[Any], str]] = {
    str: _str,
    bytes: _bytes,
    bytearray: lambda v: f"bytearray({_bytes(v)})",
    int: int.__repr__,
    bool: bool.__repr__,
    float: float_text,
    complex: _complex,
    type(None): lambda v: "None",
    type(...): lambda v: "Ellipsis",
    list: lambda v: f"[{_joined(v)}]",
    tuple: _tuple,
    dict: _dict,
    set: lambda v: "{" + _joined(v) + "}" if v else "set()",
    range: _range,
    type({}.keys()): lambda v: f"dict_keys([{_joined(v)}])",
    type({}.values()): lambda v: f"dict_values([{_joined(v)}])",
    type({}.items()): lambda v: f"dict_items([{_joined(v)}])",
    GeneratorType: lambda v: f"<generator object '{v.__name__}' at {_address(v)}>",
    FunctionType: lambda v: "<function>",
    BuiltinFunctionType: lambda v: "<function>",
    MethodType: lambda v: f"<bound_method {_address(v)} {representation(v.__self__)}.<function>>",
    ModuleType: lambda v: f"<module '{v.__name__}'>",
    memoryview: lambda v: "<memoryview>",
}
_PRIVATE = (type, FunctionType, ModuleType)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def format_value(value: object, spec: str) -> str:
    """``format(value, spec)``; the hub does not ask the value's class."""
    if not spec:
        return text(value)
    if not isinstance(value, int | float | str):
        value = text(value)
    code = spec[-1] if spec[-1] in "bcdeEfFgGnosxX%" else ""
    if isinstance(value, bool):
        value = int(value)
    if isinstance(value, str):
        if code not in ("", "s"):
            raise ValueError(f"unknown format code '{code}' for object of type 'str'")
        return format(value, spec)
    if isinstance(value, float):
        if code in ("b", "c", "d", "n", "o", "s", "x", "X"):
            raise ValueError(f"unknown format code '{code}' for object of type 'float'")
        if not code and "." not in spec:
            sign = "+" if "+" in spec and value >= 0 else ""
            padding = spec.replace("+", "")
            return format(sign + float_text(value), padding if re.search("[<>^=]", padding) else ">" + padding)
        return _fixed(value, spec, code)
    if code == "s":
        raise ValueError("unknown format code 's' for object of type 'int'")
    return _fixed(to_single(value), spec, code) if code and code in "eEfFgG%" else format(value, spec)


def _fixed(value: float, spec: str, code: str) -> str:
    if code in ("f", "F"):
        precision = re.search(r"\.(\d+)", spec)
        value = halves_up(value, int(precision[1]) if precision else 6)
    return format(value, spec)


class _Formatter(string.Formatter):
    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if "." in field_name or "[" in field_name:
            raise NotImplementedError("attributes not supported")
        return super().get_field(field_name, args, kwargs)

    def format_field(self, value: Any, format_spec: str) -> str:
        return format_value(value, format_spec)

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion is None:
            return value
        return representation(value) if conversion == "r" else text(value)

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        if isinstance(key, int) and key >= len(args):
            raise IndexError("tuple index out of range")
        return args[key] if isinstance(key, int) else kwargs[key]


def format_text(template: str, args: tuple[object, ...], kwargs: Mapping[str, object]) -> str:
    """``template.format(*args, **kwargs)``."""
    return _Formatter().vformat(template, args, kwargs)


_PERCENT = re.compile(
    r"%(?:\((?P<key>[^)]*)\))?(?P<flags>[-+ #0]*)(?P<width>\*|\d+)?(?:\.(?P<precision>\*|\d+))?(?P<code>.)?", re.DOTALL
)


def percent(template: Any, values: object) -> Any:
    """``template % values`` for text and bytes."""
    if isinstance(template, bytes):
        return percent(template.decode("latin-1"), values).encode("latin-1")
    queue = list(values) if isinstance(values, tuple) else [values]

    def take() -> Any:
        if not queue:
            raise TypeError("format string needs more arguments")
        return queue.pop(0)

    def replace(match: re.Match[str]) -> str:
        code = match["code"]
        if code == "%":
            return "%"
        if code is None:
            raise ValueError("incomplete format")
        width, precision = (str(take()) if match[name] == "*" else match[name] for name in ("width", "precision"))
        if match["key"] is not None:
            queue.clear()
            if not isinstance(values, dict):
                raise TypeError("format needs a dict")
            value = values[match["key"]]
        else:
            value = take()
        return _percent_one(value, code, match["flags"], width or "", precision)

    result = _PERCENT.sub(replace, template)
    if queue and not isinstance(values, dict):
        raise TypeError("format string didn't convert all arguments")
    return result


def _percent_one(value: Any, code: str, flags: str, width: str, precision: str | None) -> str:
    spec = f"%{flags}{width}" + (f".{precision}" if precision is not None else "")
    if code in "sr":
        return (spec + "s") % (text(value) if code == "s" else representation(value))
    if code == "c" and isinstance(value, int | str):
        return (spec + "c") % value
    if code in "diuxXo":
        if not _is_number(value):
            raise TypeError(f"can't convert {type(value).__name__} to int")
        return (spec + code) % int(value)
    if code in "eEfFgG":
        if not _is_number(value):
            raise TypeError(f"can't convert {type(value).__name__} to float")
        value = to_single(value)
        if code in "fF":
            value = halves_up(value, int(precision or 6))
        return str((spec + code) % value)
    raise ValueError(f"unsupported format character '{code}' (0x{ord(code):x}) at index 0")
