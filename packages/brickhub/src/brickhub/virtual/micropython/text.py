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

_ESCAPES = {
    ord("\n"): "\\n",
    ord("\r"): "\\r",
    ord("\t"): "\\t",
    ord("\\"): "\\\\",
}
_PLAIN = (BaseException.__str__, OSError.__str__, KeyError.__str__, SyntaxError.__str__)
"""``__str__`` of exceptions that a program did not write itself."""
# CPython has an iterator class for each container, and another one for text outside ASCII, but a
# hub has one for all.
_ITERATORS: set[type] = {
    type(iter([])),
    type(iter(())),
    type(iter("")),
    type(iter("\u00e4")),
    type(iter(b"")),
    type(iter(bytearray())),
    type(iter(range(0))),
    TableIterator,
}
_REVERSED: list[type] = [reversed, type(reversed([]))]
"""CPython has a class of its own for reversed lists."""
_TYPE_NAMES: dict[type, str] = {
    **dict.fromkeys(_ITERATORS, "iterator"),
    **dict.fromkeys(_REVERSED, "reversed"),
    **dict.fromkeys(
        (types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType),
        "function",
    ),
    types.MethodType: "bound_method",
}
# A program's subclass shows its items as they are stored, whatever methods it overrides. So they
# are copied into the native class by that class's own methods.
_COPIES: dict[type, Callable[[Any], Any]] = {
    list: list.copy,
    tuple: lambda values: tuple(tuple.__iter__(values)),
    HubDict: HubDict.copy,
    HubSet: HubSet.copy,
}
_PRIVATE = (type, types.FunctionType, types.ModuleType)
_DEFAULT_PRECISION = 6
# A hub reads a specification byte by byte, so only an ASCII character can fill.
_SPEC = re.compile(
    r"(?:(?P<fill>[^<>=^\x80-\U0010ffff])?(?P<align>[<>=^]))?"
    r"(?P<sign>[-+ ])?(?P<prefix>#?)(?P<zero>0)?(?P<width>\d+)?"
    r"(?P<separator>[,_])?(?:\.(?P<precision>\d+)?)?(?P<code>[bcdeEfFgGnosxX%])?",
    re.DOTALL,
)
# Parsing is cached, because programs format in loops, with the few specifications in their source.
_parsed = functools.lru_cache(maxsize=256)(_SPEC.fullmatch)
_INTEGER_CODES = ("", *"bcdnoxX")
_FLOAT_CODES = ("", *"eEfFgGn%")
_PERCENT = re.compile(
    r"%(?:\((?P<key>[^)]*)\))?(?P<flags>[-+ #0]*)"
    r"(?P<width>\*|\d+)?(?:\.(?P<precision>\*|\d+))?(?P<code>.)?",
    re.DOTALL,
)


def text(value: Any) -> str:
    """``str(value)``."""
    kind: Any = type(value)
    # What programs print most comes first: texts, counts and readings.
    if kind is str:
        return str.__str__(value)
    if kind is int:
        return int.__repr__(value)
    if kind is float:
        return float_text(value)
    if isinstance(value, BaseException) and kind.__str__ in _PLAIN:
        return _exception_text(value)
    has_text_method = kind.__str__ is not object.__str__
    is_hidden = kind in _REPRESENTATIONS or isinstance(value, _PRIVATE)
    if has_text_method and not is_hidden:
        return _returned(kind.__str__(value))
    native = _native_base(value)
    if native is None:
        return representation(value)
    # A hub prefers the native class's text to the `__repr__` of a subclass, but CPython does not.
    return _REPRESENTATIONS[native](_COPIES[native](value))


def _native_base(value: object) -> Any:
    """The native class of which the object's class is a program's subclass, or ``None``."""
    kind = type(value)
    for base in _COPIES:
        if kind is not base and isinstance(value, base):
            return base
    return None


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
        has_own_metaclass = kind.__repr__ is not type.__repr__
        return repr(value) if has_own_metaclass else f"<class '{type_name(value)}'>"
    if kind.__repr__ is object.__repr__:
        # A native class without a printer of its own shows only its name (`mp_obj_print_helper`,
        # `py/obj.c`).
        if kind.__module__.startswith(FIRMWARE):
            return f"<{kind.__name__}>"
        return f"<{kind.__name__} object at {_address(value)}>"
    native = _native_base(value)
    if native is None or kind.__repr__ is not native.__repr__:
        return _returned(kind.__repr__(value))
    return _REPRESENTATIONS[native](_COPIES[native](value))


