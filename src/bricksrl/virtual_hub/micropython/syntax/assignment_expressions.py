"""Assignments ``name := value`` in comprehensions, which a hub loses within functions.

The hub's compiler stores the value under the number of the function's variable, but among the variables of the comprehension,
which is a function of its own: the function's variable stays as it was (unless the number is by chance that of the same variable
there: a function with no other variables). At the top level, and for names that the function
declares global or nonlocal, the value is kept.
"""

from __future__ import annotations

import ast
from collections.abc import Collection
from dataclasses import dataclass, field

Function = ast.FunctionDef | ast.AsyncFunctionDef
Comprehension = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


@dataclass
class _Scope:
    """Scope of names.

    Attributes:
        keeps: whether a comprehension's assignments reach it.
        is_comprehension: not a module, class or function.
        declared: names that are global or nonlocal in it.
        lost: names whose assignments it loses.
    """

    keeps: bool
    is_comprehension: bool = False
    declared: Collection[str] = ()
    lost: set[str] = field(default_factory=set)


def lose_assignments(tree: ast.AST) -> None:
    """Leave of each lost assignment in a program its value; the name remains a variable of the function."""
    if any(isinstance(node, ast.NamedExpr) for node in ast.walk(tree)):
        _Loser().visit(tree)


class _Loser(ast.NodeTransformer):
    def __init__(self) -> None:
        self._scopes = [_Scope(keeps=True)]

    def visit_FunctionDef(self, node: Function) -> ast.AST:
        outside = [*node.decorator_list, node.args]
        for part in outside:
            self.visit(part)
        declarations = (part for part in ast.walk(node) if isinstance(part, ast.Global | ast.Nonlocal))
        self._scopes.append(_Scope(keeps=False, declared={name for part in declarations for name in part.names}))
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
        self._scopes.append(_Scope(keeps=False, is_comprehension=True))
        self.generic_visit(node)
        self._scopes.pop()
        first.iter = iterable
        return node

    visit_SetComp = visit_DictComp = visit_GeneratorExp = visit_ListComp

    def visit_NamedExpr(self, node: ast.NamedExpr) -> ast.AST:
        self.generic_visit(node)
        if not self._scopes[-1].is_comprehension:
            return node
        around = self._scopes[-2]
        if around.keeps or node.target.id in around.declared:
            return node
        around.lost.add(node.target.id)
        return node.value
