"""Arithmetic of a hub: 31-bit integers and 32-bit floats.

The transformed program (``transform.py``) calls these for operations that could exceed the ranges.
"""

import itertools
import math
import operator
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from brickhub.virtual.micropython.containers import HubDict, HubSet
from brickhub.virtual.micropython.exceptions import CATCHABLE, SwitchedOff, is_native, reword
from brickhub.virtual.micropython.floats import (
    SMALL_MAX,
    SMALL_MIN,
    int_from_float,
    read_float,
    to_single,
)
from brickhub.virtual.micropython.iterables import (
    ITERABLE_CONVERSIONS,
    ITERABLE_FUNCTIONS,
    add_in_place,
    is_dropped,
    sort,
)
from brickhub.virtual.micropython.memory import check_allocation
from brickhub.virtual.micropython.streams import HubBytearray, as_bytes
from brickhub.virtual.micropython.text import (
    format_text,
    format_value,
    percent,
    representation,
    text,
    to_number,
    type_name,
)

_EXACT_INT_MAX = 2**24
_BASES = {"0b": 2, "0o": 8, "0x": 16}
ASCII_METHODS = (
    *("lower", "upper", "isalpha", "isdigit", "islower", "isupper", "isspace"),
    *("strip", "lstrip", "rstrip", "split", "rsplit"),
)
_NO_DIGITS = re.compile(r"\s*([-+]?)(?:\.|\.?e[-+]?\d+)\s*", re.IGNORECASE)
"""What a hub reads as zero."""
_FLOAT_MAX = 3.4028234663852886e38
_ITEM_BYTES: dict[Any, int] = {str: 1, bytes: 1, list: 4, tuple: 4}
"""Sizes of the items of what operators make longer."""
_SIZED = (str, bytes, HubBytearray, list, tuple)
_CHECKED_ITEMS = 256


def _check_length(kind: type, length: int) -> None:
    # these end with a zero byte
    check_allocation(length * _ITEM_BYTES[kind] + (kind in (str, bytes)))


def small(value: int) -> int:
    """The integer, if a hub can hold it. Raises OverflowError if it needs more than 31 bits."""
    if SMALL_MIN <= value <= SMALL_MAX:
        return value
    raise OverflowError("small int overflow")


def normalizer() -> Callable[[Any], Any]:
    """A function that rounds floats and checks integers; one per program, as it keeps a scratch
    cell."""
    cell = memoryview(bytearray(4)).cast("f")

    def normalize(value: Any) -> Any:
        kind = type(value)
        if kind is int:
            if -0x40000000 <= value <= 0x3FFFFFFF:
                return value
            raise OverflowError("small int overflow")
        if kind is float:
            if -_FLOAT_MAX <= value <= _FLOAT_MAX:
                cell[0] = value
                return cell[0]
            return to_single(value)
        if kind is complex:
            return complex(to_single(value.real), to_single(value.imag))
        if kind in _ITEM_BYTES:
            _check_length(kind, len(value))
        return value

    return normalize


def _single_int(value: Any) -> Any:
    """Integers become floats in operations with floats; large ones lose digits."""
    return (
        to_single(value)
        if type(value) is int and not -_EXACT_INT_MAX <= value <= _EXACT_INT_MAX
        else value
    )


def _operands(a: Any, b: Any) -> tuple[Any, Any]:
    """The operands; beside a float, an integer as a float."""
    return (_single_int(a), _single_int(b)) if float in (type(a), type(b)) else (a, b)


def to_int(*args: Any) -> Any:
    """``int(...)``."""
    if len(args) > 2:
        raise TypeError(f"function expected at most 2 arguments, got {len(args)}")
    if len(args) == 1:
        value = args[0]
        if type(value) is float:
            return int_from_float(value)
        if not isinstance(value, str | bytes | bytearray):
            return small(int(to_number(value, "int")))
    elif args and not isinstance(args[0], str | bytes):
        raise TypeError(f"can't convert '{type_name(type(args[0]))}' object to str implicitly")
    try:
        if args and isinstance(args[0], str | bytes | bytearray):
            args = (_digits(args[0]), *args[1:])
        value = int(*args)
    except ValueError as error:
        if "Exceeds the limit" in str(error):  # of CPython
            raise OverflowError("long int not supported in this build") from None
        base = args[1] if len(args) > 1 else 10
        if base != 0 and not 2 <= base <= 36:
            raise ValueError("int() arg 2 must be >= 2 and <= 36") from None
        digits = re.sub(r"^\s*[-+]?", "", args[0])
        if base == 0:
            base = _BASES.get(digits[:2].lower(), 10)
            digits = digits if base == 10 else digits[2:]
        raise ValueError(
            f"invalid syntax for integer with base {base}: {representation(digits)}"
        ) from None
    except TypeError:
        raise TypeError(f"can't convert {type(args[0]).__name__} to int") from None
    if abs(value) > SMALL_MAX:  # digits are read before the sign
        raise OverflowError("long int not supported in this build")
    return value


