"""Constants that the hub's compiler computes."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable

_FOLDED: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod, ast.Pow: operator.pow, ast.LShift: operator.lshift, ast.RShift: operator.rshift,
    ast.BitOr: operator.or_, ast.BitAnd: operator.and_, ast.BitXor: operator.xor,
}  # fmt: skip
_SIGNS: dict[type[ast.unaryop], Callable[[int], int]] = {
    ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Invert: operator.invert,
}  # fmt: skip
_MAX_BITS = 4096
"""Limit of a folded power or shift: larger ones take time, and no result of that size fits."""


def fold(node: ast.expr) -> int | None:
    """Constant folded by the hub's compiler, or ``None``; it runs on a PC, so only the result has to fit 31 bits."""
    if isinstance(node, ast.Constant):
        return node.value if type(node.value) is int else None
    if isinstance(node, ast.UnaryOp) and type(node.op) in _SIGNS:
        value = fold(node.operand)
        return None if value is None else int(_SIGNS[type(node.op)](value))
    if not isinstance(node, ast.BinOp) or type(node.op) not in _FOLDED:
        return None
    kind, left, right = type(node.op), fold(node.left), fold(node.right)
    if left is None or right is None:
        return None
    if (kind in (ast.FloorDiv, ast.Mod) and right == 0) or (kind in (ast.Pow, ast.LShift, ast.RShift) and right < 0):
        return None
    if (kind is ast.Pow and left.bit_length() * right > _MAX_BITS) or (kind is ast.LShift and right > _MAX_BITS):
        return None
    return int(_FOLDED[kind](left, right))
