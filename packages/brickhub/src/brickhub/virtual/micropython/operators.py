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
"""Integers up to this one are exact as 32-bit floats."""
_BASES = {"0b": 2, "0o": 8, "0x": 16}
ASCII_METHODS = (
    *("lower", "upper", "isalpha", "isdigit", "islower", "isupper", "isspace"),
    *("strip", "lstrip", "rstrip", "split", "rsplit"),
)
_NO_DIGITS = re.compile(r"\s*([-+]?)(?:\.|\.?e[-+]?\d+)\s*", re.IGNORECASE)
"""What a hub reads as zero."""
_FLOAT_MAX = 3.4028234663852886e38
"""The greatest float of 32 bits."""
_ITEM_BYTES: dict[Any, int] = {str: 1, bytes: 1, list: 4, tuple: 4}
"""Sizes of the items of what operators make longer."""
_SIZED = (str, bytes, HubBytearray, list, tuple)
_CHECKED_ITEMS = 256
"""Items of a list comprehension between two looks at its size."""


def _check_length(kind: type, length: int) -> None:
    # Text and bytes end with a zero byte, which takes memory too.
    zero_bytes = 1 if kind in (str, bytes) else 0
    check_allocation(length * _ITEM_BYTES[kind] + zero_bytes)


def small(value: int) -> int:
    """The integer, if a hub can hold it. Raises OverflowError if it needs more than 31 bits."""
    if SMALL_MIN <= value <= SMALL_MAX:
        return value
    raise OverflowError("small int overflow")


def normalizer() -> Callable[[Any], Any]:
    """A function that rounds floats and checks integers; one per program, as it keeps a scratch
    cell."""
    # Writing to a cell of four bytes and reading it rounds faster than `struct` does.
    cell = memoryview(bytearray(4)).cast("f")

    # This is the hottest function of all, because each sum and product of a program passes through
    # it. So the limits stand in it as numbers, and the commonest kinds come first.
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
    if type(value) is int and not -_EXACT_INT_MAX <= value <= _EXACT_INT_MAX:
        return to_single(value)
    return value


def _operands(a: Any, b: Any) -> tuple[Any, Any]:
    """The operands; beside a float, an integer as a float."""
    if float in (type(a), type(b)):
        return _single_int(a), _single_int(b)
    return a, b


def to_int(*args: Any) -> Any:
    """``int(...)``."""
    if len(args) > 2:
        raise TypeError(f"function expected at most 2 arguments, got {len(args)}")
    if len(args) == 1:
        value = args[0]
        if type(value) is float:
            return int_from_float(value)
        if not isinstance(value, str | bytes | bytearray):
            number = to_number(value, "int")
            return small(int(number))
    elif args and not isinstance(args[0], str | bytes):
        kind = type_name(type(args[0]))
        raise TypeError(f"can't convert '{kind}' object to str implicitly")
    try:
        if args and isinstance(args[0], str | bytes | bytearray):
            args = (_digits(args[0]), *args[1:])
        value = int(*args)
    except ValueError as error:
        # CPython refuses to read thousands of digits.
        if "Exceeds the limit" in str(error):
            raise OverflowError("long int not supported in this build") from None
        base = args[1] if len(args) > 1 else 10
        raise _wrong_digits(args[0], base) from None
    except TypeError:
        kind = type(args[0]).__name__
        raise TypeError(f"can't convert {kind} to int") from None
    # Digits are read before the sign, so the limit is the same for both signs.
    if abs(value) > SMALL_MAX:
        raise OverflowError("long int not supported in this build")
    return value


def _wrong_digits(text: str, base: int) -> ValueError:
    if base != 0 and not 2 <= base <= 36:
        return ValueError("int() arg 2 must be >= 2 and <= 36")
    digits = re.sub(r"^\s*[-+]?", "", text)
    # The message depends on the base, which with 0 is the one that the prefix tells.
    if base == 0:
        base = _BASES.get(digits[:2].lower(), 10)
        digits = digits if base == 10 else digits[2:]
    shown = representation(digits)
    return ValueError(f"invalid syntax for integer with base {base}: {shown}")


