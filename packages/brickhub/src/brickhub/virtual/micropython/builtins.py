"""Builtin functions of a hub."""

import builtins
import inspect
import math
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import FrameType, MethodType, ModuleType
from typing import Any

from brickhub.virtual.micropython import attributes
from brickhub.virtual.micropython.compiler import compile_string
from brickhub.virtual.micropython.containers import HubDict, HubSet, hash_of
from brickhub.virtual.micropython.exceptions import EXCEPTIONS, HubOSError, ProgramInterrupt
from brickhub.virtual.micropython.floats import SMALL_MAX, int_from_float
from brickhub.virtual.micropython.iterables import sorted_list
from brickhub.virtual.micropython.numbers import module
from brickhub.virtual.micropython.operators import CONVERSIONS, operators
from brickhub.virtual.micropython.streams import Console, HubBytearray, as_bytes, write_text
from brickhub.virtual.micropython.text import format_value, percent, representation, text, to_number

# A list of texts would take a line for each.
_UNCHANGED = """
    all any bool bytes callable chr classmethod complex enumerate float int len list max memoryview
    min object ord range reversed slice str tuple type zip
""".split()  # noqa: SIM905

_ENTER = "\r"
_CTRL_C = "\x03"
_CTRL_D = "\x04"
_BACKSPACES = "\b\x7f"
_MISSING = object()


def cooked(data: bytes) -> bytes:
    """Text as sent over the wire, with CR LF line ends."""
    return data.replace(b"\n", b"\r\n")


def builtin_names(
    namespaces: Sequence[Mapping[str, Any]],
    find_module: Callable[[str], ModuleType],
    console: Console,
    hooks: Mapping[str, Callable[..., Any]],
    missing_builtins: Collection[str],
) -> dict[str, Any]:
    """Builtin names for a program without ``missing_builtins``. ``namespaces``: globals of its
    modules. ``find_module`` raises ImportError."""
    result: dict[str, Any] = {name: getattr(builtins, name) for name in (*_UNCHANGED, *EXCEPTIONS)}
    result.update(operators(namespaces))
    result.update(hooks)
    result.update(attributes.ATTRIBUTE_FUNCTIONS)
    result.update(_FUNCTIONS)
    result.update(_stream_functions(console))
    result["Ellipsis"] = ...
    result["__debug__"] = True
    result["OSError"] = HubOSError
    result["dict"] = HubDict
    result["set"] = HubSet
    result["bytearray"] = HubBytearray
    result["sorted"] = sorted_list
    result["repr"] = representation
    result["@del"] = _delete_global
    result.update(_number_functions(result["@n"], result["@pow"]))
    present = {name: value for name, value in result.items() if name not in missing_builtins}
    # A program can see these, but not the helpers, which have an @ in their names.
    visible = {name: value for name, value in present.items() if "@" not in name}
    builtins_module = module("builtins", visible)

    def find(
        name: str,
        globals: object = None,
        locals: object = None,
        fromlist: object = (),
        level: int = 0,
    ) -> ModuleType:
        if level:
            raise NotImplementedError("relative import")
        found = builtins_module if name == "builtins" else find_module(name)
        # CPython would choose by `__all__`, which a hub does not know.
        if fromlist == ("*",):
            public = {key: value for key, value in vars(found).items() if not key.startswith("_")}
            return module(name, public)
        return found

    present["__import__"] = find
    builtins_module.__dict__["__import__"] = find
    return present


def _named(*functions: Callable[..., Any]) -> dict[str, Any]:
    """Functions by their names on a hub; ours may end with ``_``."""
    return {function.__name__.rstrip("_"): function for function in functions}


