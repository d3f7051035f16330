"""Modules ``math``, ``random`` and ``struct`` of a hub."""

import functools
import math
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType, ModuleType
from typing import Any

from brickhub.virtual.micropython.floats import int_from_float, to_single
from brickhub.virtual.micropython.memory import check_allocation
from brickhub.virtual.micropython.operators import small
from brickhub.virtual.micropython.streams import as_bytes
from brickhub.virtual.micropython.text import to_number

_MASK = 0xFFFFFFFF
_PI = to_single(math.pi)
# The hub's C compiler computes these constants, so they are rounded once.
_RADIANS = to_single(_PI / 180)
_DEGREES = to_single(180 / _PI)
_BINARY_FUNCTIONS = ("atan2", "pow", "fmod", "copysign")
_ROUNDED = (
    *("sin", "asin", "cos", "acos", "tan", "atan", "exp", "sqrt", "fabs"),
    *_BINARY_FUNCTIONS,
)
"""Functions of floats that CPython has too, in double precision."""
_CODES = re.compile(r"(\d*)([xbBhHiIlLqQPOsefd])")
_LAYOUT = re.compile(r"[@<>!]?(\d*[xbBhHiIlLqQPOsefd])*")
_WIDE = frozenset("iIlLqQd")
"""Codes of values that may be too large for a hub's integers, or too precise for its floats."""
_HALF_INFINITE = 65520.0
"""Least float that is infinite in 16 bits."""


def module(
    module_name: str,
    names: Mapping[str, Any] = MappingProxyType({}),
    *functions: Callable[..., Any],
) -> ModuleType:
    """A module with these names, and with functions by their own; ours may end with ``_``."""
    result = ModuleType(module_name)
    # CPython puts names such as `__loader__` into modules, which a hub does not have.
    result.__dict__.clear()
    result.__dict__.update({"__name__": module_name, **names})
    result.__dict__.update((function.__name__.rstrip("_"), function) for function in functions)
    return result


def _as_float(value: Any) -> float:
    return to_single(to_number(value, "float"))


def math_module() -> ModuleType:
    # Functions that a program calls are inside of these functions: `exceptions.py` tells them from
    # the program's own by the `_module` in their qualified names.
    def test(function: Callable[[float], bool]) -> Callable[[Any], bool]:
        return lambda x, /: function(_as_float(x))

    def ldexp(mantissa: Any, exponent: Any, /) -> float:
        expect_int(exponent)
        return to_single(math.ldexp(_as_float(mantissa), exponent))

    def log(x: Any, base: Any = None, /) -> float:
        x = _as_float(x)
        if x <= 0 or (base is not None and _as_float(base) <= 0):
            raise ValueError("math domain error")
        if base == 1:
            raise ZeroDivisionError("divide by zero")
        if base is None:
            return to_single(math.log(x))
        # A hub divides two logarithms, and `math.log(x, base)` may round differently.
        return to_single(math.log(x) / math.log(base))

    names: dict[str, Any] = {name: _rounded(getattr(math, name)) for name in _ROUNDED}
    for name in ("isfinite", "isinf", "isnan"):
        names[name] = test(getattr(math, name))
    for name in ("ceil", "floor", "trunc"):
        names[name] = _to_integer(getattr(math, name))
    names["degrees"] = lambda x, /: to_single(_as_float(x) * _DEGREES)
    names["radians"] = lambda x, /: to_single(_as_float(x) * _RADIANS)
    names["frexp"] = lambda x, /: math.frexp(_as_float(x))
    names["modf"] = lambda x, /: tuple(map(to_single, math.modf(_as_float(x))))
    names["e"] = to_single(math.e)
    names["pi"] = _PI
    return module("math", names, ldexp, log)


