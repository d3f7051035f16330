"""Code that a module depends on: the syntax trees, without docstrings, of all of our modules that
it imports, at first or later.

Two trees with one digest compute the same, whatever their comments, words and formatting are.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Callable, Iterator

OURS = ("benchmarks", "brickhub", "bricktwin", "bricksrl")
HARNESS = tuple(
    f"benchmarks.{name}"
    for name in ("session", "registry", "machine", "provenance", "code", "formatting", "tables")
)
"""Modules that start benchmarks, and keep and show results, but change none."""
_NAMED = re.compile(r"(?:brickhub|bricktwin|bricksrl)(?:\.\w+)+")
Source = Callable[[str], str | None]
"""Text of a file of the repository by its path; ``None`` if there is no such file."""


class Code:
    """The code at one commit, or in the working tree.

    Args:
        source: gives the files.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._modules: dict[str, tuple[str, frozenset[str]] | None] = {}

    def digest(self, module: str) -> str:
        """Digest of a module with everything of ours that it imports."""
        parts = [f"{name} {self._read(name)[0]}" for name in sorted(self.closure(module))]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]

    def closure(self, module: str) -> set[str]:
        """Names of a module and of all of ours that it imports."""
        found: set[str] = set()
        waiting = [module]
        while waiting:
            name = waiting.pop()
            if name in found or name in HARNESS or not self._exists(name):
                continue
            found.add(name)
            waiting += self._read(name)[1]
        return found

    def _exists(self, module: str) -> bool:
        return bool(self._read(module)[0])

    def _read(self, module: str) -> tuple[str, frozenset[str]]:
        """Digest of a module, "" if there is none, and the names that it imports."""
        if module not in self._modules:
            self._modules[module] = self._parse(module)
        return self._modules[module] or ("", frozenset())

    def _parse(self, module: str) -> tuple[str, frozenset[str]] | None:
        for path, is_package in _paths(module):
            text = self._source(path)
            if text is not None:
                tree = ast.parse(text)
                package = module if is_package else module.rpartition(".")[0]
                imported = frozenset(_imports(tree, package, with_texts=is_package))
                without_docstrings(tree)
                return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imported
        return None


def without_docstrings(tree: ast.AST) -> None:
    """Remove all texts that are statements."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        kept = [statement for statement in body if not _is_text(statement)]
        # A body that was a docstring alone must not be empty.
        node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]


def _is_text(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


def _paths(module: str) -> Iterator[tuple[str, bool]]:
    """Paths at which a module may be, and whether it is a package there."""
    house = module.partition(".")[0]
    place = module.replace(".", "/")
    root = "" if house == "benchmarks" else f"packages/{house}/src/"
    yield f"{root}{place}.py", False
    yield f"{root}{place}/__init__.py", True
    # Before the three houses there was one.
    yield f"src/{place}.py", False
    yield f"src/{place}/__init__.py", True


def _imports(
    tree: ast.AST,
    package: str,
    *,
    with_texts: bool,
) -> Iterator[str]:
    """Names of our modules that a tree imports; what may be a module or something in it counts as
    both. ``with_texts``: those in texts too, as a package's that loads its parts when they are
    used."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _is_ours(alias.name))
        elif isinstance(node, ast.ImportFrom):
            parent = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                parent = ".".join([*above, *filter(None, [parent])])
            if _is_ours(parent):
                yield parent
                yield from (f"{parent}.{alias.name}" for alias in node.names)
        elif with_texts and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _NAMED.findall(node.value)


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] in OURS
