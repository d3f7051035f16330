"""Text of values on a hub: ``str``, ``repr``, ``%``, ``str.format`` and f-strings."""

import functools
import re
import string
import traceback
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import CO_GENERATOR
from typing import Any

from brickhub.virtual.micropython.containers import DictView, HubDict, HubSet, TableIterator
from brickhub.virtual.micropython.exceptions import ERROR_NAMES, FIRMWARE, class_name
from brickhub.virtual.micropython.floats import float_text, format_float, int_from_float, to_single
from brickhub.virtual.micropython.memory import check_allocation
from brickhub.virtual.micropython.streams import HubBytearray

_ESCAPES = {ord("\n"): "\\n", ord("\r"): "\\r", ord("\t"): "\\t", ord("\\"): "\\\\"}
_PLAIN = (BaseException.__str__, OSError.__str__, KeyError.__str__, SyntaxError.__str__)
_ITERATORS: set[type] = {
    *(type(iter(kind())) for kind in (list, tuple, str, bytes, bytearray)),
    *(type(iter(range(0))), type(iter("\u00e4")), TableIterator),
}
_REVERSED: list[type] = [reversed, type(reversed([]))]
_TYPE_NAMES: dict[type, str] = {
    **dict.fromkeys(_ITERATORS, "iterator"),
    **dict.fromkeys(_REVERSED, "reversed"),
    **dict.fromkeys(
        (types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType),
        "function",
    ),
    types.MethodType: "bound_method",
}
_COPIES: dict[type, Callable[[Any], Any]] = {
    list: list.copy,
    tuple: lambda v: tuple(tuple.__iter__(v)),
    HubDict: HubDict.copy,
    HubSet: HubSet.copy,
}  # for objects of a program's subclasses, regardless of overridden methods
_PRIVATE = (type, types.FunctionType, types.ModuleType)
_DEFAULT_PRECISION = 6
_SPEC = re.compile(
    r"(?:(?P<fill>[^<>=^\x80-\U0010ffff])?(?P<align>[<>=^]))?(?P<sign>[-+ "
    r"])?(?P<prefix>#?)(?P<zero>0)?(?P<width>\d+)?"
    r"(?P<separator>[,_])?(?:\.(?P<precision>\d+)?)?(?P<code>[bcdeEfFgGnosxX%])?",
    re.DOTALL,
)
_parsed = functools.lru_cache(maxsize=256)(_SPEC.fullmatch)
_INTEGER_CODES = ("", *"bcdnoxX")
_FLOAT_CODES = ("", *"eEfFgGn%")
_PERCENT = re.compile(
    r"%(?:\((?P<key>[^)]*)\))?(?P<flags>[-+ "
    r"#0]*)(?P<width>\*|\d+)?(?:\.(?P<precision>\*|\d+))?(?P<code>.)?",
    re.DOTALL,
)


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
    if (
        kind.__str__ is not object.__str__
        and kind not in _REPRESENTATIONS
        and not isinstance(value, _PRIVATE)
    ):
        return _returned(kind.__str__(value))
    native = _native_base(value)  # goes before the ``__repr__`` of a subclass
    return (
        representation(value)
        if native is None
        else _REPRESENTATIONS[native](_COPIES[native](value))
    )


def _native_base(value: object) -> Any:
    """The native class of which the object's class is a program's subclass."""
    return next(
        (base for base in _COPIES if type(value) is not base and isinstance(value, base)), None
    )


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
        return (
            repr(value) if kind.__repr__ is not type.__repr__ else f"<class '{type_name(value)}'>"
        )
    if kind.__repr__ is object.__repr__:
        is_native = kind.__module__.startswith(FIRMWARE)
        return (
            f"<{kind.__name__}>" if is_native else f"<{kind.__name__} object at {_address(value)}>"
        )
    native = _native_base(value)
    if native is None or kind.__repr__ is not native.__repr__:
        return _returned(kind.__repr__(value))
    return _REPRESENTATIONS[native](_COPIES[native](value))


def type_name(kind: type) -> str:
    """Name of a class on a hub."""
    return (
        class_name(kind)
        if issubclass(kind, BaseException)
        else _TYPE_NAMES.get(kind, kind.__name__)
    )


def _address(value: object) -> str:
    return f"{0x20000000 + id(value) % 0x50000:x}"