def type_name(kind: type) -> str:
    """Name of a class on a hub."""
    if issubclass(kind, BaseException):
        return class_name(kind)
    return _TYPE_NAMES.get(kind, kind.__name__)


def _address(value: object) -> str:
    # Addresses look like a hub's, whose memory begins at 0x20000000.
    return f"{0x20000000 + id(value) % 0x50000:x}"


def format_traceback(error: BaseException, filename: str) -> str:
    """The traceback as a hub prints it, with only the program's lines, ending with a newline.

    The last line goes by the class's ``__repr__``, not its ``__str__``.
    """
    lines = []
    for frame, line in traceback.walk_tb(error.__traceback__):
        # Only transformed code has the helpers, so all other frames are the interpreter's.
        if "@n" in frame.f_builtins:
            code = frame.f_code
            lines.append(f'  File "{code.co_filename}", line {line}, in {code.co_name}')
    kind = type(error)
    if isinstance(error, SyntaxError) and error.lineno is not None:
        # The hub's compiler names the function, which `_compile_for_hub` keeps in `text`. In
        # CPython's errors that is the source, and there is an offset.
        is_from_hub = error.text and error.offset is None
        block = f", in {error.text}" if is_from_hub else ""
        file = error.filename or filename
        lines.append(f'  File "{file}", line {error.lineno}{block}')
    if lines:
        lines.insert(0, "Traceback (most recent call last):")
    if kind.__repr__ is BaseException.__repr__:
        name = class_name(kind)
        lines.append(f"{name}: {_exception_text(error)}")
    else:
        lines.append(repr(error))
    return "\n".join(lines) + "\n"


def _exception_text(error: BaseException) -> str:
    # CPython adds file and line to the text of a SyntaxError.
    args = (error.msg,) if isinstance(error, SyntaxError) else error.args
    if not args:
        return ""
    first = args[0]
    has_number = len(args) in (1, 2) and type(first) is int and first in ERROR_NAMES
    if isinstance(error, OSError) and has_number:
        # The hub writes the name of the number where CPython writes a sentence (`py/objexcept.c`).
        described = f"[Errno {first}] {ERROR_NAMES[first]}"
        if len(args) == 2:
            described += f": {text(args[1])}"
        return described
    return text(first) if len(args) == 1 else representation(args)


def _quoted(codes: Iterable[int], quote: str) -> str:
    written = []
    for code in codes:
        if code == ord(quote):
            written.append("\\" + quote)
        elif code in _ESCAPES:
            written.append(_ESCAPES[code])
        elif 32 <= code < 127:
            written.append(chr(code))
        # A hub escapes everything outside ASCII, but CPython writes letters of other alphabets.
        elif code < 256:
            written.append(f"\\x{code:02x}")
        elif code < 0x10000:
            written.append(f"\\u{code:04x}")
        else:
            written.append(f"\\U{code:08x}")
    return quote + "".join(written) + quote


def _bytes(value: Any) -> str:
    quote = '"' if b"'" in value and b'"' not in value else "'"
    return "b" + _quoted(value, quote)


def _str(value: Any) -> str:
    quote = '"' if "'" in value and '"' not in value else "'"
    return _quoted(map(ord, value), quote)


def _tuple(value: Any) -> str:
    comma = "," if len(value) == 1 else ""
    return f"({_joined(value)}{comma})"


def _set(value: Any) -> str:
    return "{" + _joined(value) + "}" if value else "set()"


def _range(value: Any) -> str:
    step = "" if value.step == 1 else f", {value.step}"
    return f"range({value.start}, {value.stop}{step})"


def _namespace(value: dict[Any, Any]) -> str:
    """Text of a dict of CPython, which is the globals of a module."""
    # CPython puts these into a module, but a hub's module does not have them.
    visible = {
        name: part for name, part in value.items() if name not in ("__builtins__", "__doc__")
    }
    return _dict(visible)


def _function(value: Any) -> str:
    return "<generator>" if value.__code__.co_flags & CO_GENERATOR else "<function>"


