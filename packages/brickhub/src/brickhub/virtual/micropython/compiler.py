"""Compiler of programs to code that behaves on CPython as on a hub."""

import ast
import functools
import re
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from types import CodeType
from typing import Any

from brickhub.hub.program.compile import cross_compile
from brickhub.hub.program.syntax import TEXT, deep_recursion, parse
from brickhub.virtual.micropython.floats import SMALL_MAX
from brickhub.virtual.micropython.transform import COMPREHENSIONS, called_name, transform

_Function = ast.FunctionDef | ast.AsyncFunctionDef
_Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
STRING = "<string>"
"""File name of what ``eval`` and ``exec`` compile."""
_LEADING_ZERO = re.compile(
    rf"{TEXT}|(?<![\w.])(?P<number>0[0-9_]*[1-9][0-9_]*)(?![\w.])", re.DOTALL
)
_HEADER_BYTES = 4
_TEXT = (5, 6)
_INTEGER = 7
_FLOAT = 8
_TUPLE = 10
_WITHOUT_DATA = 4
_KINDS_OF_NAMES = ("co_names", "co_varnames", "co_cellvars", "co_freevars")
_MAX_DIGITS = 20
"""More than any integer of 31 bits has, and few enough to be read at once."""


@dataclass
class _Scope:
    """Scope of names.

    Attributes:
        keeps: whether a comprehension's assignments always reach it.
        declared: names that are global or nonlocal in it.
        variables: of a function that is in no other.
        reads: names that a comprehension reads; ``None`` for other scopes.
        lost: names whose assignments it loses.
    """

    keeps: bool
    declared: Collection[str] = ()
    variables: set[str] | None = None
    reads: set[str] | None = None
    lost: set[str] = field(default_factory=set)


class _Loser(ast.NodeTransformer):
    """Loses assignments ``name := value`` in comprehensions, as a hub mostly does within functions.

    The hub's compiler stores the value under the number of the function's variable, but among the
    variables of the comprehension, which is a function of its own: the function's variable stays as
    it was. It changes where both numbers are the same: the comprehension reads the name, and all
    other variables of the function. At the top level, and for names that the function declares
    global or nonlocal, the value is always kept. The name remains a variable of the function.
    """

    def __init__(self) -> None:
        self._scopes = [_Scope(keeps=True)]

    def visit_FunctionDef(self, node: _Function) -> ast.AST:
        for part in (*node.decorator_list, node.args):
            self.visit(part)
        declarations = (
            part for part in ast.walk(node) if isinstance(part, ast.Global | ast.Nonlocal)
        )
        declared = {name for part in declarations for name in part.names}
        is_inner = any(not scope.keeps for scope in self._scopes)
        arguments = {part.arg for part in ast.walk(node.args) if isinstance(part, ast.arg)}
        variables = None if is_inner else {*arguments, *_assigned(node.body)} - declared
        self._scopes.append(_Scope(keeps=False, declared=declared, variables=variables))
        node.body = [self.visit(statement) for statement in node.body]
        for name in sorted(self._scopes.pop().lost):
            assign = ast.Assign([ast.Name(name, ast.Store())], ast.Constant(None))
            node.body.insert(
                0, ast.copy_location(ast.If(ast.Constant(False), [assign], []), node.body[0])
            )
        return node

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Lambda(self, node: ast.Lambda) -> ast.AST:
        self.visit(node.args)
        self._scopes.append(_Scope(keeps=False))
        node.body = self.visit(node.body)
        self._scopes.pop()
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        self._scopes.append(_Scope(keeps=True))
        self.generic_visit(node)
        self._scopes.pop()
        return node

    def visit_ListComp(self, node: _Comprehension) -> ast.AST:
        first = node.generators[0]
        first.iter = self.visit(first.iter)
        # computed in the scope around
        iterable = first.iter
        first.iter = ast.Constant(None)
        names = [part for part in ast.walk(node) if isinstance(part, ast.Name)]
        own = {
            name.id
            for generator in node.generators
            for name in ast.walk(generator.target)
            if isinstance(name, ast.Name)
        }
        reads = {name.id for name in names if isinstance(name.ctx, ast.Load)} - own
        self._scopes.append(_Scope(keeps=False, reads=reads))
        self.generic_visit(node)
        self._scopes.pop()
        first.iter = iterable
        return node

    visit_SetComp = visit_DictComp = visit_GeneratorExp = visit_ListComp

    def visit_NamedExpr(self, node: ast.NamedExpr) -> ast.AST:
        self.generic_visit(node)
        name = node.target.id
        reads = self._scopes[-1].reads
        around = self._scopes[-2:][0]
        if reads is None or around.keeps or name in around.declared:
            return node
        if around.variables is not None and name in reads and reads >= around.variables:
            return node
        around.lost.add(name)
        return node.value


