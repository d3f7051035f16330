"""Which tests enter which function, and which of them a fault is tried with."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.entries import Entries, compile_with_notes, that_mention
from benchmarks.mutants import Tree

MODULE = '''"""Text."""
from __future__ import annotations

LIMIT = 3

def outer(number=LIMIT):
    """Text of a function."""
    def inner():
        return number
    return inner()

class Thing:
    async def idle(self):
        return LIMIT

    def busy(self):
        return [self.busy for _ in ()]
'''
PLUGINS = Path(__file__).parents[1] / "plugins"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    folder = tmp_path / "packages/brickhub/src/brick"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "thing.py").write_text(MODULE)
    (tmp_path / "tests/plugins").mkdir(parents=True)
    shutil.copy(PLUGINS / "entered.py", tmp_path / "tests/plugins")
    return tmp_path


def names(*functions: str) -> list[str]:
    return [f"packages/brickhub/src/brick/thing.py:{name}" for name in functions]


def test_what_a_process_enters_is_noted_and_texts_stay(tree, tmp_path):
    known = ["gone.py:function"]
    functions = compile_with_notes(tree, known)
    assert functions == known + names("outer", "outer.inner", "Thing.idle", "Thing.busy")
    program = (
        "import inspect, brick.thing as t; t.outer(); t.outer(); print(t.outer.__doc__, "
        "inspect.getsource(t.Thing.busy).split()[1])"
    )
    file = tmp_path / "noted"
    paths = str(tree / "packages/brickhub/src")
    out = subprocess.run(
        [sys.executable, "-S", "-c", program],
        env={**os.environ, "PYTHONPATH": paths, "BRICKS_TESTS_ENTERED": str(file)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert out.stdout.split() == ["Text", "of", "a", "function.", "busy(self):"]
    assert [functions[int(number)] for number in file.read_text().split()] == names(
        "outer", "outer.inner"
    )


def test_functions_that_mention_a_constant(tree):
    assert that_mention(tree, "LIMIT") == names("outer", "Thing.idle")
    assert that_mention(tree, "busy") == names("Thing.busy")


def test_the_nearest_tests_come_first_and_no_more_than_two_minutes_of_them(tree):
    tests = {
        file: {"digest": "", "tests": {f"{file}::test": (seconds, [0])}}
        for file, seconds in {
            "packages/bricksrl/tests/test_far.py": 0.1,
            "packages/brickhub/tests/test_long.py": 240.0,
            "packages/brickhub/tests/test_near.py": 2.0,
            "packages/brickhub/tests/test_thing.py": 100.0,
        }.items()
    }
    entries = Entries(names("outer", "Thing.idle"), tests)
    chosen = Tree(tree, tree, entries, None, []).chosen  # type: ignore[arg-type]
    file = "packages/brickhub/src/brick/thing.py"
    own, near, far = (
        f"packages/{name}::test"
        for name in (
            "brickhub/tests/test_thing.py",
            "brickhub/tests/test_near.py",
            "bricksrl/tests/test_far.py",
        )
    )
    assert chosen(file, "outer") == [own, near, far]
    # a constant: by the functions that mention it
    assert chosen(file, "LIMIT") == [own, near, far]
    # what no test enters: by those of the module's name
    assert chosen(file, "Thing.idle") == [own]
    # what Python does not execute: by those of the house
    assert chosen(file.replace("thing", "other"), "idle") == [near, own]


@pytest.mark.slow
def test_types_find_what_no_test_does(tmp_path):
    file = "packages/brickhub/src/thing.py"
    right = "def is_there() -> bool:\n    return False\n"
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(right)
    (tmp_path / "pyproject.toml").write_text(f'[tool.mypy]\nstrict = true\nfiles = ["{file}"]\n')
    tree = Tree(tmp_path, tmp_path, Entries([], {}), None, [])  # type: ignore[arg-type]
    assert tree.types_find(file, right.replace("False", "None"))
    assert not tree.types_find(file, right.replace("False", "True"))
    assert (tmp_path / file).read_text() == right