def _builtin_function(value: Any) -> str:
    # CPython calls the methods of builtin objects, such as `[].append`, builtin functions too.
    is_function = isinstance(value.__self__, types.ModuleType | None)
    return "<function>" if is_function else _method(value)


def _nameless(value: Any) -> str:
    """Text of an iterator."""
    return f"<{type_name(type(value))}>"


def _joined(values: Iterable[object]) -> str:
    return ", ".join(map(representation, values))


def _dict(value: Any) -> str:
    pairs = []
    for key, part in value.items():
        shown_key = representation(key)
        shown_part = representation(part)
        pairs.append(f"{shown_key}: {shown_part}")
    return "{" + ", ".join(pairs) + "}"


def _complex(value: complex) -> str:
    imaginary = format_float(value.imag, "g", None)
    if value.real == 0:
        return f"{imaginary}j"
    real = format_float(value.real, "g", None)
    plus = "" if value.imag < 0 else "+"
    return f"({real}{plus}{imaginary}j)"


def _method(value: Any) -> str:
    return f"<bound_method {_address(value)} {representation(value.__self__)}.<function>>"


_REPRESENTATIONS: dict[type, Callable[[Any], str]] = {
    str: _str,
    bytes: _bytes,
    HubBytearray: lambda value: f"bytearray({_bytes(value)})",
    int: int.__repr__,
    bool: bool.__repr__,
    float: float_text,
    complex: _complex,
    type(None): lambda value: "None",
    type(...): lambda value: "Ellipsis",
    list: lambda value: f"[{_joined(value)}]",
    tuple: _tuple,
    HubDict: _dict,
    dict: _namespace,
    HubSet: _set,
    range: _range,
    object: lambda value: "<object>",
    DictView: lambda value: f"dict_{value.kind}([{_joined(value)}])",
    types.GeneratorType: lambda value: (
        f"<generator object '{value.__name__}' at {_address(value)}>"
    ),
    types.FunctionType: _function,
    types.BuiltinFunctionType: _builtin_function,
    types.MethodType: _method,
    **dict.fromkeys((zip, map, enumerate, *_REVERSED, *_ITERATORS), _nameless),
    types.ModuleType: lambda value: f"<module '{value.__name__}'>",
    memoryview: lambda value: "<memoryview>",
}
"""``repr`` by class, of values whose class a program did not write."""


def to_number(value: Any, kind: str) -> Any:
    """A number; of an object, the result of ``__int__`` or ``__float__``. Raises TypeError if it is
    not a number."""
    if isinstance(value, int | float):
        return value
    convert = getattr(type(value), f"__{kind}__", None)
    number = None
    if convert is not None and not isinstance(value, str | bytes):
        number = convert(value)
    if type(number).__name__ == kind:
        return number
    # A hub checks the result of `__int__` where it calls it, and without a message
    # (`py/objtype.c`).
    if kind == "int" and number is not None:
        raise TypeError
    raise TypeError(f"can't convert {type(value).__name__} to {kind}")


def format_value(value: object, spec: str) -> str:
    """``format(value, spec)``; the hub ignores ``__format__``."""
    if not spec:
        return text(value)
    match = _parsed(spec)
    if match is None:
        raise ValueError("invalid format specifier")
    code = match["code"] or ""
    sign = (match["sign"] or "").replace("-", "")
    if sign and code == "s":
        raise ValueError("sign not allowed in string format specifier")
    if sign and code == "c":
        raise ValueError("sign not allowed with integer format specifier 'c'")

    # The alignment of numbers is to the right by default, with zeros behind their sign.
    is_number = isinstance(value, int | float)
    if match["align"]:
        align = match["align"]
    elif is_number:
        align = "=" if match["zero"] else ">"
    else:
        align = "<"
    width = int(match["width"] or 0)
    fill = match["fill"] or match["zero"] or " "
    precision = match["precision"]
    # This is checked before the text is made, because a width that fits on no hub would fill this
    # computer's memory.
    check_allocation(width)

    if isinstance(value, int) and code in _INTEGER_CODES:
        flags = sign + match["prefix"]
        separator = match["separator"] or ""
        return _format_integer(
            int(value),
            code,
            flags,
            separator,
            fill,
            align,
            width,
        )
    if isinstance(value, int | float) and code in _FLOAT_CODES:
        formatted = _format_float(
            value,
            code or "g",
            sign,
            precision,
        )
        return _padded(formatted, fill, align, width)
    # This is text, or a number with a code that is not for numbers.
    if not is_number and align == "=":
        raise ValueError("'=' alignment not allowed in string format specifier")
    if is_number or code not in ("", "s"):
        kind = type_name(type(value))
        raise ValueError(f"unknown format code '{code}' for object of type '{kind}'")
    if not isinstance(value, str | bytes):
        kind = type(value).__name__
        raise TypeError(f"can't convert '{kind}' object to str implicitly")
    # On a hub bytes are text of as many characters, but CPython's have no format.
    characters = value if isinstance(value, str) else value.decode("latin-1")
    if precision is not None:
        characters = characters[: int(precision)]
    return _padded(characters, fill, align, width)