def _rounded(function: Callable[..., float]) -> Callable[..., float]:
    """A function of floats in single precision, which does not return infinity for finite
    arguments."""
    count = 2 if function.__name__ in _BINARY_FUNCTIONS else 1

    def call(*args: Any) -> float:
        if len(args) != count:
            raise TypeError(
                f"function takes {count} positional arguments but {len(args)} were given"
            )
        values = [_as_float(value) for value in args]
        try:
            result = to_single(function(*values))
        except (OverflowError, ValueError):
            raise ValueError("math domain error") from None
        # An overflow of single precision gives infinity here, but an error on a hub
        # (`py/modmath.c`).
        if math.isinf(result) and not any(map(math.isinf, values)):
            raise ValueError("math domain error")
        return result

    return call


def _to_integer(function: Callable[[float], int]) -> Callable[[Any], int]:
    def call(x: Any, /) -> int:
        x = _as_float(x)
        # Infinity and NaN go on to where they are refused in the hub's words.
        whole = float(function(x)) if math.isfinite(x) else x
        return int_from_float(whole)

    return call


class _Yasmarang:
    """The hub's pseudo-random generator: equal seeds give equal sequences.

    Ilya Levin's, of 32 bits (``extmod/modrandom.c``). Random numbers of a program are the same as
    on a hub with the same seed.
    """

    def seed(self, seed: int) -> None:
        self._pad = seed & _MASK
        self._n = 69
        self._d = 233
        self._dat = 0

    def next(self) -> int:
        pad = (self._pad + self._dat + self._d * self._n) & _MASK
        pad = ((pad << 3) + (pad >> 29)) & _MASK
        self._pad = pad
        self._n = pad | 2
        self._d ^= ((pad << 31) + (pad >> 1)) & _MASK
        self._dat ^= (pad ^ (self._d >> 8) ^ 1) & 0xFF
        return (pad ^ (self._d << 5) ^ (pad >> 18) ^ (self._dat << 1)) & _MASK

    def below(self, n: int) -> int:
        # Numbers are drawn again until one is small enough, because a remainder would prefer small
        # ones.
        mask = 1
        while (n & mask) < n:
            mask = mask << 1 | 1
        value = self.next() & mask
        while value >= n:
            value = self.next() & mask
        return value

    def fraction(self) -> float:
        # This takes as many bits as a hub's float has behind its first one.
        return (self.next() & 0x7FFFFF) / 0x800000


def expect_int(*values: Any) -> None:
    """Raise TypeError unless all are integers."""
    for value in values:
        if not isinstance(value, int):
            raise TypeError(f"can't convert {type(value).__name__} to int")


def random_module(clock_us: int) -> ModuleType:
    """``clock_us``: the hub's seed at program start."""
    source = _Yasmarang()
    source.seed(clock_us)

    def getrandbits(k: int, /) -> int:
        expect_int(k)
        if not 0 <= k <= 32:
            raise ValueError("bits must be 32 or less")
        # A hub draws nothing for no bits, which keeps its sequence of numbers.
        if k == 0:
            return 0
        return small(source.next() & (_MASK >> (32 - k)))

    def randrange(
        start: int,
        stop: int | None = None,
        step: int = 1,
        /,
    ) -> int:
        expect_int(start, step, 0 if stop is None else stop)
        low, high = (0, start) if stop is None else (start, stop)
        count = 0
        if step:
            rounding_up = step - (1 if step > 0 else -1)
            count = (high - low + rounding_up) // step
        if count <= 0:
            raise ValueError
        return low + step * source.below(count)

    def randint(a: int, b: int, /) -> int:
        expect_int(a, b)
        if a > b:
            raise ValueError
        return a + source.below(b - a + 1)

    def choice(values: Sequence[Any], /) -> Any:
        if not len(values):
            raise IndexError
        return values[source.below(len(values))]

    def uniform(a: float, b: float, /) -> float:
        low = _as_float(a)
        high = _as_float(b)
        # Each operation rounds, as on a processor with single precision.
        span = to_single(high - low)
        return to_single(low + to_single(span * source.fraction()))

    def seed(a: int | None = None, /) -> None:
        expect_int(0 if a is None else a)
        source.seed(clock_us if a is None else a)

    return module(
        "random",
        {"random": source.fraction},
        getrandbits,
        randrange,
        randint,
        choice,
        uniform,
        seed,
    )


