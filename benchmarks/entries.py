"""Which tests enter which function: a map that `benchmarks.mutants` chooses tests by.

The modules of a copy of the tree are compiled with a note at the begin of each function
(``tests/plugins/entered.py``), then its tests run once (``tests/plugins/entry_record.py``). What
processes of a test enter is noted too, if they inherit its environment. The texts of the modules
stay as they are; only their byte code differs.

What no process of Python executes, as programs on the virtual hub, is entered by no test.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import marshal
import os
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from brickhub.files import write_durably

NOTES = "tests/plugins/entered.py"
NOTE = "__entered__"
"""Name of the module that notes, in each module."""
Function = ast.FunctionDef | ast.AsyncFunctionDef
_NEVER_CHECKED = (1).to_bytes(4, "little")
"""Flags of byte code that is valid for any source."""


@dataclass
class Entries:
    """What each test enters.

    Attributes:
        functions: names ``FILE:FUNCTION`` by number.
        tests: of each file of tests, its digest, and of each test its seconds and its numbers.
    """

    functions: list[str] = field(default_factory=list)
    tests: dict[str, dict[str, Any]] = field(default_factory=dict)

    @cached_property
    def by_function(self) -> dict[str, dict[str, float]]:
        """Seconds of the tests that enter a function, by its name and theirs."""
        found: dict[str, dict[str, float]] = defaultdict(dict)
        for one in self.tests.values():
            for test, (seconds, numbers) in one["tests"].items():
                for number in numbers:
                    found[self.functions[number]][test] = seconds
        return dict(found)


def read(path: Path) -> Entries:
    """The map in a file; empty if there is none."""
    return Entries(**json.loads(path.read_bytes())) if path.exists() else Entries()


def complete(path: Path, tree: Path) -> Entries:
    """The map in a file, with what the tests enter whose files are not in it as they are now. It is
    written after each house, the small ones first. The tree is for this alone: its byte code is
    replaced."""
    known = read(path)
    digests = {
        str(test.relative_to(tree)): hashlib.sha256(test.read_bytes()).hexdigest()
        for test in sorted(tree.rglob("test_*.py"))
    }
    tests = {file: one for file, one in known.tests.items() if one["digest"] == digests.get(file)}
    missing: dict[str, list[str]] = defaultdict(list)
    for file in digests:
        if file not in tests:
            missing[file.partition("tests/")[0]].append(file)
    functions = compile_with_notes(tree, known.functions) if missing else known.functions
    for files in sorted(missing.values(), key=len):
        found = _record(tree, files)
        tests |= {file: {"digest": digests[file], "tests": found.get(file, {})} for file in files}
        write_durably(path, json.dumps({"functions": functions, "tests": tests}).encode())
    return Entries(functions, tests)


def compile_with_notes(tree: Path, functions: list[str]) -> list[str]:
    """Compile all modules of a tree. The names of its functions, of which the first may be
    given."""
    # where each process that finds our modules finds it
    shutil.copy(tree / NOTES, tree / "packages/brickhub/src")
    numbers = {name: number for number, name in enumerate(functions)}
    for path in sorted(tree.glob("packages/*/src/brick*/**/*.py")):
        # what is no module of a package is only copied, or sent to a hub
        if not (path.parent / "__init__.py").exists():
            continue
        text = path.read_bytes()
        module = ast.parse(text)
        for node, name in named_functions(module):
            number = numbers.setdefault(f"{path.relative_to(tree)}:{name}", len(numbers))
            _begin_with(node, f"{NOTE}.seen[{number}] or {NOTE}.note({number})")
        _begin_with(module, f"import entered as {NOTE}")
        code = compile(module, path, "exec", dont_inherit=True)
        kept = Path(importlib.util.cache_from_source(str(path)))
        kept.parent.mkdir(exist_ok=True)
        digest = importlib.util.source_hash(text)
        kept.write_bytes(
            importlib.util.MAGIC_NUMBER + _NEVER_CHECKED + digest + marshal.dumps(code)
        )
    return list(numbers)


def named_functions(node: ast.AST, above: str = "") -> Iterator[tuple[Function, str]]:
    """All functions in a node, with their qualified names."""
    for child in ast.iter_child_nodes(node):
        name = above
        if isinstance(child, Function | ast.ClassDef):
            name = f"{above}.{child.name}" if above else child.name
        if isinstance(child, Function):
            yield child, name
        yield from named_functions(child, name)


def that_mention(tree: Path, name: str) -> list[str]:
    """The functions of a tree that mention a name, as ``FILE:FUNCTION``."""
    found = []
    for path in sorted(tree.glob("packages/*/src/**/*.py")):
        text = path.read_text("utf-8")
        if name in text:
            found += [
                f"{path.relative_to(tree)}:{function}"
                for node, function in named_functions(ast.parse(text))
                if any(_mentions(one, name) for one in ast.walk(node))
            ]
    return found


def _mentions(node: ast.AST, name: str) -> bool:
    match node:
        case ast.Name(id=found) | ast.Attribute(attr=found) | ast.keyword(arg=found):
            return found == name
    return False


def _begin_with(node: Function | ast.Module, text: str) -> None:
    """Let a body begin with a statement, after what has to come first."""
    place = 0
    while place < len(node.body) and _comes_first(node.body[place]):
        place += 1
    (statement,) = ast.parse(text).body
    for one in ast.walk(statement):
        ast.copy_location(one, node.body[min(place, len(node.body) - 1)] if node.body else one)
    node.body.insert(place, statement)


def _comes_first(statement: ast.stmt) -> bool:
    match statement:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
        case ast.ImportFrom(module="__future__"):
            return True
    return False


def _record(tree: Path, files: list[str]) -> dict[str, dict[str, Any]]:
    """Run the tests of these files, and say what each has entered."""
    with tempfile.TemporaryDirectory(prefix="entries-") as name:
        folder = Path(name)
        plugins = tree / "tests/plugins"
        env = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, [*tree.glob("packages/*/src"), plugins])),
            "PYTHONDONTWRITEBYTECODE": "1",
            "OMP_NUM_THREADS": "1",
            "BRICKS_TESTS_ENTRIES": name,
        }
        options = ("-p", "entry_record", "-p", "no:cacheprovider")
        marks = ("-m", "not slow", "-q", "--tb=no", f"--rootdir={tree}")
        command = [sys.executable, "-m", "pytest", *options, *marks, *files]
        subprocess.run(command, cwd=tree, env=env, check=False)  # noqa: S603
        return _found(folder)


def _found(folder: Path) -> dict[str, dict[str, Any]]:
    """What a run has noted: of each file of tests, of each test its seconds and its functions."""
    found: dict[str, dict[str, Any]] = defaultdict(dict)
    record = folder / "tests"
    # all tests of a house may be left out, where what they need is missing
    lines = record.read_text("utf-8").splitlines() if record.exists() else []
    for line in lines:
        one = json.loads(line)
        entered: set[int] = set()
        for name in one["files"]:
            path = folder / name
            entered.update(map(int, path.read_text().split()) if path.exists() else ())
        found[one["test"].partition("::")[0]][one["test"]] = one["seconds"], sorted(entered)
    return dict(found)