def _format_integer(
    value: int,
    code: str,
    flags: str,
    separator: str,
    fill: str,
    align: str,
    width: int,
) -> str:
    if code == "c":
        return _padded(
            chr(value & 0xFF),
            fill,
            align,
            width,
        )
    if code in ("b", "o", "x", "X"):
        # A hub groups four digits whatever separates them, and CPython accepts no comma here.
        underscore = "_" if separator else ""
        digits = format(value, f"{flags}{underscore}{code}").replace("_", separator)
    else:
        # To a hub "n" means "d", because it has no locale whose separators it could use.
        digits = format(value, f"{flags}{separator}{code.replace('n', 'd')}")
    return _padded(digits, fill, align, width)


def _format_float(
    value: float,
    code: str,
    sign: str,
    precision: str | None,
) -> str:
    digits = _DEFAULT_PRECISION if precision is None else int(precision)
    value = to_single(value)
    if code == "%":
        # The product is rounded to a hub's float before its digits are computed.
        share_pct = to_single(value * 100)
        return format_float(share_pct, "f", digits, sign) + "%"
    if code == "n":
        code = "g"
    return format_float(value, code, digits, sign)


def _padded(
    formatted: str,
    fill: str,
    align: str,
    width: int,
) -> str:
    if align == "=":
        sign = re.match("[-+ ]?(?:0[xXob])?", formatted)[0]  # type: ignore[index]
        digits = formatted.removeprefix(sign)
        return sign + digits.rjust(width - len(sign), fill)
    width = _in_characters(width, formatted)
    return format(formatted, f"{fill}{align}{width}")


def _in_characters(width: int, formatted: str) -> int:
    """A width in bytes, as a hub counts, in characters."""
    extra_bytes = len(formatted.encode()) - len(formatted)
    return max(0, width - extra_bytes)


class _Formatter(string.Formatter):
    def __init__(self) -> None:
        self._numbering = ""

    def parse(self, format_string: str) -> Iterator[Any]:
        # CPython's formatter refuses a mixture of `{}` and `{0}` too, but later and in other words.
        for part in super().parse(format_string):
            field_name = part[1]
            has_number = field_name is not None and (not field_name or field_name[0].isdigit())
            if has_number:
                if field_name:
                    numbering = "manual field specification"
                else:
                    numbering = "automatic field numbering"
                if self._numbering not in ("", numbering):
                    raise ValueError(f"can't switch from {self._numbering} to {numbering}")
                self._numbering = numbering
            yield part

    def get_field(
        self,
        field_name: str,
        args: Any,
        kwargs: Any,
    ) -> Any:
        if "." in field_name or "[" in field_name:
            name = re.split(r"[.\[]", field_name)[0]
            # A missing argument is noticed before the attribute is refused.
            self.get_value(int(name) if name.isdigit() else name, args, kwargs)
            raise NotImplementedError("attributes not supported")
        return super().get_field(field_name, args, kwargs)

    def format_field(
        self,
        value: Any,
        format_spec: str,
    ) -> str:
        return format_value(value, format_spec)

    def convert_field(
        self,
        value: Any,
        conversion: str | None,
    ) -> Any:
        if conversion is None:
            return value
        if conversion not in "rs":
            raise ValueError(f"unknown conversion specifier {conversion}")
        return representation(value) if conversion == "r" else text(value)

    def get_value(
        self,
        key: int | str,
        args: Any,
        kwargs: Any,
    ) -> Any:
        if isinstance(key, int) and key >= len(args):
            raise IndexError("tuple index out of range")
        return args[key] if isinstance(key, int) else kwargs[key]


