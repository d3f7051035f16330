"""Syntax that the hub's compiler accepts and CPython refuses."""

from __future__ import annotations

import ast

import mpy_cross_v6
import pytest

from brickhub.hub.program.syntax import parse


@pytest.mark.parametrize(
    ("source", "same_as"),
    [
        ("from a import b, c,\nx = 1\n", "from a import b, c\nx = 1\n"),
        ("from a import b,  # and no more\n", "from a import b\n"),
        ("if a:\n\tb = 1\n        c = 2\n", "if a:\n    b = 1\n    c = 2\n"),
        ("wait(0500)\nx = 007 + 0.05 + 10\n", "wait(500)\nx = 7 + 0.05 + 10\n"),
        ("x = max(abs(a) for a in b, default=0)\n", "x = max((abs(a) for a in b), default=0)\n"),
        ("f(1, (2, [3]), a for a in\n  b)\n", "f(1, (2, [3]), (a for a in\n  b))\n"),
        (
            "s = '\x1c'\nx = max(abs(a) for a in b, default=0)\n",
            "s = '\x1c'\nx = max((abs(a) for a in b), default=0)\n",
        ),
        (
            """s = f"{a["b"]} {{c}} {d}" + f'{e['f']:>{g['h']}}' + f"{i}" + 'f"j"'\n""",
            """s = f"{a['b']} {{c}} {d}" + f'{e["f"]:>{g["h"]}}' + f"{i}" + 'f"j"'\n""",
        ),
        (
            'from a import b,\nx = """\n\tfrom here to there,\n007"""\ny = "007"  # 007\n',
            'from a import b\nx = """\n\tfrom here to there,\n007"""\ny = "007"\n',
        ),
    ],
)
def test_accepts_what_the_compiler_of_the_hub_does(source: str, same_as: str) -> None:
    assert mpy_cross_v6.mpy_cross_compile("main.py", source)[1] is not None
    assert ast.dump(parse(source)) == ast.dump(ast.parse(same_as))


def test_lines_stay() -> None:
    tree = parse("from a import b,\n\nx = 1\nif x:\n\ty = 1\n        z = 2\n")
    assert [node.lineno for node in tree.body] == [1, 3, 4]
    assert tree.body[2].body[1].lineno == 6


@pytest.mark.parametrize("source", ["x = (\n", "class A\n", "from a import b,,\n", "'", "f(]\n"])
def test_other_errors_are_those_of_cpython(source: str) -> None:
    with pytest.raises(SyntaxError) as expected:
        ast.parse(source)
    with pytest.raises(SyntaxError) as caught:
        parse(source)
    assert caught.value.args == expected.value.args
