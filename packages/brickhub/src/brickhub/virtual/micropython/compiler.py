"""Compiler of programs to code that behaves on CPython as on a hub."""

from __future__ import annotations

import ast
import functools
import re
import warnings
from collections.abc import Iterator
from types import CodeType

import mpy_cross_v6

from brickhub.hub.program.syntax import TEXT, deep_recursion, parse
from brickhub.virtual.micropython.floats import SMALL_MAX
from brickhub.virtual.micropython.syntax.assignment_expressions import lose_assignments
from brickhub.virtual.micropython.syntax.calls import called_name
from brickhub.virtual.micropython.syntax.transform import transform

STRING = "<string>"
"""File name of what ``eval`` and ``exec`` compile."""


@functools.lru_cache(maxsize=64)
def compile_source(source: str, filename: str, mode: str = "exec") -> CodeType:
    """Code of a program, or of an expression (``mode="eval"``). Raises SyntaxError if the hub's compiler refuses it,
    OverflowError if a constant needs more than 31 bits."""
    constants = list(_constants(_compile_for_hub(source, filename)))
    if any(kind == _INTEGER and (len(value) > _MAX_DIGITS or abs(int(value)) > SMALL_MAX) for kind, value in constants):
        raise OverflowError("long int not supported in this build")  # a hub reads the digits before the sign
    # what `eval` and `exec` compile on the hub has no text of constants
    floats = [value.decode() for kind, value in constants if kind == _FLOAT and filename != STRING]
    with deep_recursion(), warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        tree = parse(source, filename, mode)
        lose_assignments(tree)
        code = compile(transform(tree, _recursive_names(tree), floats), filename, mode, dont_inherit=True)
    code = _with_names_of_hub(code)
    classes = {node.name.lstrip("_") for node in ast.walk(tree) if isinstance(node, ast.ClassDef)} - {""}
    if not classes or "__" not in source:
        return code
    words = frozenset(re.findall(r"\w+", source))
    return _unmangled(code, re.compile(f"_(?:{'|'.join(sorted(classes))})(__\\w+)"), words)


def compile_string(source: str, mode: str = "exec") -> CodeType:
    """Code of what ``exec`` or ``eval`` (``mode="eval"``) get, from the compiler on the hub itself, which is stricter than
    mpy-cross. Raises as `compile_source`."""
    numbers = (match["number"] for match in _LEADING_ZERO.finditer(source))
    if number := next(filter(None, numbers), None):
        raise _at_line(1, SyntaxError(f"invalid syntax for integer with base 0: '{number.replace('_', '')}'"))
    if mode == "eval" and source[:1] in (" ", "\t"):
        raise _at_line(1, IndentationError("unexpected indent"))
    if mode == "eval" and source[:1] in ("\n", "\r"):
        raise _at_line(1, SyntaxError("invalid syntax"))
    try:
        code = compile_source(source.strip() if mode == "eval" else source, STRING, mode)
    except SyntaxError as error:
        if len(error.args) > 1:  # from CPython: the hub's has a message only
            error.args = ("invalid syntax",) if mode == "eval" else error.args[:1]
            error.msg = error.args[0]
        raise
    nodes = list(ast.walk(parse(source, STRING, mode)))
    if texts := [node for node in nodes if isinstance(node, ast.JoinedStr)]:  # f-strings
        raise _at_line(texts[0].lineno, SyntaxError("invalid syntax"))
    if any(map(_is_large, nodes)):
        raise OverflowError("long int not supported in this build")  # the digits of -1073741824 are read before the sign
    return code


_LEADING_ZERO = re.compile(rf"{TEXT}|(?<![\w.])(?P<number>0[0-9_]*[1-9][0-9_]*)(?![\w.])", re.DOTALL)


def _at_line(line: int, error: SyntaxError) -> SyntaxError:
    error.filename, error.lineno = STRING, line
    return error


def _is_large(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int and node.value > SMALL_MAX


def _recursive_names(tree: ast.AST) -> set[str]:
    """Names of functions that may call themselves, directly or through others; those of methods begin with a point."""
    methods = {part for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for part in node.body}
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    names = [f".{function.name}" if function in methods else function.name for function in functions]
    calls: dict[str, set[str]] = {name: set() for name in names}
    for name, function in zip(names, functions, strict=True):
        called = {called_name(node) for node in ast.walk(function) if isinstance(node, ast.Call)}
        calls[name] |= called & calls.keys()
    for through, beyond in calls.items():  # Warshall's algorithm
        for reached in calls.values():
            if through in reached:
                reached |= beyond
    return {name for name, reached in calls.items() if name in reached}


def _with_names_of_hub(code: CodeType) -> CodeType:
    """Name list comprehensions, which `transform` makes generators, as a hub does."""
    constants = tuple(_with_names_of_hub(part) if isinstance(part, CodeType) else part for part in code.co_consts)
    name = "<listcomp>" if "@element" in code.co_names else code.co_name
    return code.replace(co_consts=constants, co_name=name)


def _unmangled(code: CodeType, mangled: re.Pattern[str], words: frozenset[str]) -> CodeType:
    """Undo name mangling, which a hub does not have."""

    def demangled(names: tuple[str, ...]) -> tuple[str, ...]:
        matches = [None if name in words else mangled.fullmatch(name) for name in names]
        return tuple(match[1] if match else name for name, match in zip(names, matches, strict=True))

    return code.replace(
        co_names=demangled(code.co_names),
        co_varnames=demangled(code.co_varnames),
        co_cellvars=demangled(code.co_cellvars),
        co_freevars=demangled(code.co_freevars),
        co_consts=tuple(_unmangled(c, mangled, words) if isinstance(c, CodeType) else c for c in code.co_consts),
    )


def _compile_for_hub(source: str, filename: str) -> bytes:
    """The program as ``.mpy``. Raises SyntaxError."""
    process, mpy = mpy_cross_v6.mpy_cross_compile(filename, source, extra_args=["-msmall-int-bits=31"])
    if mpy is not None:
        return bytes(mpy)
    report = process.stderr.decode()
    kind, _, message = report.strip().splitlines()[-1].partition(": ")
    error = (IndentationError if kind == "IndentationError" else SyntaxError)(message or kind)
    if location := re.search(r'File ".*", line (\d+)(?:, in (\S+))?', report):
        error.filename, error.lineno, error.text = filename, int(location[1]), location[2]
    raise error


_HEADER_BYTES = 4
_TEXT, _INTEGER, _FLOAT, _TUPLE = (5, 6), 7, 8, 10
_WITHOUT_DATA = 4
_MAX_DIGITS = 20
"""More than any integer of 31 bits has, and few enough to be read at once."""


def _constants(mpy: bytes) -> Iterator[tuple[int, bytes]]:
    """Kinds and text of the constants of a compiled program.

    Format: version 6 of ``.mpy``, ``py/persistentcode.c``. Numbers are decimal; small integers outside of tuples are in the code.
    """
    position = _HEADER_BYTES

    def number() -> int:
        nonlocal position
        value, more = 0, True
        while more:
            value, more = value << 7 | mpy[position] & 0x7F, bool(mpy[position] & 0x80)
            position += 1
        return value

    names, constants = number(), number()
    for _ in range(names):
        length = number()
        position += 0 if length & 1 else (length >> 1) + 1
    while constants:
        constants -= 1
        kind = mpy[position]
        position += 1
        if kind == _TUPLE:
            constants += number()
        elif kind > _WITHOUT_DATA:
            length = number()
            yield kind, mpy[position : position + length]
            position += length + (kind in _TEXT)