def _digits(value: str | bytes | bytearray) -> str:
    """Text of a number, in which digits and spaces outside ASCII are none."""
    return (value.encode() if isinstance(value, str) else value).decode("latin-1")


def to_float(*args: Any) -> Any:
    """``float(...)``."""
    if len(args) != 1:
        return float(*args)
    value = args[0]
    if not isinstance(value, str | bytes | bytearray):
        return to_single(float(to_number(value, "float")))
    digits = _digits(value)
    try:
        return read_float(digits)
    except ValueError:
        if match := _NO_DIGITS.fullmatch(digits):
            return -0.0 if match[1] == "-" else 0.0
        raise ValueError("invalid syntax for number") from None


def _refuse_keywords(kwargs: Mapping[str, object]) -> None:
    if kwargs:
        raise TypeError("function doesn't take keyword arguments")


def _to_bytes(value: Any, *args: Any, **kwargs: Any) -> Any:
    """``value.to_bytes(...)``; negative integers as two's complement."""
    if not isinstance(value, int):
        return value.to_bytes(*args, **kwargs)
    _refuse_keywords(kwargs)
    try:
        return value.to_bytes(*args[:2], signed=value < 0)
    except OverflowError:
        raise OverflowError("buffer too small") from None


def _from_bytes(kind: Any, *args: Any, **kwargs: Any) -> Any:
    """``kind.from_bytes(...)``: unsigned, only the lowest four bytes."""
    if kind is not int:
        return kind.from_bytes(*args, **kwargs)
    _refuse_keywords(kwargs)
    is_little = args[1:] and args[1] == "little"
    return small(int.from_bytes(as_bytes(args[0]), "little" if is_little else "big") & 0xFFFFFFFF)


