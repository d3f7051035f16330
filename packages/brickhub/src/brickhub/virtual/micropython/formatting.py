"""Formatting on a hub: ``%``, ``str.format`` and f-strings."""

from __future__ import annotations

import functools
import re
import string
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from brickhub.virtual.micropython.floats import format_float, int_from_float, to_single
from brickhub.virtual.micropython.memory import check_allocation
from brickhub.virtual.micropython.text import representation, text

_DEFAULT_PRECISION = 6
_SPEC = re.compile(
    r"(?:(?P<fill>[^<>=^\x80-\U0010ffff])?(?P<align>[<>=^]))?(?P<sign>[-+ ])?(?P<prefix>#?)(?P<zero>0)?(?P<width>\d+)?"
    r"(?P<separator>[,_])?(?:\.(?P<precision>\d+)?)?(?P<code>[bcdeEfFgGnosxX%])?",
    re.DOTALL,
)
_parsed = functools.lru_cache(maxsize=256)(_SPEC.fullmatch)
_INTEGER_CODES = ("", *"bcdnoxX")
_FLOAT_CODES = ("", *"eEfFgGn%")


def to_number(value: Any, kind: str) -> Any:
    """A number; of an object, the result of ``__int__`` or ``__float__``. Raises TypeError if it is not a number."""
    if isinstance(value, int | float):
        return value
    convert = getattr(type(value), f"__{kind}__", None)
    number = None if convert is None or isinstance(value, str | bytes) else convert(value)
    if type(number).__name__ == kind:
        return number
    raise TypeError(*(() if kind == "int" and number is not None else (f"can't convert {type(value).__name__} to {kind}",)))


def format_value(value: object, spec: str) -> str:
    """``format(value, spec)``; the hub ignores ``__format__``."""
    if not spec:
        return text(value)
    match = _parsed(spec)
    if match is None:
        raise ValueError("invalid format specifier")
    code, sign = match["code"] or "", (match["sign"] or "").replace("-", "")
    if sign and code in ("s", "c"):
        kind = "in string format specifier" if code == "s" else "with integer format specifier 'c'"
        raise ValueError(f"sign not allowed {kind}")
    is_number = isinstance(value, int | float)
    align = match["align"] or ("=" if match["zero"] and is_number else ">" if is_number else "<")
    check_allocation(int(match["width"] or 0))
    padding = match["fill"] or match["zero"] or " ", align, int(match["width"] or 0)
    if isinstance(value, int) and code in _INTEGER_CODES:
        return _format_integer(int(value), code, sign + match["prefix"], match["separator"] or "", *padding)
    if isinstance(value, int | float) and code in _FLOAT_CODES:
        return _padded(_format_float(value, code or "g", sign, match["precision"]), *padding)
    if not is_number and align == "=":
        raise ValueError("'=' alignment not allowed in string format specifier")
    if is_number or code not in ("", "s"):
        raise ValueError(f"unknown format code '{code}' for object of type '{type(value).__name__}'")
    if not isinstance(value, str | bytes):
        raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")
    characters = value if isinstance(value, str) else value.decode("latin-1")
    return _padded(characters if match["precision"] is None else characters[: int(match["precision"])], *padding)


def _format_integer(value: int, code: str, flags: str, separator: str, fill: str, align: str, width: int) -> str:
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


_PERCENT = re.compile(
    r"%(?:\((?P<key>[^)]*)\))?(?P<flags>[-+ #0]*)(?P<width>\*|\d+)?(?:\.(?P<precision>\*|\d+))?(?P<code>.)?", re.DOTALL
)


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
        width, precision = (_given(next_value) if match[name] == "*" else match[name] for name in ("width", "precision"))
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


def _format_argument(value: Any, match: re.Match[str], width: str, precision: str | None, is_bytes: bool) -> str:
    check_allocation(int(width or 0))
    code, flags = match["code"], match["flags"]
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
    raise ValueError(f"unsupported format character '{code}' (0x{ord(code):x}) at index {match.end() - 1}")


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