def format_traceback(error: BaseException, filename: str) -> str:
    """The traceback as a hub prints it, with only the program's lines, ending with a newline.

    The last line goes by the class's ``__repr__``, not its ``__str__``.
    """
    lines = []
    for frame, line in traceback.walk_tb(error.__traceback__):
        if "@n" in frame.f_builtins:
            lines.append(
                f'  File "{frame.f_code.co_filename}", line {line}, in {frame.f_code.co_name}'
            )
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
    if (
        isinstance(error, OSError)
        and 0 < len(args) < 3
        and type(args[0]) is int
        and args[0] in ERROR_NAMES
    ):
        return f"[Errno {args[0]}] {ERROR_NAMES[args[0]]}" + (
            f": {text(args[1])}" if len(args) == 2 else ""
        )
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
    return (
        "{" + ", ".join(f"{representation(k)}: {representation(v)}" for k, v in value.items()) + "}"
    )


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
    dict: lambda v: _dict(
        {name: value for name, value in v.items() if name not in ("__builtins__", "__doc__")}
    ),
    HubSet: lambda v: "{" + _joined(v) + "}" if v else "set()",
    range: lambda v: f"range({v.start}, {v.stop}" + (")" if v.step == 1 else f", {v.step})"),
    object: lambda v: "<object>",
    DictView: lambda v: f"dict_{v.kind}([{_joined(v)}])",
    types.GeneratorType: lambda v: f"<generator object '{v.__name__}' at {_address(v)}>",
    types.FunctionType: lambda v: (
        "<generator>" if v.__code__.co_flags & CO_GENERATOR else "<function>"
    ),
    types.BuiltinFunctionType: lambda v: (
        "<function>" if isinstance(v.__self__, types.ModuleType | None) else _method(v)
    ),
    types.MethodType: _method,
    **dict.fromkeys(
        (zip, map, enumerate, *_REVERSED, *_ITERATORS), lambda v: f"<{type_name(type(v))}>"
    ),
    types.ModuleType: lambda v: f"<module '{v.__name__}'>",
    memoryview: lambda v: "<memoryview>",
}


def to_number(value: Any, kind: str) -> Any:
    """A number; of an object, the result of ``__int__`` or ``__float__``. Raises TypeError if it is
    not a number."""
    if isinstance(value, int | float):
        return value
    convert = getattr(type(value), f"__{kind}__", None)
    number = None if convert is None or isinstance(value, str | bytes) else convert(value)
    if type(number).__name__ == kind:
        return number
    raise TypeError(
        *(
            ()
            if kind == "int" and number is not None
            else (f"can't convert {type(value).__name__} to {kind}",)
        )
    )


def format_value(value: object, spec: str) -> str:
    """``format(value, spec)``; the hub ignores ``__format__``."""
    if not spec:
        return text(value)
    match = _parsed(spec)
    if match is None:
        raise ValueError("invalid format specifier")
    code = match["code"] or ""
    sign = (match["sign"] or "").replace("-", "")
    if sign and code in ("s", "c"):
        kind = "in string format specifier" if code == "s" else "with integer format specifier 'c'"
        raise ValueError(f"sign not allowed {kind}")
    is_number = isinstance(value, int | float)
    align = match["align"] or ("=" if match["zero"] and is_number else ">" if is_number else "<")
    check_allocation(int(match["width"] or 0))
    padding = match["fill"] or match["zero"] or " ", align, int(match["width"] or 0)
    if isinstance(value, int) and code in _INTEGER_CODES:
        return _format_integer(
            int(value), code, sign + match["prefix"], match["separator"] or "", *padding
        )
    if isinstance(value, int | float) and code in _FLOAT_CODES:
        return _padded(_format_float(value, code or "g", sign, match["precision"]), *padding)
    if not is_number and align == "=":
        raise ValueError("'=' alignment not allowed in string format specifier")
    if is_number or code not in ("", "s"):
        raise ValueError(
            f"unknown format code '{code}' for object of type '{type_name(type(value))}'"
        )
    if not isinstance(value, str | bytes):
        raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")
    characters = value if isinstance(value, str) else value.decode("latin-1")
    return _padded(
        characters if match["precision"] is None else characters[: int(match["precision"])],
        *padding,
    )


def _format_integer(
    value: int, code: str, flags: str, separator: str, fill: str, align: str, width: int
) -> str:
    if code == "c":
        return _padded(chr(value & 0xFF), fill, align, width)
    if code in ("b", "o", "x", "X"):  # in groups of four digits, whatever separates them
        digits = format(value, f"{flags}{separator and '_'}{code}").replace("_", separator)
    else:
        digits = format(value, f"{flags}{separator}{code.replace('n', 'd')}")
    return _padded(digits, fill, align, width)


def _format_float(value: float, code: str, sign: str, precision: str | None) -> str:
    digits = _DEFAULT_PRECISION if precision is None else int(precision)
    value = to_single(value)
    if code == "%":
        return format_float(to_single(value * 100), "f", digits, sign) + "%"
    return format_float(value, "g" if code == "n" else code, digits, sign)


def _padded(formatted: str, fill: str, align: str, width: int) -> str:
    if align == "=":
        sign = re.match("[-+ ]?(?:0[xXob])?", formatted)[0]  # type: ignore[index]
        return sign + formatted[len(sign) :].rjust(width - len(sign), fill)
    return format(formatted, f"{fill}{align}{_in_characters(width, formatted)}")


def _in_characters(width: int, formatted: str) -> int:
    """A width in bytes, as a hub counts, in characters."""
    return max(0, width - len(formatted.encode()) + len(formatted))


