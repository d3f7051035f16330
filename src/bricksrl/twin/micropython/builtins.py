"""The builtin functions of a hub."""

from __future__ import annotations

import ast
import builtins
import math
import sys
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

from bricksrl.twin.console import Console
from bricksrl.twin.micropython.attributes import visible_attribute
from bricksrl.twin.micropython.errors import EXCEPTIONS, HubOSError
from bricksrl.twin.micropython.operators import int_from_float, operators, to_float, to_int, to_str
from bricksrl.twin.micropython.text import representation, text
from bricksrl.twin.micropython.transform import transform

_AS_THEY_ARE = [
    "all",
    "any",
    "bin",
    "bool",
    "bytearray",
    "bytes",
    "callable",
    "chr",
    "classmethod",
    "complex",
    "dict",
    "dir",
    "enumerate",
    "float",
    "getattr",
    "hasattr",
    "hash",
    "hex",
    "int",
    "isinstance",
    "issubclass",
    "iter",
    "len",
    "list",
    "max",
    "min",
    "next",
    "object",
    "oct",
    "ord",
    "range",
    "reversed",
    "set",
    "setattr",
    "slice",
    "sorted",
    "staticmethod",
    "str",
    "super",
    "tuple",
    "type",
    "zip",
]


def cooked(data: bytes) -> bytes:
    """What goes over the wire when a program writes text."""
    return data.replace(b"\n", b"\r\n")


def builtin_names(
    names: dict[str, Any],
    find_module: Callable[[str], ModuleType],
    console: Console,
    tick: Callable[[], None],
    has_memoryview: bool,
) -> dict[str, Any]:
    """The namespace behind a program's globals ``names``; ``find_module`` raises ImportError."""
    result: dict[str, Any] = {name: getattr(builtins, name) for name in (*_AS_THEY_ARE, *EXCEPTIONS)}
    if has_memoryview:
        result["memoryview"] = memoryview
    result.update(operators(names))
    result.update({"@tick": tick, "@attr": visible_attribute, "Ellipsis": ..., "__debug__": True, "OSError": HubOSError})
    result["__build_class__"] = _build_class
    result["__import__"] = _importer(find_module)
    result.update(_number_functions(result["@n"], result["@pow"]))
    result.update(_stream_functions(console))
    result.update(_program_functions())
    return result


def _build_class(body: Any, name: str, *bases: Any, **keywords: Any) -> Any:
    if len(bases) > 1:
        raise NotImplementedError("multiple inheritance not supported")
    return builtins.__build_class__(body, name, *bases, **keywords)


def _importer(find_module: Callable[[str], ModuleType]) -> Callable[..., ModuleType]:
    def find(name: str, globals: object = None, locals: object = None, fromlist: object = (), level: int = 0) -> ModuleType:
        if level:
            raise NotImplementedError("relative import")
        found = find_module(name)
        return found if fromlist or "." not in name else find_module(name.partition(".")[0])

    return find


def _number_functions(normalize: Callable[[Any], Any], power: Callable[[Any, Any], Any]) -> dict[str, Any]:
    def sum_(values: Iterable[Any], start: Any = 0) -> Any:
        for value in values:
            start = normalize(start + value)
        return start

    def round_(value: Any, digits: int | None = None) -> Any:
        if not isinstance(value, int | float):
            raise TypeError(f"can't convert {type(value).__name__} to float")
        if digits is None:
            return int_from_float(round(value)) if math.isfinite(value) else int_from_float(value)
        if isinstance(value, int):
            return round(value, digits)
        scale = 10.0**digits
        return normalize(round(normalize(value * scale)) / scale) if math.isfinite(value) else value

    def divmod_(a: Any, b: Any) -> tuple[Any, Any]:
        quotient, rest = divmod(a, b)
        return normalize(quotient), normalize(rest)

    def pow_(a: Any, b: Any, modulus: int | None = None) -> Any:
        return power(a, b) if modulus is None else pow(a, b, modulus)

    def map_(function: Any, *values: Iterable[Any]) -> Any:
        conversions: dict[Any, Callable[..., Any]] = {int: to_int, float: to_float, str: to_str}
        convert = conversions.get(function) if isinstance(function, type) else None
        return map(function, *values) if convert is None else map(lambda *args: convert(function, *args), *values)

    return {"abs": lambda value: normalize(abs(value)), "sum": sum_, "round": round_, "divmod": divmod_, "pow": pow_, "map": map_}


def _stream_functions(console: Console) -> dict[str, Any]:
    def print_(*values: Any, sep: str = " ", end: str = "\n", file: Any = None) -> None:
        line = sep.join(map(text, values)) + end
        if file is None:
            console.write(cooked(line.encode()))
        else:
            file.write(line)

    def input_(prompt: object = "") -> str:
        """Echoes what comes in, as the hub's line editor does."""
        console.write(cooked(text(prompt).encode()))
        line = bytearray()
        while (byte := console.read(1)) not in (b"\r", b"\n"):
            line += byte
            console.write(byte)
        console.write(b"\r\n")
        return line.decode()

    def open_(*args: object, **kwargs: object) -> None:
        raise HubOSError(2)

    return {"print": print_, "input": input_, "open": open_, "repr": representation, "id": lambda value: id(value) & 0x3FFFFFFF}


def _program_functions() -> dict[str, Any]:
    def namespaces(globals: dict[str, Any] | None, locals: Any) -> tuple[dict[str, Any], Any]:
        frame = sys._getframe(2)
        if globals is None:
            return frame.f_globals, frame.f_locals
        globals.setdefault("__builtins__", frame.f_globals["__builtins__"])
        return globals, globals if locals is None else locals

    def eval_(source: str, globals: dict[str, Any] | None = None, locals: Any = None) -> Any:
        spaces = namespaces(globals, locals)
        return eval(compile(transform(ast.parse(source.strip(), "<string>", "eval")), "<string>", "eval"), *spaces)

    def exec_(source: str, globals: dict[str, Any] | None = None, locals: Any = None) -> None:
        spaces = namespaces(globals, locals)
        exec(compile(transform(ast.parse(source, "<string>", "exec")), "<string>", "exec"), *spaces)

    def globals_() -> dict[str, Any]:
        return sys._getframe(1).f_globals

    def locals_() -> dict[str, Any]:
        return sys._getframe(1).f_locals

    return {"eval": eval_, "exec": exec_, "globals": globals_, "locals": locals_}
