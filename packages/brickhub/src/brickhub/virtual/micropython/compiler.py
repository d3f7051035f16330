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
"""Numbers such as 012, outside of texts and comments."""
_HEADER_BYTES = 4
"""Bytes before the first number of an ``.mpy`` file: letter, version, flags, bits of an integer."""
# An `.mpy` file has these kinds of constants (`MP_PERSISTENT_OBJ_...` in `py/persistentcode.h`).
_TEXT = (5, 6)
_INTEGER = 7
_FLOAT = 8
_TUPLE = 10
_WITHOUT_DATA = 4
"""The last of the kinds that are a value by themselves, such as ``None``."""
_KINDS_OF_NAMES = ("co_names", "co_varnames", "co_cellvars", "co_freevars")
_MAX_DIGITS = 20
"""Number of digits that is more than any integer of 31 bits has, and few enough to be read at
once."""


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
        # Decorators and defaults are computed in the scope around the function.
        for part in (*node.decorator_list, node.args):
            self.visit(part)
        declared = _declared(node)
        scope = _Scope(keeps=False, declared=declared)
        is_inner = any(not around.keeps for around in self._scopes)
        if not is_inner:
            scope.variables = _arguments(node)
            scope.variables.update(_assigned(node.body))
            scope.variables -= declared
        self._scopes.append(scope)
        node.body = [self.visit(statement) for statement in node.body]
        self._scopes.pop()
        # `if False: name = None` keeps each lost name a variable of the function.
        for name in sorted(scope.lost):
            target = ast.Name(name, ast.Store())
            assign = ast.Assign([target], ast.Constant(None))
            never = ast.If(ast.Constant(False), [assign], [])
            first = node.body[0]
            node.body.insert(0, ast.copy_location(never, first))
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
        # The first iterable is computed in the scope around the comprehension, so it is taken out
        # meanwhile.
        iterable = self.visit(first.iter)
        first.iter = ast.Constant(None)
        reads = _loaded(node) - _targets(node)
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
        # At the top level there is only one scope, which then stands for the one around it.
        around = self._scopes[-2:][0]
        # Only a comprehension has `reads`, and only a function loses assignments.
        if reads is None or around.keeps or name in around.declared:
            return node
        # Where the comprehension reads all variables of the function, both numbers are the same and
        # the value is kept.
        if around.variables is not None and name in reads and reads >= around.variables:
            return node
        around.lost.add(name)
        return node.value


def _declared(function: ast.AST) -> set[str]:
    """Names that a function, or one in it, declares global or nonlocal."""
    names: set[str] = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Global | ast.Nonlocal):
            names.update(node.names)
    return names


def _arguments(function: _Function) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(function.args):
        if isinstance(node, ast.arg):
            names.add(node.arg)
    return names


def _loaded(comprehension: _Comprehension) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(comprehension):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            names.add(node.id)
    return names


def _targets(node: _Comprehension) -> set[str]:
    """Names that the loops of a comprehension assign."""
    names: set[str] = set()
    for generator in node.generators:
        for part in ast.walk(generator.target):
            if isinstance(part, ast.Name):
                names.add(part.id)
    return names


def _assigned(nodes: Collection[ast.AST]) -> Iterator[str]:
    """Names that statements and expressions assign in their own scope."""
    for node in nodes:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.alias):
            yield node.asname or node.name.partition(".")[0]
        elif isinstance(node, ast.ExceptHandler | _Function | ast.ClassDef) and node.name:
            yield node.name
        # Only `:=` leaves a comprehension for the scope around it. Functions and classes have
        # scopes of their own.
        if isinstance(node, _Comprehension):
            for part in ast.walk(node):
                if isinstance(part, ast.NamedExpr):
                    yield part.target.id
        elif not isinstance(node, _Function | ast.ClassDef | ast.Lambda):
            yield from _assigned(list(ast.iter_child_nodes(node)))