class _Formatter(string.Formatter):
    def __init__(self) -> None:
        self._numbering = ""

    def parse(self, format_string: str) -> Iterator[Any]:
        for part in super().parse(format_string):
            if part[1] is not None and (not part[1] or part[1][0].isdigit()):
                numbering = "manual field specification" if part[1] else "automatic field numbering"
                if self._numbering not in ("", numbering):
                    raise ValueError(f"can't switch from {self._numbering} to {numbering}")
                self._numbering = numbering
            yield part

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if "." in field_name or "[" in field_name:
            name = re.split(r"[.\[]", field_name)[0]
            self.get_value(int(name) if name.isdigit() else name, args, kwargs)
            raise NotImplementedError("attributes not supported")
        return super().get_field(field_name, args, kwargs)

    def format_field(self, value: Any, format_spec: str) -> str:
        return format_value(value, format_spec)

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion is None:
            return value
        if conversion not in "rs":
            raise ValueError(f"unknown conversion specifier {conversion}")
        return representation(value) if conversion == "r" else text(value)

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        if isinstance(key, int) and key >= len(args):
            raise IndexError("tuple index out of range")
        return args[key] if isinstance(key, int) else kwargs[key]


def format_text(template: str, args: tuple[object, ...], kwargs: Mapping[str, object]) -> str:
    """``template.format(*args, **kwargs)``."""
    return _Formatter().vformat(template, args, kwargs)


def percent(template: Any, values: object) -> Any:
    """``template % values`` for text and bytes."""
    is_bytes = isinstance(template, bytes)
    if is_bytes:
        template = template.decode("latin-1")
    queue = list(values) if isinstance(values, tuple) else [values]

    def next_value() -> Any:
        if not queue:
            raise TypeError("format string needs more arguments")
        return queue.pop(0)

    def replace(match: re.Match[str]) -> str:
        code = match["code"]
        if match[0] == "%%":
            return "%"
        if code is None or code == "(":
            raise ValueError("incomplete format" if code is None else "incomplete format key")
        key = match["key"]
        if key is not None:
            queue.clear()
            if not isinstance(values, dict):
                raise TypeError("format needs a dict")
        width, precision = (
            _given(next_value) if match[name] == "*" else match[name]
            for name in ("width", "precision")
        )
        value = next_value() if key is None else values[key]  # type: ignore[index]
        return _format_argument(value, match, width or "", precision, is_bytes)

    result = _PERCENT.sub(replace, template)
    if queue and not isinstance(values, dict):
        raise TypeError("format string didn't convert all arguments")
    return result.encode("latin-1") if is_bytes else result


def _given(next_value: Callable[[], Any]) -> str:
    """Width or precision from the arguments; none if negative."""
    number = next_value()
    if not isinstance(number, int):
        raise TypeError(f"can't convert {type(number).__name__} to int")
    return str(max(0, number))


def _format_argument(
    value: Any, match: re.Match[str], width: str, precision: str | None, is_bytes: bool
) -> str:
    check_allocation(int(width or 0))
    code = match["code"]
    flags = match["flags"]
    limit = "" if precision is None else f".{precision}"
    spec = f"%{flags}{width}{limit}"
    if code in "sr":
        if code == "s" and is_bytes and isinstance(value, bytes):
            return (spec + "s") % value.decode("latin-1")
        characters = text(value) if code == "s" else representation(value)
        return f"%{flags}{_in_characters(int(width or 0), characters)}{limit}s" % characters
    if code == "c":
        if isinstance(value, str) and len(value.encode()) != 1:
            raise TypeError("%c needs int or char")
        if not isinstance(value, int | str):
            raise TypeError("integer needed")
        return (spec + "c") % (value & 0xFF if isinstance(value, int) else value)
    if code in "diuxXo":
        check_allocation(int(precision or 0))
        return _format_int(value, code, spec, flags)
    if code in "eEfFgG":
        sign = next((mark for mark in "+ " if mark in flags), "")
        digits = _DEFAULT_PRECISION if precision is None else int(precision)
        formatted = format_float(to_single(to_number(value, "float")), code, digits, sign)
        align = "<" if "-" in flags else "=" if "0" in flags else ">"
        return _padded(formatted, "0" if "0" in flags else " ", align, int(width or 0))
    raise ValueError(
        f"unsupported format character '{code}' (0x{ord(code):x}) at index {match.end() - 1}"
    )


def _format_int(value: Any, code: str, spec: str, flags: str) -> str:
    number = to_number(value, "int")
    if isinstance(number, float):
        if code not in "diu":
            raise TypeError("can't convert float to int")
        number = int_from_float(number)
    if "-" in flags and "0" in flags and "." not in spec:  # zeros at the right
        plain = str((spec.replace("0", "", 1) + code) % number)
        return plain.rstrip(" ").ljust(len(plain), "0")
    return str((spec + code) % number)
