"""Syntax of hub programs: the hub's compiler accepts some that CPython refuses."""

import ast
import contextlib
import io
import itertools
import re
import sys
import tokenize
from collections.abc import Iterator
from typing import Any

TEXT = (
    r'"""(?:\\.|[^\\])*?"""|'
    r"'''(?:\\.|[^\\])*?'''|"
    r'"(?:\\.|[^"\\\n])*"|'
    r"'(?:\\.|[^'\\\n])*'|#[^\n]*"
)
"""Pattern of a string or a comment."""
_FORMATTED = (
    r"(?<!\w)(?P<f>[fF])(?P<quote>[\"'])"
    r"(?P<body>(?:\\.|\{\{|\{(?!\{)[^{}\n]*(?:\{[^{}\n]*\}[^{}\n]*)*\}|(?!(?P=quote))[^\\{\n])*)(?P=quote)(?!(?P=quote))"
)
_HUB_ONLY = re.compile(
    rf"{_FORMATTED}|(?P<text>{TEXT})|^(?P<imports>[ \t]*from[ \t][^\n#\"'(;]*),(?=[ \t\r]*(?:#|$))|"
    r"^(?P<indent>[ \t]+)|(?<![\w.])0+(?=[1-9])",
    re.MULTILINE | re.DOTALL,
)
_TAB = 8
_RECURSION = 20_000


@contextlib.contextmanager
def deep_recursion() -> Iterator[None]:
    """Context for programs with a thousand of ``elif`` or ``+`` in a row, which a hub takes."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, _RECURSION))
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


def parse(source: str, filename: str = "<unknown>", mode: str = "exec") -> Any:
    """Syntax tree of a program, or of an expression (``mode="eval"``); its line numbers are those
    of the source.

    Accepts what the hub's compiler does: tabs among spaces, ``from a import b,``, numbers such as
    ``007``, a generator expression among other arguments, and (CPython: from 3.12) the quotes of an
    f-string inside its braces.

    Raises:
        SyntaxError: CPython cannot read it.
        ValueError: it contains null bytes.
    """
    with deep_recursion():
        try:
            return ast.parse(source, filename, mode)
        except SyntaxError as error:
            try:
                return ast.parse(
                    _with_parentheses(_HUB_ONLY.sub(_as_cpython, source)), filename, mode
                )
            except (SyntaxError, tokenize.TokenError):
                raise error from None


def _as_cpython(match: re.Match[str]) -> str:
    """Matched syntax as CPython accepts it."""
    if match["f"]:
        return match["f"] + 3 * match["quote"] + match["body"] + 3 * match["quote"]
    return match["text"] or (match["imports"] or match["indent"] or "").expandtabs(_TAB)


def _with_parentheses(source: str) -> str:
    """The program with parentheses around each generator expression that is one of several
    arguments."""
    starts = [0, *itertools.accumulate(map(len, io.StringIO(source)))]
    insertions: list[tuple[int, str]] = []
    brackets: list[list[list[tokenize.TokenInfo]]] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        arguments = (
            brackets.pop()
            if token.string in ")]}" and brackets and token.type == tokenize.OP
            else []
        )
        if brackets and token.type == tokenize.OP and token.string == ",":
            brackets[-1].append([])
        elif brackets:
            brackets[-1][-1].append(token)
        if token.type == tokenize.OP and token.string in "([{":
            brackets.append([[]])
        for argument in arguments if token.string == ")" and len(arguments) > 1 else []:
            if any(part.string == "for" for part in argument):
                (first_line, first) = argument[0].start
                (last_line, last) = argument[-1].end
                insertions += (
                    (starts[first_line - 1] + first, "("),
                    (starts[last_line - 1] + last, ")"),
                )
    for offset, bracket in sorted(insertions, reverse=True):
        source = source[:offset] + bracket + source[offset:]
    return source