def _assigned(nodes: Collection[ast.AST]) -> Iterator[str]:
    """Names that statements and expressions assign in their own scope."""
    for node in nodes:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.alias):
            yield node.asname or node.name.partition(".")[0]
        elif isinstance(node, ast.ExceptHandler | _Function | ast.ClassDef) and node.name:
            yield node.name
        if isinstance(node, _Comprehension):
            yield from (
                part.target.id for part in ast.walk(node) if isinstance(part, ast.NamedExpr)
            )
        elif not isinstance(node, _Function | ast.ClassDef | ast.Lambda):
            yield from _assigned(list(ast.iter_child_nodes(node)))


@functools.lru_cache(maxsize=64)
def compile_source(source: str, filename: str, mode: str = "exec") -> CodeType:
    """Code of a program, or of an expression (``mode="eval"``). Raises SyntaxError if the hub's
    compiler refuses it, OverflowError if a constant needs more than 31 bits."""
    constants = list(_constants(_compile_for_hub(source, filename)))
    if any(
        kind == _INTEGER and (len(value) > _MAX_DIGITS or abs(int(value)) > SMALL_MAX)
        for kind, value in constants
    ):
        # a hub reads the digits before the sign
        raise OverflowError("long int not supported in this build")
    # what `eval` and `exec` compile on the hub has no text of constants
    floats = [value.decode() for kind, value in constants if kind == _FLOAT and filename != STRING]
    with deep_recursion(), warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        tree = parse(source, filename, mode)
        if any(isinstance(node, ast.NamedExpr) for node in ast.walk(tree)):
            _Loser().visit(tree)
        code = compile(
            transform(tree, _recursive_names(tree), floats), filename, mode, dont_inherit=True
        )
    classes = {
        node.name.lstrip("_") for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    } - {""}
    mangled = (
        re.compile(f"_(?:{'|'.join(sorted(classes))})(__\\w+)")
        if classes and "__" in source
        else None
    )
    return _with_names_of_hub(code, mangled, frozenset(re.findall(r"\w+", source)))


def compile_string(source: str, mode: str = "exec") -> CodeType:
    """Code of what ``exec`` or ``eval`` (``mode="eval"``) get, from the compiler on the hub itself,
    which is stricter than mpy-cross. Raises as `compile_source`."""
    numbers = (match["number"] for match in _LEADING_ZERO.finditer(source))
    if number := next(filter(None, numbers), None):
        raise _at_line(
            1, SyntaxError(f"invalid syntax for integer with base 0: '{number.replace('_', '')}'")
        )
    if mode == "eval" and source[:1] in (" ", "\t"):
        raise _at_line(1, IndentationError("unexpected indent"))
    if mode == "eval" and source[:1] in ("\n", "\r"):
        raise _at_line(1, SyntaxError("invalid syntax"))
    try:
        code = compile_source(source.strip() if mode == "eval" else source, STRING, mode)
    except SyntaxError as error:
        error.lineno = min(error.lineno or 1, source.count("\n") + 1)
        if len(error.args) > 1:  # from CPython: the hub's has a message only
            error.args = ("invalid syntax",) if mode == "eval" else error.args[:1]
            error.msg = error.args[0]
        raise
    nodes = list(ast.walk(parse(source, STRING, mode)))
    if texts := [node for node in nodes if isinstance(node, ast.JoinedStr)]:  # f-strings
        raise _at_line(texts[0].lineno, SyntaxError("invalid syntax"))
    if any(
        isinstance(node, ast.Constant) and type(node.value) is int and node.value > SMALL_MAX
        for node in nodes
    ):
        # the digits of -1073741824 are read before the sign
        raise OverflowError("long int not supported in this build")
    return code


