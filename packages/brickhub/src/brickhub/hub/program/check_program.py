"""Check of a user's own program before it goes to a hub: syntax, imports, names, size."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Iterator, Sequence

from brickhub.errors import ProgramError, hint
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.program.run_program import imported_modules
from brickhub.hub.program.syntax import parse
from brickhub.hub.transport import HubProgram
from brickhub.robot import HubKind

_U_PREFIXED = ("sys", "select", "struct", "math", "random", "json", "io", "errno")
_PYBRICKS = ("hubs", "parameters", "pupdevices", "robotics", "tools", "messaging", "iodevices", "geometry")
HUB_MODULES = frozenset(
    (*_U_PREFIXED, *(f"u{name}" for name in _U_PREFIXED), "gc", "micropython", "pybricks", *(f"pybricks.{m}" for m in _PYBRICKS))
)
"""Modules of the firmware of a hub with floating-point numbers."""


def check_program(program: HubProgram, hub: HubKind) -> tuple[int, list[str]]:
    """Check a program for a kind of hub.

    Returns:
        Its size on the hub in bytes, and a sentence about each name that is read before the line that sets it.

    Raises:
        ProgramError: the hub's compiler refuses it, it is too large, it imports a module that is neither on the hub nor beside
            it, or it reads a name that nothing sets.
    """
    size = len(program_blob(compile_program(program), hub))
    beside = {module.name for module in program.modules}
    early = []
    for file, source in ((program.name, program.source), *((module.file, module.source) for module in program.modules)):
        for name in imported_modules(source):
            if name not in HUB_MODULES | beside:
                known = hint(name, HUB_MODULES) or "; put it beside the program"
                raise ProgramError(f"{file} imports {name}, which is neither on the hub nor beside the program{known}")
        for line, name, bound_line in unbound_names(parse(source), set(dir(builtins)) - set(hub.model.missing)):
            if bound_line is None:
                raise ProgramError(f"{file}, line {line}: nothing sets '{name}'; define it, or correct the name")
            early.append(f"{file}, line {line}: '{name}' is read before line {bound_line} sets it")
    return size, early


_Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
_Scope = _Function | ast.ClassDef


def unbound_names(module: ast.Module, known: set[str]) -> Iterator[tuple[int, str, int | None]]:
    """Names of a program that are read and not set: line, name, and, of one that the program's top level sets only in a later
    line, that line; none where a program imports ``*``. ``known``: names of the language."""
    bound = _bound(module)
    if "*" in bound:
        return
    of_functions = {name for node in ast.walk(module) if isinstance(node, ast.Global) for name in node.names}
    for node in _own_nodes(module):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in known | of_functions:
            if node.id not in bound:
                yield node.lineno, node.id, None
            elif bound[node.id] > node.lineno:
                yield node.lineno, node.id, bound[node.id]
        elif isinstance(node, _Scope):
            yield from _unbound_in(node, known | of_functions | set(bound))


def _unbound_in(scope: _Scope, outer: set[str]) -> Iterator[tuple[int, str, None]]:
    names = outer | set(_bound(scope))
    for node in _own_nodes(scope):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in names:
            yield node.lineno, node.id, None
        elif isinstance(node, _Scope):
            yield from _unbound_in(node, names)


def _own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a scope, and those scopes in it, but not what is in these."""
    pending: list[ast.AST] = list(_body(scope))
    while pending:
        node = pending.pop()
        yield node
        pending += [*node.decorator_list] if isinstance(node, ast.ClassDef | ast.FunctionDef) else []
        pending += [] if isinstance(node, _Scope) else ast.iter_child_nodes(node)


def _body(scope: ast.AST) -> Sequence[ast.AST]:
    if isinstance(scope, ast.Lambda):
        return [scope.body]
    return scope.body if isinstance(scope, ast.Module | _Scope) else []


def _bound(scope: ast.AST) -> dict[str, int]:
    """First line in which a scope sets each of its names; 0 for arguments, and for variables of comprehensions."""
    lines: dict[str, int] = {}

    def bind(name: str, line: int) -> None:
        lines[name] = min(line, lines.get(name, line))

    for node in [*_own_nodes(scope), *([scope] if isinstance(scope, _Function) else [])]:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            bind(node.id, node.lineno)
        elif isinstance(node, ast.comprehension):
            for target in ast.walk(node.target):
                if isinstance(target, ast.Name):
                    bind(target.id, 0)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            for alias in node.names:
                bind((alias.asname or alias.name).partition(".")[0], node.lineno)
        elif isinstance(node, ast.ExceptHandler) and node.name:
            bind(node.name, node.lineno)
        elif node is scope and isinstance(scope, _Function):
            arguments = scope.args
            for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg):
                bind(argument.arg, 0) if argument is not None else None
        elif isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            bind(node.name, node.lineno)
    return lines
