"""Calls in a program's syntax tree."""

from __future__ import annotations

import ast


def called_name(node: ast.Call) -> str:
    """Name of the called function; that of a method begins with a point."""
    function = node.func
    return function.id if isinstance(function, ast.Name) else f".{function.attr}" if isinstance(function, ast.Attribute) else ""


def call(name: str, *args: ast.expr, at: ast.AST) -> ast.Call:
    """A call of a helper, whose name programs cannot write, at the place of another node."""
    return ast.copy_location(ast.Call(ast.Name(name, ast.Load()), list(args), []), at)


def constant_argument(node: ast.expr) -> ast.expr:
    """The argument of ``const(5)``, a directive to the hub's compiler; other nodes unchanged."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "const" and node.args:
        return node.args[0]
    return node
