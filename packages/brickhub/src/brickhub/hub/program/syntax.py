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
"""Pattern of a string or a comment: what is in one looks like code, and is left as it is."""
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
"""Columns of a tab in an indent, for MicroPython as for CPython."""
_RECURSION = 20_000
"""Depth of calls that CPython's compiler and visitors of its trees may need for such a program."""


@contextlib.contextmanager
def deep_recursion() -> Iterator[None]:
    """Context for programs with a thousand of ``elif`` or ``+`` in a row, which a hub takes."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, _RECURSION))
    try:
        yield
    finally:
        sys.setrecursionlimit(limit)


def parse(
    source: str,
    filename: str = "<unknown>",
    mode: str = "exec",
) -> Any:
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
        # The text is tried as it is first, because few programs need rewriting.
        try:
            return ast.parse(source, filename, mode)
        except SyntaxError as error:
            try:
                rewritten = _with_parentheses(_HUB_ONLY.sub(_as_cpython, source))
                return ast.parse(rewritten, filename, mode)
            except (SyntaxError, tokenize.TokenError):
                # The author knows the original text, so its error is the one to raise.
                raise error from None


def imported_names(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """Modules of all import statements, each with a name that is taken from it, or ""."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, ""
        # A relative import has no module name of its own.
        elif isinstance(node, ast.ImportFrom) and node.module is not None and not node.level:
            for alias in node.names:
                yield node.module, alias.name


def _as_cpython(match: re.Match[str]) -> str:
    """Matched syntax as CPython accepts it."""
    # Within three quotes CPython accepts a single quote in the braces, before 3.12 too.
    if match["f"]:
        quotes = 3 * match["quote"]
        return match["f"] + quotes + match["body"] + quotes
    if match["text"]:
        return match["text"]
    # What is kept is an import without its last comma, an indent of spaces only, or, of a number
    # without its first zeros, nothing.
    kept = match["imports"] or match["indent"] or ""
    return kept.expandtabs(_TAB)


def _with_parentheses(source: str) -> str:
    """The program with parentheses around each generator expression that is one of several
    arguments."""
    line_starts = [0, *itertools.accumulate(map(len, io.StringIO(source)))]
    insertions: list[tuple[int, str]] = []
    # Commas separate the parts of a bracket, whose tokens are kept for each open bracket. Those of
    # an inner bracket are not kept again for the outer one.
    brackets: list[list[list[tokenize.TokenInfo]]] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        is_operator = token.type == tokenize.OP
        arguments: list[list[tokenize.TokenInfo]] = []
        if is_operator and token.string in ")]}" and brackets:
            arguments = brackets.pop()
        if is_operator and token.string == "," and brackets:
            brackets[-1].append([])
        elif brackets:
            brackets[-1][-1].append(token)
        if is_operator and token.string in "([{":
            brackets.append([[]])
        # A single generator expression needs no parentheses in CPython either, and in square
        # brackets or braces `for` makes a comprehension.
        is_call_with_several = token.string == ")" and len(arguments) > 1
        if not is_call_with_several:
            continue
        for argument in arguments:
            if any(part.string == "for" for part in argument):
                first_line, first_column = argument[0].start
                last_line, last_column = argument[-1].end
                insertions.append((line_starts[first_line - 1] + first_column, "("))
                insertions.append((line_starts[last_line - 1] + last_column, ")"))
    # Parentheses are inserted from the end, so that the offsets before them stay right.
    for offset, bracket in sorted(insertions, reverse=True):
        source = source[:offset] + bracket + source[offset:]
    return source