def format_text(
    template: str,
    args: tuple[object, ...],
    kwargs: Mapping[str, object],
) -> str:
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

    def star_or_digits(written: str | None) -> str | None:
        return _width_argument(next_value) if written == "*" else written

    def replace(match: re.Match[str]) -> str:
        code = match["code"]
        if match[0] == "%%":
            return "%"
        if code is None:
            raise ValueError("incomplete format")
        if code == "(":
            raise ValueError("incomplete format key")
        key = match["key"]
        if key is not None:
            # After a key, no value is taken in turn any more, not even for a `*`.
            queue.clear()
            if not isinstance(values, dict):
                raise TypeError("format needs a dict")
        # Each `*` takes its number in this order: width, precision, then the value itself.
        width = star_or_digits(match["width"])
        precision = star_or_digits(match["precision"])
        value = next_value() if key is None else values[key]  # type: ignore[index]
        return _format_argument(
            value,
            match,
            width or "",
            precision,
            is_bytes,
        )

    result = _PERCENT.sub(replace, template)
    if queue and not isinstance(values, dict):
        raise TypeError("format string didn't convert all arguments")
    return result.encode("latin-1") if is_bytes else result


def _width_argument(next_value: Callable[[], Any]) -> str:
    """Width or precision from the arguments; none if negative."""
    number = next_value()
    if not isinstance(number, int):
        raise TypeError(f"can't convert {type(number).__name__} to int")
    return str(max(0, number))


def _format_argument(
    value: Any,
    match: re.Match[str],
    width: str,
    precision: str | None,
    is_bytes: bool,
) -> str:
    check_allocation(int(width or 0))
    code = match["code"]
    flags = match["flags"]
    limit = "" if precision is None else f".{precision}"
    spec = f"%{flags}{width}{limit}"
    if code == "s" and is_bytes and isinstance(value, bytes):
        return (spec + "s") % value.decode("latin-1")
    if code in "sr":
        characters = text(value) if code == "s" else representation(value)
        width_in_characters = _in_characters(int(width or 0), characters)
        padded: str = f"%{flags}{width_in_characters}{limit}s" % characters
        return padded
    if code == "c":
        character: str = (spec + "c") % _character(value)
        return character
    if code in "diuxXo":
        check_allocation(int(precision or 0))
        return _format_int(value, code, spec, flags)
    if code in "eEfFgG":
        return _format_float_argument(
            value,
            code,
            flags,
            width,
            precision,
        )
    index = match.end() - 1
    raise ValueError(f"unsupported format character '{code}' (0x{ord(code):x}) at index {index}")


def _character(value: Any) -> Any:
    if isinstance(value, str) and len(value.encode()) != 1:
        raise TypeError("%c needs int or char")
    if not isinstance(value, int | str):
        raise TypeError("integer needed")
    # A hub writes the lowest byte of a number, but CPython refuses what is no character.
    return value & 0xFF if isinstance(value, int) else value


def _format_float_argument(
    value: Any,
    code: str,
    flags: str,
    width: str,
    precision: str | None,
) -> str:
    sign = ""
    if "+" in flags:
        sign = "+"
    elif " " in flags:
        sign = " "
    digits = _DEFAULT_PRECISION if precision is None else int(precision)
    number = to_single(to_number(value, "float"))
    formatted = format_float(number, code, digits, sign)
    fill = "0" if "0" in flags else " "
    # Aligned to the left, the zeros of the flag "0" follow the number, so "-" goes before "0".
    align = ">"
    if "-" in flags:
        align = "<"
    elif "0" in flags:
        align = "="
    return _padded(
        formatted,
        fill,
        align,
        int(width or 0),
    )


def _format_int(
    value: Any,
    code: str,
    spec: str,
    flags: str,
) -> str:
    number = to_number(value, "int")
    if isinstance(number, float):
        if code not in "diu":
            raise TypeError("can't convert float to int")
        number = int_from_float(number)
    # With both flags a hub fills with zeros on the right, but CPython ignores the zero.
    if "-" in flags and "0" in flags and "." not in spec:
        plain_spec = spec.replace("0", "", 1) + code
        plain = str(plain_spec % number)
        return plain.rstrip(" ").ljust(len(plain), "0")
    return str((spec + code) % number)