def _digits(value: str | bytes | bytearray) -> str:
    """Text of a number, in which digits and spaces outside ASCII are none."""
    data = value.encode() if isinstance(value, str) else value
    return data.decode("latin-1")


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
        match = _NO_DIGITS.fullmatch(digits)
        if match is not None:
            return -0.0 if match[1] == "-" else 0.0
        raise ValueError("invalid syntax for number") from None


def _refuse_keywords(kwargs: Mapping[str, object]) -> None:
    if kwargs:
        raise TypeError("function doesn't take keyword arguments")


def _to_bytes(
    value: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``value.to_bytes(...)``; negative integers as two's complement."""
    if not isinstance(value, int):
        return value.to_bytes(*args, **kwargs)
    _refuse_keywords(kwargs)
    try:
        return value.to_bytes(*args[:2], signed=value < 0)
    except OverflowError:
        raise OverflowError("buffer too small") from None


def _from_bytes(
    kind: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``kind.from_bytes(...)``: unsigned, only the lowest four bytes."""
    if kind is not int:
        return kind.from_bytes(*args, **kwargs)
    _refuse_keywords(kwargs)
    is_little = args[1:] and args[1] == "little"
    value = int.from_bytes(as_bytes(args[0]), "little" if is_little else "big")
    return small(value & 0xFFFFFFFF)


def _ascii_method(name: str) -> Callable[..., Any]:
    """A method of text that knows only the letters, digits and spaces of ASCII."""
    method = getattr(bytes, name)

    def call(
        value: Any,
        *args: Any,
        **kwargs: Any,
    ) -> Any:
        if isinstance(value, str | bytes):
            _refuse_keywords(kwargs)
            _check_text_arguments(name, value, args)
        if not isinstance(value, str) or value.isascii():
            return getattr(value, name)(*args, **kwargs)
        # The methods of bytes know only ASCII, and letters outside of it are several bytes, both as
        # on a hub.
        encoded = [arg.encode() if isinstance(arg, str) else arg for arg in args]
        result = method(value.encode(), *encoded)
        if isinstance(result, list):
            return [part.decode() for part in result]
        if isinstance(result, bytes):
            return result.decode(errors="replace")
        return result

    return call


def _check_text_arguments(
    name: str,
    value: str | bytes,
    args: tuple[Any, ...],
) -> None:
    """Raise what a hub raises for arguments of a method of text that CPython takes, or refuses in
    other words."""
    if not args:
        return
    first = args[0]
    has_second = len(args) > 1
    if name == "rsplit" and first is None and has_second:
        raise NotImplementedError("rsplit(None,n)")
    # Too many arguments are refused by their number, whatever they are.
    if name.endswith("strip") and not has_second and not isinstance(first, type(value)):
        kind = type(first).__name__
        wanted = "bytes" if isinstance(first, str) else "str"
        raise TypeError(f"can't convert '{kind}' object to {wanted} implicitly")


def _contains(item: Any, container: Any) -> bool:
    """``item in container``; bytes have text in them, and nothing that is neither data nor a byte.
    A number in a number is an operation."""
    if isinstance(container, bytes):
        return _is_part(item, container)
    if isinstance(container, memoryview) and isinstance(item, int | float):
        raise NotImplementedError
    if type(item) is int and type(container) in (int, float, complex):
        raise TypeError(f"unsupported types for : 'int', '{type(container).__name__}'")
    # A truth value is refused as the number that it is.
    is_truth_value = type(container) is bool or (type(item) is bool and type(container) is int)
    if is_truth_value:
        if isinstance(item, int | float | complex):
            kind = type(item).__name__.replace("bool", "int")
            raise TypeError(f"unsupported types for __contains__: 'int', '{kind}'")
        container = int(container)
    return item in container


def _is_part(item: Any, data: bytes) -> bool:
    if isinstance(item, int):
        return 0 <= item <= 255 and item in data
    is_data = isinstance(item, str | bytes | bytearray | memoryview)
    return is_data and as_bytes(item) in data


def _ordered(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """A comparison in which bytes come before or after text, as its bytes do."""

    def compare(a: Any, b: Any) -> Any:
        if isinstance(a, bytes | bytearray) and isinstance(b, str):
            b = b.encode()
        return operation(a, b)

    return compare


def _to_slice(*args: Any) -> Any:
    """``slice(...)``, which only brackets can make."""
    raise TypeError("can't create 'slice' instances")


def _stepped(
    container: Any,
    start: Any,
    stop: Any,
    step: Any,
) -> Any:
    """``container[start:stop:step]``; only lists support a step."""
    has_step = step is not None and step != 1
    if has_step and isinstance(container, str | bytes | bytearray | memoryview | tuple):
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


def _set_slice(
    value: Any,
    container: Any,
    start: Any,
    stop: Any,
    step: Any,
) -> None:
    """``container[start:stop:step] = value``."""
    container = _sliced(container, step)
    # CPython accepts any iterable here, but a hub does not.
    if isinstance(container, list) and not isinstance(value, list | tuple):
        raise TypeError(f"object '{type(value).__name__}' isn't a tuple or list")
    container[start:stop:step] = value


def _product(a: Any, b: Any) -> Any:
    """``a * b``; a refusal names both classes."""
    # This is checked before the value is made, because this computer might have room for it.
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
    name = operation.__name__.strip("_").removeprefix("i")
    symbol = {"and": "&", "or": "|", "xor": "^"}[name]

    def operate(a: Any, b: Any) -> Any:
        # The commonest case comes first, because this runs all the time.
        if type(a) is int and type(b) is int:
            return operation(a, b)
        if type(a) is bool and type(b) is bool:
            return int(operation(a, b))
        # CPython makes unions of dicts, and types for annotations of classes.
        if isinstance(a, dict | type) or isinstance(b, type):
            raise TypeError(
                f"unsupported operand type(s) for {symbol}: '{type(a).__name__}' and "
                f"'{type(b).__name__}'"
            )
        return operation(a, b)

    return operate


def _list_comprehension(elements: Iterator[Any]) -> list[Any]:
    """The elements; a StopIteration in one of them is not that of a generator."""
    # The heap is looked through for variables of the program, and this list is none yet, so it is
    # measured while it grows.
    items: list[Any] = []
    size_bytes = 0
    try:
        while chunk := list(itertools.islice(elements, _CHECKED_ITEMS)):
            items += chunk
            size_bytes += sum(len(item) for item in chunk if type(item) in _SIZED)
            check_allocation(_ITEM_BYTES[list] * len(items) + size_bytes)
    except RuntimeError as error:
        # CPython turns a StopIteration in a generator into a RuntimeError, and this comprehension
        # is a generator only here.
        if isinstance(error.__cause__, StopIteration):
            raise error.__cause__ from None
        raise error from None
    return items


def _format(
    obj: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``obj.format(...)``, which bytes have too."""
    if isinstance(obj, bytes):
        return format_text(obj.decode("latin-1"), args, kwargs).encode("latin-1")
    if isinstance(obj, str):
        return format_text(obj, args, kwargs)
    return obj.format(*args, **kwargs)


def _f_string(
    value: Any,
    conversion: int,
    spec: str,
) -> str:
    """``{value!conversion:spec}`` in an f-string. ``conversion``: character, or -1 for none."""
    if conversion == ord("r"):
        value = representation(value)
    elif conversion == ord("s"):
        value = text(value)
    return format_value(value, spec)


_MOST_TO_STR = 3
"""Arguments that ``str()`` takes (`str_make_new` of ``py/objstr.c``)."""


def _to_str(*args: Any) -> str:
    """``str(...)``; with more arguments, of bytes in UTF-8, whatever encoding they name."""
    if not args:
        return ""
    if len(args) > _MOST_TO_STR:
        raise TypeError(f"function expected at most {_MOST_TO_STR} arguments, got {len(args)}")
    return text(args[0]) if len(args) == 1 else as_bytes(args[0]).decode()


CONVERSIONS: dict[Any, Callable[..., Any]] = {
    **ITERABLE_CONVERSIONS,
    int: to_int,
    float: to_float,
    slice: _to_slice,
    str: _to_str,
}
"""Calls of builtin classes as on a hub."""


def _convert(
    kind: Any,
    *args: Any,
    **kwargs: Any,
) -> Any:
    """``kind(...)`` of what has the name of a builtin class in the program."""
    convert = CONVERSIONS.get(kind) if isinstance(kind, type) else None
    if convert is None:
        return kind(*args, **kwargs)
    _refuse_keywords(kwargs)
    return convert(*args)


_FUNCTIONS: dict[str, Any] = {
    "@convert": _convert,
    "@sort": sort,
    "@f": _f_string,
    "@format": _format,
    "@in": _contains,
    "@to_bytes": _to_bytes,
    "@from_bytes": _from_bytes,
    "@sub": _subscriptable,
    "@stepped": _stepped,
    "@sliced": _sliced,
    "@setslice": _set_slice,
    "@lt": _ordered(operator.lt),
    "@le": _ordered(operator.le),
    "@gt": _ordered(operator.gt),
    "@ge": _ordered(operator.ge),
    **{f"@{name}": _ascii_method(name) for name in ASCII_METHODS},
}


def operators(namespaces: Sequence[Mapping[str, object]]) -> dict[str, Any]:
    """Functions for the transformed program, by names that programs cannot write. ``namespaces``:
    globals of its modules."""
    normalize = normalizer()

    def divide(a: Any, b: Any) -> Any:
        # A hub divides two integers as floats too.
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
        # The power is not computed, because the result might have millions of digits.
        are_integers = type(a) is int and type(b) is int
        if are_integers and b > 30 and a not in (-1, 0, 1):
            raise OverflowError("small int overflow")
        try:
            return normalize(a**b)
        except OverflowError:
            # CPython raises an error where a hub's power of floats is infinite.
            if isinstance(a, float) or isinstance(b, float):
                return math.inf
            raise

    def multiply(a: Any, b: Any) -> Any:
        return normalize(_product(a, b))

    def add(a: Any, b: Any) -> Any:
        return normalize(add_in_place(a, b))

    def subtract_in_place(a: Any, b: Any) -> Any:
        a -= b
        return normalize(a)

    def runs_finally() -> bool:
        return not (isinstance(sys.exc_info()[1], SwitchedOff) or is_dropped())

    return {
        **_FUNCTIONS,
        **ITERABLE_FUNCTIONS,
        **_DISPLAYS,
        "@n": normalize,
        "@div": divide,
        "@floordiv": floor_divide,
        "@mod": modulo,
        "@pow": power,
        "@mul": multiply,
        "@iadd": add,
        "@isub": subtract_in_place,
        "@and": _bitwise(operator.and_),
        "@or": _bitwise(operator.or_),
        "@xor": _bitwise(operator.xor),
        "@iand": _bitwise(operator.iand),
        "@ior": _bitwise(operator.ior),
        "@ixor": _bitwise(operator.ixor),
        "@any": CATCHABLE,
        "@ends": runs_finally,
        "@reword": lambda error: reword(error, namespaces),
    }


def _dict(*parts: Any) -> HubDict:
    """``{key: value, ...}`` of its parts, each value before its key, as a hub computes it first."""
    # The dict gets as many slots as keys, because its order on a hub depends on them.
    return HubDict.sized(len(parts) // 2, zip(parts[1::2], parts[::2], strict=True))


def _dict_of(pairs: Any) -> HubDict:
    """A dict comprehension, of pairs of value and key."""
    return HubDict.sized(0, ((key, value) for value, key in pairs))


def _set(*values: Any) -> HubSet:
    return HubSet.sized(len(values), values)


def _named(names: Mapping[str, Any]) -> HubDict:
    """The dict of ``**names``."""
    return HubDict.sized(len(names), names.items())


_DISPLAYS: dict[str, Any] = {
    "@dict": _dict,
    "@dictof": _dict_of,
    "@set": _set,
    "@setof": HubSet,
    "@listof": _list_comprehension,
    "@named": _named,
}
"""Functions that make containers, by their names in the transformed program."""
