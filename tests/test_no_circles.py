"""Circles of modules: imports in functions and names of processes count, imports for types and
packages' ``__init__`` do not."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
FOLDERS = [folder for pattern in ("src", "packages/*/src") for folder in TOP.glob(pattern)]
MODULES = {
    ".".join(path.relative_to(folder).with_suffix("").parts): path
    for folder in FOLDERS
    for path in folder.rglob("*.py")
    if path.name != "__init__.py"
}


def named(node: ast.AST) -> Iterator[str]:
    """Everything below a node that may be the name of a module: imports, and strings, as processes
    are started by them."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        assert not node.level, "a relative import would not be seen"
        yield from (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names))
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for_types = (
        node.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" else []
    )
    for child in ast.iter_child_nodes(node):
        if child not in for_types:
            yield from named(child)


def circles(sources: dict[str, str]) -> set[frozenset[str]]:
    """Sets of modules that reach each other, from texts by names of modules."""
    nexts = {
        name: (set(named(ast.parse(text))) & sources.keys()) - {name}
        for name, text in sources.items()
    }
    reached: dict[str, set[str]] = {}
    for name in sources:
        found, new = set[str](), nexts[name]
        while new:
            found |= new
            new = set[str]().union(*(nexts[other] for other in new)) - found
        reached[name] = found
    return {
        frozenset(n for n in reached[name] if name in reached[n])
        for name in sources
        if name in reached[name]
    }


@pytest.mark.parametrize(
    ("text", "is_circle"),
    [
        ("def f():\n    from p.a import g", True),
        ("from p import a", True),
        ("import p.a as other", True),
        ("start('p.a')", True),
        ("if TYPE_CHECKING:\n    from p.a import A", False),
        ("if not TYPE_CHECKING:\n    from p.a import A", True),
        ("if TYPE_CHECKING:\n    A = int\nelse:\n    from p.a import A", True),
        ("from p import d", False),
        ("'''As p.a does.'''\nimport p", False),
    ],
)
def test_circle_is_found(text: str, is_circle: bool) -> None:
    sources = {"p.a": "import p.c", "p.b": text, "p.c": "import p.b"}
    assert circles(sources) == ({frozenset(sources)} if is_circle else set())


def test_no_module_reaches_itself() -> None:
    assert len(MODULES) > 250
    assert (
        circles({name: path.read_text(encoding="utf-8") for name, path in MODULES.items()}) == set()
    )