def _number_functions(
    normalize: Callable[[Any], Any], power: Callable[[Any, Any], Any]
) -> dict[str, Any]:
    def sum_(values: Iterable[Any], start: Any = 0, /) -> Any:
        # Each sum is rounded and checked, not only the last one.
        for value in values:
            start = normalize(start + value)
        return start

    def round_(value: Any, digits: int | None = None, /) -> Any:
        value = to_number(value, "float")
        if digits is None:
            # Infinity and NaN go on to where they are refused in the hub's words.
            return int_from_float(round(value) if math.isfinite(value) else value)
        # On a hub, a truth value is not an integer here.
        if type(value) is int:
            raise NotImplementedError
        # The hub scales, rounds and scales back, but CPython rounds the decimal digits.
        scale = normalize(10.0**digits)
        scaled = normalize(value * scale)
        if math.isfinite(scaled):
            # The rounded value keeps its sign, as that of -0.2.
            scaled = math.copysign(round(scaled), scaled)
        return normalize(scaled / scale)

    def divmod_(a: Any, b: Any, /) -> tuple[Any, Any]:
        quotient, rest = divmod(a, b)
        return normalize(quotient), normalize(rest)

    def pow_(
        a: Any,
        b: Any,
        modulus: int | None = None,
        /,
    ) -> Any:
        if modulus is not None:
            raise NotImplementedError("3-arg pow() not supported")
        return power(a, b)

    def abs_(value: Any, /) -> Any:
        return normalize(abs(value))

    return _named(sum_, round_, divmod_, pow_, abs_)


def bin_(value: Any, /) -> str:
    return format_value(value, "#b")


def hex_(value: Any, /) -> str:
    return str(percent("%#x", value))


def oct_(value: Any, /) -> str:
    return str(percent("%#o", value))


def map_(function: Any, *values: Iterable[Any]) -> Any:
    # `map(int, ...)` hands a class over without calling it, so the transformation did not see it
    # and it is looked up here.
    if isinstance(function, type):
        function = CONVERSIONS.get(function, function)
    return map(function, *values)


def next_(values: Any, /) -> Any:
    return next(values)


def iter_(values: Any, /) -> Any:
    return iter(values)


def _expect_text(*values: Any) -> None:
    for value in values:
        if not isinstance(value, str):
            raise TypeError(f"can't convert '{type(value).__name__}' object to str implicitly")


def _stream_functions(console: Console) -> dict[str, Any]:
    def print_(
        *values: Any,
        sep: str = " ",
        end: str = "\n",
        file: Any = None,
    ) -> None:
        _expect_text(sep, end)
        if file is None:
            line = sep.join(map(text, values)) + end
            console.write(cooked(line.encode()))
            return
        # A program's stream may tell the pieces apart, so each is written by itself.
        for index, value in enumerate(values):
            if index:
                write_text(file, sep)
            write_text(file, text(value))
        write_text(file, end)

    def input_(prompt: object = "", /) -> str:
        """A line of the hub's editor, which echoes, deletes backwards, and knows no characters
        outside ASCII."""
        console.write(cooked(text(prompt).encode()))
        line = ""
        while True:
            key = console.read(1).decode("latin-1")
            if key == _ENTER:
                break
            if key == _CTRL_C:
                raise ProgramInterrupt
            if key == _CTRL_D and not line:
                raise EOFError
            if " " <= key <= "~":
                line += key
                console.write(key.encode())
            elif key in _BACKSPACES and line:
                line = line[:-1]
                # A terminal erases a character by going one to the left and erasing the rest of the
                # line.
                console.write(b"\b\x1b[K")
        console.write(b"\r\n")
        return line

    return _named(print_, input_)


def open_(*args: object, **kwargs: object) -> None:
    # A hub has no files, so this is always ENOENT.
    raise HubOSError(2)


def id_(value: Any, /) -> int:
    return id(value) & SMALL_MAX


def hash_(value: Any, /) -> int:
    value_hash = hash_of(value)
    if value_hash is not None:
        return value_hash
    # A hub hashes by the address, of which the lowest bits are equal for all objects. A bound
    # method is a new object at each access, but keeps its hash.
    if isinstance(value, MethodType):
        address = id(value.__self__) ^ id(value.__func__)
    else:
        address = id(value)
    return address >> 4 & SMALL_MAX


def _delete_global(name: str) -> None:
    """``del name`` outside functions."""
    # The caller is the program, whose statement this call replaces.
    names = sys._getframe(1).f_globals
    if name not in names:
        raise KeyError(name)
    del names[name]