def _ascii_method(name: str) -> Callable[..., Any]:
    """A method of text that knows only the letters, digits and spaces of ASCII."""
    method = getattr(bytes, name)

    def call(value: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(value, str | bytes):
            _refuse_keywords(kwargs)
            if name == "rsplit" and args[1:] and args[0] is None:
                raise NotImplementedError("rsplit(None,n)")
            if name.endswith("strip") and args and not isinstance(args[0], type(value)):
                wanted = "bytes" if isinstance(args[0], str) else "str"
                raise TypeError(
                    f"can't convert '{type(args[0]).__name__}' object to {wanted} implicitly"
                )
        if not isinstance(value, str) or value.isascii():
            return getattr(value, name)(*args, **kwargs)
        result = method(
            value.encode(), *(arg.encode() if isinstance(arg, str) else arg for arg in args)
        )
        if isinstance(result, list):
            return [part.decode() for part in result]
        return result.decode(errors="replace") if isinstance(result, bytes) else result

    return call


def _contains(item: Any, container: Any) -> bool:
    """``item in container``; bytes have text in them, and nothing that is neither data nor a byte.
    A number in a number is an operation."""
    if isinstance(container, bytes):
        return _is_part(item, container)
    if isinstance(container, memoryview) and isinstance(item, int | float):
        raise NotImplementedError
    if type(item) is int and type(container) in (int, float, complex):
        raise TypeError(f"unsupported types for : 'int', '{type(container).__name__}'")
    if type(container) is bool or (type(item) is bool and type(container) is int):
        if isinstance(item, int | float | complex):
            raise TypeError(
                "unsupported types for __contains__: 'int', "
                f"'{type(item).__name__.replace('bool', 'int')}'"
            )
        container = int(container)
    return item in container


def _is_part(item: Any, data: bytes) -> bool:
    if isinstance(item, int):
        return 0 <= item <= 255 and item in data
    return isinstance(item, str | bytes | bytearray | memoryview) and as_bytes(item) in data


def _ordered(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """A comparison in which bytes come before or after text, as its bytes do."""

    def compare(a: Any, b: Any) -> Any:
        return operation(
            a, b.encode() if isinstance(a, bytes | bytearray) and isinstance(b, str) else b
        )

    return compare


def _to_slice(*args: Any) -> Any:
    """``slice(...)``, which only brackets can make."""
    raise TypeError("can't create 'slice' instances")


def _stepped(container: Any, start: Any, stop: Any, step: Any) -> Any:
    """``container[start:stop:step]``; only lists support a step."""
    if (
        step is not None
        and step != 1
        and isinstance(container, str | bytes | bytearray | memoryview | tuple)
    ):
        raise NotImplementedError("only slices with step=1 (aka None) are supported")
    return container[start:stop:step]


def _subscriptable(value: Any) -> Any:
    """A value named as a builtin class, in ``list[int]``: a hub's classes have no items."""
    if isinstance(value, type) and is_native(value):
        raise TypeError("'type' object isn't subscriptable")
    return value


def _sliced(container: Any, step: Any) -> Any:
    """The container of an assigned or deleted slice: only lists, without another step than 1."""
    if isinstance(container, bytearray | memoryview):
        raise TypeError(f"'{type(container).__name__}' object doesn't support item assignment")
    if step is not None and step != 1 and isinstance(container, list):
        raise NotImplementedError
    return container


def _set_slice(value: Any, container: Any, start: Any, stop: Any, step: Any) -> None:
    """``container[start:stop:step] = value``."""
    if isinstance(_sliced(container, step), list) and not isinstance(value, list | tuple):
        raise TypeError(f"object '{type(value).__name__}' isn't a tuple or list")
    container[start:stop:step] = value


def _product(a: Any, b: Any) -> Any:
    """``a * b``; a refusal names both classes."""
    if type(a) in _ITEM_BYTES and isinstance(b, int):
        _check_length(type(a), len(a) * b)
    try:
        return a * b
    except TypeError as error:
        if not str(error).startswith("can't multiply sequence"):
            raise
    raise TypeError(
        f"unsupported operand type(s) for *: '{type(a).__name__}' and '{type(b).__name__}'"
    )


def _bitwise(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Truth values are numbers; dicts and classes have no union."""
    symbol = {"and": "&", "or": "|", "xor": "^"}[operation.__name__.strip("_").removeprefix("i")]

    def operate(a: Any, b: Any) -> Any:
        if type(a) is int and type(b) is int:
            return operation(a, b)
        if type(a) is bool and type(b) is bool:
            return int(operation(a, b))
        if isinstance(a, dict | type) or isinstance(b, type):
            raise TypeError(
                f"unsupported operand type(s) for {symbol}: '{type(a).__name__}' and "
                f"'{type(b).__name__}'"
            )
        return operation(a, b)

    return operate


def _list_comprehension(elements: Iterator[Any]) -> list[Any]:
    """The elements; a StopIteration in one of them is not that of a generator."""
    items: list[Any] = []
    size_bytes = 0
    try:
        while some := list(itertools.islice(elements, _CHECKED_ITEMS)):
            items += some
            size_bytes += sum(len(item) for item in some if type(item) in _SIZED)
            check_allocation(_ITEM_BYTES[list] * len(items) + size_bytes)
    except RuntimeError as error:
        raise (error.__cause__ if isinstance(error.__cause__, StopIteration) else error) from None
    return items


def _format(obj: Any, *args: Any, **kwargs: Any) -> Any:
    """``obj.format(...)``, which bytes have too."""
    if isinstance(obj, bytes):
        return format_text(obj.decode("latin-1"), args, kwargs).encode("latin-1")
    return format_text(obj, args, kwargs) if isinstance(obj, str) else obj.format(*args, **kwargs)


def _f_string(value: Any, conversion: int, spec: str) -> str:
    convert = {ord("r"): representation, ord("s"): text}.get(conversion)
    return format_value(value if convert is None else convert(value), spec)


CONVERSIONS: dict[Any, Callable[..., Any]] = {
    **ITERABLE_CONVERSIONS,
    int: to_int,
    float: to_float,
    slice: _to_slice,
    str: lambda *args: (
        text(args[0]) if len(args) == 1 else as_bytes(args[0]).decode() if args else ""
    ),
}
"""Calls of builtin classes as on a hub."""


def _convert(kind: Any, *args: Any, **kwargs: Any) -> Any:
    """``kind(...)`` of what has the name of a builtin class in the program."""
    convert = CONVERSIONS.get(kind) if isinstance(kind, type) else None
    if convert is None:
        return kind(*args, **kwargs)
    _refuse_keywords(kwargs)
    return convert(*args)


_FUNCTIONS: dict[str, Any] = {f"@{name}": _ascii_method(name) for name in ASCII_METHODS}
_FUNCTIONS |= {"@convert": _convert, "@sort": sort, "@f": _f_string}
_FUNCTIONS |= {
    "@format": _format,
    "@in": _contains,
    "@to_bytes": _to_bytes,
    "@from_bytes": _from_bytes,
}
_FUNCTIONS |= {f"@{name}": _ordered(getattr(operator, name)) for name in ("lt", "le", "gt", "ge")}
_FUNCTIONS |= {
    "@sub": _subscriptable,
    "@stepped": _stepped,
    "@sliced": _sliced,
    "@setslice": _set_slice,
}


def operators(namespaces: Sequence[Mapping[str, object]]) -> dict[str, Any]:
    """Functions for the transformed program, by names that programs cannot write. ``namespaces``:
    globals of its modules."""
    normalize = normalizer()

    def divide(a: Any, b: Any) -> Any:
        if type(a) is int or type(b) is int:
            a = _single_int(a)
            b = _single_int(b)
        return normalize(a / b)

    def floor_divide(a: Any, b: Any) -> Any:
        a, b = _operands(a, b)
        return normalize(a // b)

    def modulo(a: Any, b: Any) -> Any:
        if isinstance(a, str | bytes):
            return percent(a, b)
        if isinstance(a, bytearray):
            raise TypeError(
                f"unsupported operand type(s) for %: 'bytearray' and '{type(b).__name__}'"
            )
        a, b = _operands(a, b)
        return normalize(a % b)

    def power(a: Any, b: Any) -> Any:
        if type(a) is int and type(b) is int and b > 0 and a not in (-1, 0, 1) and b > 30:
            raise OverflowError("small int overflow")
        try:
            return normalize(a**b)
        except OverflowError:
            if isinstance(a, float) or isinstance(b, float):
                return math.inf
            raise

    def subtract_in_place(a: Any, b: Any) -> Any:
        a -= b
        return normalize(a)

    arithmetic = {
        "@n": normalize,
        "@div": divide,
        "@floordiv": floor_divide,
        "@mod": modulo,
        "@pow": power,
    }
    arithmetic |= {
        "@mul": lambda a, b: normalize(_product(a, b)),
        "@iadd": lambda a, b: normalize(add_in_place(a, b)),
    }
    bits = ("and_", "or_", "xor", "iand", "ior", "ixor")
    bitwise = {f"@{name.rstrip('_')}": _bitwise(getattr(operator, name)) for name in bits}
    displays = {
        # `{key: value, ...}` with as many slots as keys; in pairs the value is first, as a hub
        # computes it first
        "@dict": lambda *parts: HubDict.sized(
            len(parts) // 2, zip(parts[1::2], parts[::2], strict=True)
        ),
        "@dictof": lambda pairs: HubDict.sized(0, ((key, value) for value, key in pairs)),
        "@set": lambda *values: HubSet.sized(len(values), values),
        "@setof": HubSet,
        "@listof": _list_comprehension,
        "@named": lambda names: HubDict.sized(len(names), names.items()),
    }
    errors = {
        "@any": CATCHABLE,
        "@ends": lambda: not (isinstance(sys.exc_info()[1], SwitchedOff) or is_dropped()),
        "@reword": lambda error: reword(error, namespaces),
    }
    return {
        **_FUNCTIONS,
        **ITERABLE_FUNCTIONS,
        **arithmetic,
        "@isub": subtract_in_place,
        **bitwise,
        **displays,
        **errors,
    }
