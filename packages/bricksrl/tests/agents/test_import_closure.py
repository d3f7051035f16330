"""What must be read to understand an algorithm: the modules of agents that it imports, directly or
not."""

from __future__ import annotations

import ast
from pathlib import Path

import bricksrl

SOURCE = Path(bricksrl.__file__).parent.parent


def closure(name: str, seen: dict[str, int]) -> dict[str, int]:
    """Lines of each module of agents that a module imports, in functions and for types too;
    packages are not modules."""
    path = SOURCE.joinpath(*name.split(".")).with_suffix(".py")
    if name.startswith("bricksrl.agents.") and name not in seen and path.is_file():
        text = path.read_text()
        seen[name] = len(text.splitlines())
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom):
                for imported in (
                    node.module or "",
                    *(f"{node.module}.{alias.name}" for alias in node.names),
                ):
                    closure(imported, seen)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    closure(alias.name, seen)
    return seen


def test_sac_is_read_in_few_files() -> None:
    read = closure("bricksrl.agents.sac", {})
    assert "bricksrl.agents.replay.buffer" in read
    assert len(read) <= 16
    assert sum(read.values()) <= 2800, read