def _at_line(line: int, error: SyntaxError) -> SyntaxError:
    error.filename = STRING
    error.lineno = line
    return error


def _recursive_names(tree: ast.AST) -> set[str]:
    """Names of functions that may call themselves, directly or through others; those of methods
    begin with a point."""
    methods = {
        part for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for part in node.body
    }
    functions = [node for node in ast.walk(tree) if isinstance(node, _Function)]
    names = [
        f".{function.name}" if function in methods else function.name for function in functions
    ]
    calls: dict[str, set[str]] = {name: set() for name in names}
    for name, function in zip(names, functions, strict=True):
        called = {called_name(node) for node in ast.walk(function) if isinstance(node, ast.Call)}
        calls[name] |= called & calls.keys()
    for through, beyond in calls.items():  # Warshall's algorithm
        for reached in calls.values():
            if through in reached:
                reached |= beyond
    return {name for name, reached in calls.items() if name in reached}


def _with_names_of_hub(
    code: CodeType, mangled: re.Pattern[str] | None, words: frozenset[str]
) -> CodeType:
    """Name comprehensions, which `transform` makes generators, as a hub does, and undo name
    mangling, which it does not have, of names that are not among the ``words`` of the source."""
    constants = tuple(
        _with_names_of_hub(c, mangled, words) if isinstance(c, CodeType) else c
        for c in code.co_consts
    )
    names_of_hub = (f"<{name[1:]}>" for name in COMPREHENSIONS if name in code.co_names)
    code = code.replace(co_consts=constants, co_name=next(names_of_hub, code.co_name))
    if mangled is None:
        return code

    def demangled(names: tuple[str, ...]) -> tuple[str, ...]:
        matches = [None if name in words else mangled.fullmatch(name) for name in names]
        return tuple(
            match[1] if match else name for name, match in zip(names, matches, strict=True)
        )

    names: dict[str, Any] = {kind: demangled(getattr(code, kind)) for kind in _KINDS_OF_NAMES}
    return code.replace(**names)


def _compile_for_hub(source: str, filename: str) -> bytes:
    """The program as ``.mpy``. Raises SyntaxError."""
    mpy, report = cross_compile(source, filename)
    if mpy is not None:
        return mpy
    kind, _, message = report.splitlines()[-1].partition(": ")
    error = (IndentationError if kind == "IndentationError" else SyntaxError)(message or kind)
    if location := re.search(r'File ".*", line (\d+)(?:, in (\S+))?', report):
        error.filename = filename
        error.lineno = int(location[1])
        error.text = location[2]
    raise error


def _constants(mpy: bytes) -> Iterator[tuple[int, bytes]]:
    """Kinds and text of the constants of a compiled program.

    Format: version 6 of ``.mpy``, ``py/persistentcode.c``. Numbers are decimal; small integers
    outside of tuples are in the code.
    """
    position = _HEADER_BYTES

    def number() -> int:
        nonlocal position
        value = 0
        more = True
        while more:
            value = value << 7 | mpy[position] & 0x7F
            more = bool(mpy[position] & 0x80)
            position += 1
        return value

    names = number()
    constants = number()
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
