"""``async for`` and ``async with`` expanded as by the hub's compiler, in a coroutine that is a generator."""

from __future__ import annotations

import ast

# The hub's compiler keeps the iterator of `async for x in name` in the variable `name` itself.
_FOR = """
ITER = VALUE.__aiter__()
MORE = True
while MORE:
    try:
        TARGET = yield from ITER.__anext__()
    except StopAsyncIteration:
        MORE = False
    else:
        BODY
else:
    ELSE
"""
# A hub has no __class__, so any exception in an `async with` ends as AttributeError.
_WITH = """
CONTEXT = VALUE
TARGET = yield from CONTEXT.__aenter__()
LEFT = False
try:
    try:
        BODY
    except ANY as ERROR:
        LEFT = True
        if not (yield from CONTEXT.__aexit__(ATTRIBUTE(ERROR, "__class__"), ERROR, None)):
            raise
finally:
    if not LEFT:
        yield from CONTEXT.__aexit__(None, None, None)
"""
_HELPERS = {"ANY": "@any", "ATTRIBUTE": "@attr"}


def async_for(node: ast.AsyncFor) -> list[ast.stmt]:
    """Statements of an ``async for`` with transformed parts."""
    parts = {"VALUE": node.iter, "TARGET": node.target}
    kept = {"ITER": node.iter.id} if isinstance(node.iter, ast.Name) else {}
    return _fill(_FOR, node, parts, {"BODY": node.body, "ELSE": node.orelse}, kept)


def async_with(node: ast.AsyncWith) -> list[ast.stmt]:
    """Statements of an ``async with`` with transformed parts."""
    body = node.body
    for item in reversed(node.items):
        target = item.optional_vars or ast.Name("@unused", ast.Store())
        body = _fill(_WITH, item.context_expr, {"VALUE": item.context_expr, "TARGET": target}, {"BODY": body})
    return body


def _fill(
    template: str,
    at: ast.expr | ast.stmt,
    parts: dict[str, ast.expr],
    blocks: dict[str, list[ast.stmt]],
    names: dict[str, str] | None = None,
) -> list[ast.stmt]:
    tree = ast.parse(template)
    for node in ast.walk(tree):
        for attribute in ("lineno", "col_offset", "end_lineno", "end_col_offset"):
            if hasattr(node, attribute):
                delattr(node, attribute)
    _Filler(parts, blocks, {**_HELPERS, **(names or {})}, f"{at.lineno}.{at.col_offset}").visit(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.expr | ast.stmt | ast.excepthandler) and not hasattr(node, "lineno"):
            ast.copy_location(node, at)
    return tree.body


class _Filler(ast.NodeTransformer):
    """Fills a template; other capital names become names that programs cannot write."""

    def __init__(
        self, parts: dict[str, ast.expr], blocks: dict[str, list[ast.stmt]], names: dict[str, str], location: str
    ) -> None:
        self._parts = parts
        self._blocks = blocks
        self._names = names
        self._location = location

    def _name(self, name: str) -> str:
        return self._names.get(name) or (f"@{name}{self._location}" if name.isupper() else name)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._parts[node.id] if node.id in self._parts else ast.Name(self._name(node.id), node.ctx)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        self.generic_visit(node)
        node.name = self._name(node.name) if node.name else None
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.stmt | list[ast.stmt]:
        if isinstance(node.value, ast.Name) and node.value.id in self._blocks:
            return self._blocks[node.value.id] or [ast.Pass()]
        self.generic_visit(node)
        return node