def getattr_(
    value: Any,
    name: str,
    *default: Any,
) -> Any:
    # The number of arguments is looked at first, as in the firmware (`mp_arg_check_num`).
    if len(default) > 1:
        raise TypeError(f"function expected at most 3 arguments, got {2 + len(default)}")
    _expect_text(name)
    try:
        if attributes.may_be_hidden(name):
            return attributes.visible_attribute(value, name)
        return getattr(value, name)
    except AttributeError:
        if default:
            return default[0]
        raise


def dir_(*values: Any) -> list[str]:
    if len(values) > 1:
        raise TypeError(f"function expected at most 1 arguments, got {len(values)}")
    if not values:
        names = _namespace(sys._getframe(1))
        return sorted(name for name in names if "@" not in name and name != "__builtins__")
    return attributes.directory(values[0])


def hasattr_(value: Any, name: str) -> bool:
    return getattr_(value, name, _MISSING) is not _MISSING


def isinstance_(value: Any, kinds: Any) -> bool:
    if type(value) is bool:
        kinds = _without_int(kinds)
    return isinstance(value, kinds)


def issubclass_(kind: Any, kinds: Any) -> bool:
    if kind is bool:
        kinds = _without_int(kinds)
    return issubclass(kind, kinds)


def setattr_(
    value: Any,
    name: str,
    new: Any,
    /,
) -> None:
    _expect_text(name)
    attributes.store_attribute(new, value, name)


def _without_int(kinds: Any) -> Any:
    """``kinds`` without ``int``: on a hub ``True`` is not an integer."""
    if isinstance(kinds, tuple):
        return tuple(kind for kind in kinds if kind is not int)
    return () if kinds is int else kinds


def _namespace(frame: FrameType) -> Any:
    """Names of the module or class around a frame; on a hub the locals of a function have no
    names."""
    code = frame.f_code
    is_function = code.co_flags & inspect.CO_OPTIMIZED
    is_class = not is_function and code.co_name != "<module>"
    return frame.f_locals if is_class else frame.f_globals


def _run(
    code: Any,
    globals: dict[str, Any] | None,
    locals: Any,
) -> Any:
    # This frame, two calls up, is that of the program which called `eval` or `exec`.
    frame = sys._getframe(2)
    if not (isinstance(globals, dict | None) and isinstance(locals, dict | None)):
        raise TypeError
    if globals is None:
        return eval(code, frame.f_globals, _namespace(frame) if locals is None else locals)
    # CPython's byte code does not use the methods of a subclass of dict, which keep a hub's slots.
    # So it runs with a plain copy, whose changes are written back.
    names = dict(globals) if isinstance(globals, HubDict) else globals
    added = {"__builtins__", "__name__"} - names.keys()
    for name in added:
        names[name] = frame.f_globals[name]
    if locals is None or locals is globals:
        locals = names
    try:
        return eval(code, names, locals)
    finally:
        if names is not globals:
            _write_back(names, globals, added)


def _write_back(
    names: dict[str, Any],
    globals: dict[str, Any],
    added: Collection[str],
) -> None:
    """Changes of a copy of a program's dict, without what was added for CPython."""
    for name in set(globals) - set(names):
        del globals[name]
    globals.update((name, value) for name, value in names.items() if name not in added)


def _decoded(source: Any) -> str:
    if isinstance(source, str):
        return source
    return as_bytes(source).decode()


def eval_(
    source: Any,
    globals: dict[str, Any] | None = None,
    locals: Any = None,
) -> Any:
    return _run(compile_string(_decoded(source), "eval"), globals, locals)


def exec_(
    source: Any,
    globals: dict[str, Any] | None = None,
    locals: Any = None,
) -> None:
    _run(compile_string(_decoded(source)), globals, locals)


def globals_() -> dict[str, Any]:
    return sys._getframe(1).f_globals


def locals_() -> Any:
    return _namespace(sys._getframe(1))


_FUNCTIONS = _named(
    bin_,
    hex_,
    oct_,
    map_,
    next_,
    iter_,
    open_,
    id_,
    hash_,
    getattr_,
    dir_,
    hasattr_,
    isinstance_,
    issubclass_,
    setattr_,
    eval_,
    exec_,
    globals_,
    locals_,
)
