"""Assignments ``name := value`` in comprehensions, which a hub mostly loses within functions.

The hub's compiler stores the value under the number of the function's variable, but among the variables of the comprehension,
which is a function of its own: the function's variable stays as it was. It changes where both numbers are the same: the
comprehension reads the name, and all other variables of the function. At the top level, and for names that the function declares
global or nonlocal, the value is always kept.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

Function = ast.FunctionDef | ast.AsyncFunctionDef
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


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


def lose_assignments(tree: ast.AST) -> None:
    """Leave of each lost assignment in a program its value; the name remains a variable of the function."""
    if any(isinstance(node, ast.NamedExpr) for node in ast.walk(tree)):
        _Loser().visit(tree)


class _Loser(ast.NodeTransformer):
    def __init__(self) -> None:
        self._scopes = [_Scope(keeps=True)]

    def visit_FunctionDef(self, node: Function) -> ast.AST:
        for part in (*node.decorator_list, node.args):
            self.visit(part)
        declarations = (part for part in ast.walk(node) if isinstance(part, ast.Global | ast.Nonlocal))
        declared = {name for part in declarations for name in part.names}
        is_inner = any(not scope.keeps for scope in self._scopes)
        variables = None if is_inner else {*_arguments(node.args), *_assigned(node.body)} - declared
        self._scopes.append(_Scope(keeps=False, declared=declared, variables=variables))
        node.body = [self.visit(statement) for statement in node.body]
        for name in sorted(self._scopes.pop().lost):
            assign = ast.Assign([ast.Name(name, ast.Store())], ast.Constant(None))
            node.body.insert(0, ast.copy_location(ast.If(ast.Constant(False), [assign], []), node.body[0]))
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

    def visit_ListComp(self, node: Comprehension) -> ast.AST:
        first = node.generators[0]
        first.iter = self.visit(first.iter)
        iterable, first.iter = first.iter, ast.Constant(None)  # computed in the scope around
        names = [part for part in ast.walk(node) if isinstance(part, ast.Name)]
        own = {name.id for generator in node.generators for name in ast.walk(generator.target) if isinstance(name, ast.Name)}
        reads = {name.id for name in names if isinstance(name.ctx, ast.Load)} - own
        self._scopes.append(_Scope(keeps=False, reads=reads))
        self.generic_visit(node)
        self._scopes.pop()
        first.iter = iterable
        return node

    visit_SetComp = visit_DictComp = visit_GeneratorExp = visit_ListComp

    def visit_NamedExpr(self, node: ast.NamedExpr) -> ast.AST:
        self.generic_visit(node)
        name, reads, around = node.target.id, self._scopes[-1].reads, self._scopes[-2:][0]
        if reads is None or around.keeps or name in around.declared:
            return node
        if around.variables is not None and name in reads and reads >= around.variables:
            return node
        around.lost.add(name)
        return node.value


def _arguments(args: ast.arguments) -> Iterator[str]:
    for argument in (*args.posonlyargs, *args.args, *args.kwonlyargs, args.vararg, args.kwarg):
        if argument is not None:
            yield argument.arg


def _assigned(nodes: Collection[ast.AST]) -> Iterator[str]:
    """Names that statements and expressions assign in their own scope."""
    for node in nodes:
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.alias):
            yield node.asname or node.name.partition(".")[0]
        elif isinstance(node, ast.ExceptHandler | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and node.name:
            yield node.name
        if isinstance(node, _COMPREHENSIONS):
            yield from (part.target.id for part in ast.walk(node) if isinstance(part, ast.NamedExpr))
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
            yield from _assigned(list(ast.iter_child_nodes(node)))