@functools.lru_cache(maxsize=64)
def compile_source(
    source: str,
    filename: str,
    mode: str = "exec",
) -> CodeType:
    """Code of a program, or of an expression (``mode="eval"``). Raises SyntaxError if the hub's
    compiler refuses it, OverflowError if a constant needs more than 31 bits."""
    # The hub's own compiler goes first, so that what it refuses is refused in its words, and
    # CPython's compiler sees only programs that are right.
    mpy = _compile_for_hub(source, filename)
    floats: list[str] = []
    for kind, value in _constants(mpy):
        # A hub reads the digits before the sign, so the range is the same on both sides of 0.
        if kind == _INTEGER and (len(value) > _MAX_DIGITS or abs(int(value)) > SMALL_MAX):
            raise OverflowError("long int not supported in this build")
        # The hub compiles for `eval` and `exec` itself, and keeps no text of constants there.
        if kind == _FLOAT and filename != STRING:
            floats.append(value.decode())
    with deep_recursion(), warnings.catch_warnings():
        # CPython's advice on style does not apply to a program for a hub.
        warnings.simplefilter("ignore", SyntaxWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        tree = parse(source, filename, mode)
        has_walrus = any(isinstance(node, ast.NamedExpr) for node in ast.walk(tree))
        if has_walrus:
            _Loser().visit(tree)
        recursive = _recursive_names(tree)
        transformed = transform(tree, recursive, floats)
        code = compile(
            transformed,
            filename,
            mode,
            dont_inherit=True,
        )
    mangled = _mangled(tree, source)
    words = frozenset(re.findall(r"\w+", source))
    return _with_names_of_hub(code, mangled, words)


def _mangled(tree: ast.AST, source: str) -> re.Pattern[str] | None:
    """Pattern of the names that CPython makes of those such as ``__speed`` in the classes of a
    program; ``None`` if it has none."""
    # CPython drops the underscores at the beginning of a class's name.
    classes: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            classes.add(node.name.lstrip("_"))
    # A class name of underscores alone mangles nothing.
    classes.discard("")
    if not classes or "__" not in source:
        return None
    any_class = "|".join(sorted(classes))
    return re.compile(f"_(?:{any_class})(__\\w+)")


def compile_string(source: str, mode: str = "exec") -> CodeType:
    """Code of what ``exec`` or ``eval`` (``mode="eval"``) get, from the compiler on the hub itself,
    which is stricter than mpy-cross. Raises as `compile_source`."""
    # mpy-cross accepts leading zeros, but the compiler in the firmware does not.
    for match in _LEADING_ZERO.finditer(source):
        if match["number"]:
            number = match["number"].replace("_", "")
            message = f"invalid syntax for integer with base 0: '{number}'"
            raise _at_line(1, SyntaxError(message))
    is_expression = mode == "eval"
    program = source.strip() if is_expression else source
    # An expression has to begin with its text, but may be followed by anything blank.
    first = source[:1]
    if is_expression and first in (" ", "\t"):
        raise _at_line(1, IndentationError("unexpected indent"))
    if is_expression and first in ("\n", "\r"):
        raise _at_line(1, SyntaxError("invalid syntax"))
    try:
        code = compile_source(program, STRING, mode)
    except SyntaxError as error:
        last_line = source.count("\n") + 1
        error.lineno = min(error.lineno or 1, last_line)
        # CPython's error has more than the message, which is all that a hub's has.
        if len(error.args) > 1:
            error.args = ("invalid syntax",) if is_expression else error.args[:1]
            error.msg = error.args[0]
        raise
    nodes = list(ast.walk(parse(source, STRING, mode)))
    # mpy-cross knows f-strings, but the compiler in the firmware does not.
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            raise _at_line(node.lineno, SyntaxError("invalid syntax"))
    for node in nodes:
        value = node.value if isinstance(node, ast.Constant) else None
        # The digits of -1073741824 are read before the sign, and are too large by themselves.
        if type(value) is int and value > SMALL_MAX:
            raise OverflowError("long int not supported in this build")
    return code


def _at_line(line: int, error: SyntaxError) -> SyntaxError:
    error.filename = STRING
    error.lineno = line
    return error


def _recursive_names(tree: ast.AST) -> set[str]:
    """Names of functions that may call themselves, directly or through others; those of methods
    begin with a point."""
    methods: set[ast.stmt] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            methods.update(node.body)
    # Functions are told apart by name alone, so two of one name call what either calls.
    calls: dict[str, set[str]] = {}
    for node in ast.walk(tree):
        if isinstance(node, _Function):
            name = f".{node.name}" if node in methods else node.name
            called = calls.setdefault(name, set())
            called.update(_called_names(node))
    # Only calls of what the program defines matter.
    for called in calls.values():
        called &= calls.keys()
    # This is Warshall's algorithm: whoever reaches a function also reaches what that one reaches.
    for middle, beyond in calls.items():
        for reached in calls.values():
            if middle in reached:
                reached |= beyond
    return {name for name, reached in calls.items() if name in reached}


def _called_names(function: ast.AST) -> Iterator[str]:
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            yield called_name(node)


def _with_names_of_hub(
    code: CodeType,
    mangled: re.Pattern[str] | None,
    words: frozenset[str],
) -> CodeType:
    """Name comprehensions, which `transform` makes generators, as a hub does, and undo name
    mangling, which it does not have, of names that are not among the ``words`` of the source."""
    constants = tuple(
        _with_names_of_hub(constant, mangled, words) if isinstance(constant, CodeType) else constant
        for constant in code.co_consts
    )
    code_name = code.co_name
    for helper in COMPREHENSIONS:
        if helper in code.co_names:
            code_name = f"<{helper[1:]}>"
            break
    code = code.replace(co_consts=constants, co_name=code_name)
    if mangled is None:
        return code

    def demangled(name: str) -> str:
        # A program may write `_Robot__speed` itself, and such a name stays.
        match = None if name in words else mangled.fullmatch(name)
        return match[1] if match else name

    names: dict[str, Any] = {}
    for kind in _KINDS_OF_NAMES:
        names[kind] = tuple(demangled(name) for name in getattr(code, kind))
    return code.replace(**names)


def _compile_for_hub(source: str, filename: str) -> bytes:
    """The program as ``.mpy``. Raises SyntaxError."""
    mpy, report = cross_compile(source, filename)
    if mpy is not None:
        return mpy
    # The report is a traceback as on a hub: the place, then the class of the error and its message.
    kind, _, message = report.splitlines()[-1].partition(": ")
    error_class = IndentationError if kind == "IndentationError" else SyntaxError
    error = error_class(message or kind)
    location = re.search(r'File ".*", line (\d+)(?:, in (\S+))?', report)
    if location is not None:
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
        """Seven bits a byte, the highest first; the eighth says that another byte follows."""
        nonlocal position
        value = 0
        more = True
        while more:
            byte = mpy[position]
            value = value << 7 | byte & 0x7F
            more = bool(byte & 0x80)
            position += 1
        return value

    names = number()
    constants = number()
    for _ in range(names):
        length = number()
        # An odd number is one of the firmware's own names, which no text follows.
        is_in_firmware = length & 1
        if not is_in_firmware:
            zero_byte = 1
            position += (length >> 1) + zero_byte
    while constants:
        constants -= 1
        kind = mpy[position]
        position += 1
        # The items of a tuple follow as constants of their own.
        if kind == _TUPLE:
            constants += number()
        elif kind > _WITHOUT_DATA:
            length = number()
            yield kind, mpy[position : position + length]
            # A text ends with a zero byte, which its length does not count.
            position += length + (kind in _TEXT)
