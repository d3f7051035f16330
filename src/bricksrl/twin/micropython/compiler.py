"""From the source of a program to code that CPython runs as a hub would."""

from __future__ import annotations

import ast
import functools
import re
import warnings
from types import CodeType
from typing import Any

import mpy_cross_v6

from bricksrl.twin.micropython.transform import transform


@functools.lru_cache(maxsize=64)
def compiled(source: str, filename: str, mode: str = "exec") -> CodeType:
    """The code of a program, or of an expression (``mode="eval"``).

    Raises:
        SyntaxError: the hub's compiler refuses it.
        OverflowError: it holds a number that needs more than 31 bits.
    """
    _check_with_hub_compiler(source, filename)
    tree: Any = ast.parse(source, filename, mode)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        code = compile(transform(tree), filename, mode, dont_inherit=True)
    classes = {node.name.lstrip("_") for node in ast.walk(tree) if isinstance(node, ast.ClassDef)} - {""}
    if not classes or "__" not in source:
        return code
    written = frozenset(re.findall(r"\w+", source))
    return _unmangled(code, re.compile(f"_(?:{'|'.join(sorted(classes))})(__\\w+)"), written)


def _unmangled(code: CodeType, mangled: re.Pattern[str], written: frozenset[str]) -> CodeType:
    """Names with two underscores as the program wrote them: a hub does not put the name of the class before them."""

    def plain(names: tuple[str, ...]) -> tuple[str, ...]:
        matches = [None if name in written else mangled.fullmatch(name) for name in names]
        return tuple(match[1] if match else name for name, match in zip(names, matches, strict=True))

    return code.replace(
        co_names=plain(code.co_names),
        co_varnames=plain(code.co_varnames),
        co_cellvars=plain(code.co_cellvars),
        co_freevars=plain(code.co_freevars),
        co_consts=tuple(_unmangled(c, mangled, written) if isinstance(c, CodeType) else c for c in code.co_consts),
    )


def _check_with_hub_compiler(source: str, filename: str) -> None:
    process, _ = mpy_cross_v6.mpy_cross_compile(filename, source, extra_args=["-msmall-int-bits=31"])
    if process.returncode == 0:
        return
    report = process.stderr.decode()
    line = re.search(r'File "<stdin>", line (\d+)', report)
    kind, _, message = report.strip().splitlines()[-1].partition(": ")
    error = IndentationError if kind == "IndentationError" else SyntaxError
    raise error(message or kind, (filename, int(line[1]) if line else None, None, None))