class _Layout:
    """A format string as a hub reads it: native ``l`` has 4 bytes; values wrap around."""

    def __init__(self, text: Any) -> None:
        if not isinstance(text, str | bytes):
            raise TypeError(f"can't convert '{type(text).__name__}' object to str implicitly")
        text = text.decode() if isinstance(text, bytes) else text
        if not _LAYOUT.fullmatch(text):
            raise ValueError("bad typecode")
        order = "@"
        if text.startswith(("@", "<", ">", "!")):
            order = text[0]
        # Pointers and objects take four bytes, as addresses on a hub do.
        codes = text.lstrip("@<>!").replace("P", "I").replace("O", "I")
        # A native long may take eight bytes on this computer.
        if order == "@":
            codes = codes.replace("l", "i").replace("L", "I")
        self.struct = struct.Struct(order + codes)
        check_allocation(self.struct.size)
        self.codes: list[str] = []
        """One of each value: a count repeats it, but for ``s``, whose count is its length."""
        for count, code in _CODES.findall(codes):
            if code == "s":
                self.codes.append(code)
            elif code != "x":
                self.codes += code * int(count or 1)
        self.is_wide = bool(_WIDE & set(self.codes))

    def pack(self, values: tuple[Any, ...]) -> bytes:
        # Most values fit, and then nothing that a hub does differently matters.
        try:
            return self.struct.pack(*values)
        except (struct.error, OverflowError):
            return self.struct.pack(*map(self._wrapped, self.codes, values))

    @staticmethod
    def _wrapped(code: str, value: Any) -> Any:
        if code == "s":
            return as_bytes(value)
        if code in "efd":
            number = to_single(_as_float(value))
            # CPython would refuse to pack a number that a hub stores as infinity.
            if code == "e" and abs(number) >= _HALF_INFINITE:
                return math.copysign(math.inf, number)
            return number
        if isinstance(value, float) or not isinstance(value, int):
            raise TypeError(f"can't convert {type(value).__name__} to int")
        # A hub writes the lowest bytes of an integer, whatever its sign and size.
        bits = 8 * struct.calcsize("=" + code)
        value &= (1 << bits) - 1
        is_signed = code.islower()
        is_negative = is_signed and value >> (bits - 1)
        return value - (1 << bits) if is_negative else value

    def checked(self, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if not self.is_wide:
            return values
        checked: list[Any] = []
        for value in values:
            if type(value) is int:
                checked.append(small(value))
            elif type(value) is float:
                checked.append(to_single(value))
            else:
                checked.append(value)
        return tuple(checked)


def struct_module() -> ModuleType:
    # Programs pack in loops, with few formats.
    cached_layout = functools.cache(_Layout)

    def pack(fmt: str, /, *values: Any) -> bytes:
        layout = cached_layout(fmt)
        # A hub writes zeros for missing values, and ignores further ones.
        if len(values) != len(layout.codes):
            values = (values + (0,) * len(layout.codes))[: len(layout.codes)]
        return layout.pack(values)

    def pack_into(
        fmt: str,
        buffer: bytearray,
        offset: int,
        /,
        *values: Any,
    ) -> None:
        if not isinstance(buffer, bytearray | memoryview):
            raise TypeError("object with buffer protocol required")
        data = pack(fmt, *values)
        start = offset + len(buffer) if offset < 0 else offset
        if start < 0 or start + len(data) > len(buffer):
            raise ValueError("buffer too small")
        buffer[start : start + len(data)] = data

    def unpack_from(
        fmt: str,
        data: bytes,
        offset: int = 0,
        /,
    ) -> tuple[Any, ...]:
        layout = cached_layout(fmt)
        try:
            return layout.checked(layout.struct.unpack_from(data, offset))
        except struct.error:
            raise ValueError("buffer too small") from None
        except TypeError:
            return unpack_from(fmt, as_bytes(data), offset)

    def calcsize(fmt: str, /) -> int:
        return cached_layout(fmt).struct.size

    return module(
        "struct",
        {"unpack": unpack_from},
        pack,
        pack_into,
        unpack_from,
        calcsize,
    )
