"""Objects from the user's code, and the line of it that failed."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Literal

import pytest

from brickhub import HOUSES
from brickhub.errors import DescriptionError, UnknownNameError
from brickhub.robot import HubKind, Robot
from brickhub.user_files import (
    NotCode,
    code_names,
    failure_of_user,
    is_reference,
    load_object,
    load_robot,
    with_absolute_file,
    without_folder,
)
from brickhub.user_lines import line_of_user

ROBOT = "from brickhub.robot import HubKind, Robot\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "beside_it.py").write_text("KIND = 'CITY'\n")
    (tmp_path / "one.py").write_text(
        f"{ROBOT}from beside_it import KIND\nONE = SAME = Robot('one', HubKind[KIND])\n"
    )
    (tmp_path / "two.py").write_text(
        f"{ROBOT}A, B = Robot('a', HubKind.CITY), Robot('b', HubKind.CITY)\nNUMBER = 3\n"
    )
    (tmp_path / "none.py").write_text("NUMBER = 3\n")
    (tmp_path / "broken.py").write_text("\nimport no_such_module\n")
    (tmp_path / "raises.py").write_text("def f():\n    1 / 0\nf()\n")
    (tmp_path / "ends.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "syntax.py").write_text("x = = 3\n")
    yield tmp_path
    for name in ("beside_it", "one", "two", "none"):
        sys.modules.pop(name, None)


def test_references_are_told_from_names() -> None:
    assert all(
        map(is_reference, ("mine.py", "mine.py:ROBOT", "package.module:ROBOT", "C:/mine.py"))
    )
    assert not any(map(is_reference, ("walker", "RunAway-v0", "mine.ldr")))


def test_what_a_star_brings_is_no_second_robot(folder: Path) -> None:
    (folder / "star.py").write_text(
        "from brickhub.robot import *\nMINE = Robot('mine', HubKind.CITY)\n"
    )
    assert load_robot("star.py").name == "mine"
    (folder / "ours.py").write_text("from brickhub.robot import BENCH\n")
    assert load_robot("ours.py").name == "bench", "where there is no other"


@pytest.mark.parametrize(
    "reference", ["one.py", "./one.py", "one.py:ONE", "one.py:SAME", "one:ONE"]
)
def test_robot_from_file_or_module(folder: Path, reference: str) -> None:
    path = list(sys.path)
    assert load_robot(reference) == Robot("one", HubKind.CITY)
    assert sys.path == path


@pytest.mark.parametrize(
    ("reference", "error", "says"),
    [
        (
            "nowhere.py",
            UnknownNameError,
            "no file nowhere.py in .*; give the path of a Python file, or go to the right folder",
        ),
        ("/nowhere.py:ROBOT", UnknownNameError, "no file /nowhere.py; put it there"),
        (
            "nowhere:ROBOT",
            UnknownNameError,
            "no module 'nowhere'; give one that can be imported, or a file",
        ),
        ("one.py:TWO", UnknownNameError, "no 'TWO' in one.py; name a robot that is written there"),
        ("two.py", UnknownNameError, r"two.py has 2 robots \(A, B\); name one: two.py:ROBOT"),
        ("none.py", UnknownNameError, "none.py has no robot; write one there"),
        (
            "two.py:NUMBER",
            DescriptionError,
            "two.py:NUMBER is not a robot; name a Robot that is written there",
        ),
        (
            "broken.py",
            DescriptionError,
            r"No module named 'no_such_module', broken\.py, line 2\); correct it",
        ),
        ("broken:ROBOT", DescriptionError, "no_such_module"),
        (
            "raises.py",
            DescriptionError,
            r"ZeroDivisionError: division by zero, raises\.py, line 2\); correct it",
        ),
        ("ends.py", DescriptionError, r"SystemExit: 3, ends\.py, line 1\); correct it"),
        ("syntax.py", DescriptionError, "SyntaxError: invalid syntax"),
        (":ROBOT", UnknownNameError, "module"),
    ],
)
def test_what_cannot_be_loaded_is_said_in_one_line(
    folder: Path, reference: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says) as caught:
        load_robot(reference)
    assert "\n" not in str(caught.value)


def test_object_of_any_kind(folder: Path) -> None:
    assert load_object("none.py", "NUMBER") == load_object("none.py:NUMBER", Robot) == 3
    with pytest.raises(
        UnknownNameError, match=r"no 'OTHER' in none.py; name what is written there"
    ):
        load_object("none.py", "OTHER")
    with pytest.raises(UnknownNameError, match=r"none.py has no robot; draw one"):
        load_object("none.py", Robot, missing="draw one")


def test_absolute_reference_outlives_the_folder_it_was_given_in(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    reference = with_absolute_file("../one.py:ONE")
    assert reference == f"{folder / 'one.py'}:ONE" and without_folder(reference) == "one.py:ONE"
    monkeypatch.chdir(folder)
    assert load_robot(reference).name == "one"
    assert (
        with_absolute_file("package.module:ONE")
        == without_folder("package.module:ONE")
        == "package.module:ONE"
    )
    assert with_absolute_file("walker") == "walker"


def raised_by(file: Path, source: str, **names: object) -> BaseException:
    """What a file raises as it runs."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(source)
    with pytest.raises(Exception) as caught:  # noqa: PT011
        exec(compile(source, str(file), "exec"), names)  # noqa: S102
    return caught.value


@pytest.mark.parametrize("house", HOUSES)
def test_line_of_user_is_not_in_a_house(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, house: str
) -> None:
    """Wherever that is installed, also beside the user's files."""
    ours = ModuleType(house)
    ours.__file__ = str(tmp_path / "packages" / house / "__init__.py")
    monkeypatch.setitem(sys.modules, house, ours)
    inner = tmp_path / "packages" / house / "deep" / "inner.py"
    inner.parent.mkdir(parents=True)
    inner.write_text(source := "def fail():\n    raise ValueError('no')\n")
    names: dict[str, object] = {}
    exec(compile(source, str(inner), "exec"), names)  # noqa: S102
    error = raised_by(tmp_path / "my_robot.py", "x = 1\n\nfail()\n", fail=names["fail"])
    assert line_of_user(error) == ", my_robot.py, line 3"
    assert failure_of_user(error) == "ValueError: no, my_robot.py, line 3; correct it"


@pytest.mark.parametrize("house", HOUSES)
def test_failure_in_a_house_alone_is_not_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, house: str
) -> None:
    ours = ModuleType(house)
    ours.__file__ = str(tmp_path / house / "__init__.py")
    monkeypatch.setitem(sys.modules, house, ours)
    error = raised_by(tmp_path / house / "inner.py", "1 / 0")
    # without the lines of this test
    monkeypatch.setattr(error, "__traceback__", error.__traceback__.tb_next)
    assert line_of_user(error) == "" and failure_of_user(error) is None


def test_installed_packages_are_not_the_users(tmp_path: Path) -> None:
    import json

    error = raised_by(tmp_path / "mine.py", "\njson.loads('{')", json=json)
    assert line_of_user(error) == ", mine.py, line 2"


@dataclass
class Inner:
    share: float = 0.0
    place: Annotated[str | None, NotCode()] = None


@dataclass
class Outer:
    kind: Annotated[str, NotCode(("a", "b"))]
    mode: Literal["x", "y"] | None
    sizes: tuple[int, ...]
    words: tuple[Literal["x"], ...]
    inner: Inner | Path | None
    anything: Any


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (
            {
                "kind": "a",
                "mode": "y",
                "sizes": [1, 2],
                "words": ["x"],
                "inner": {"share": 1.0, "place": "http://x"},
            },
            [],
        ),
        ({"kind": "c", "mode": "z", "sizes": ["d"], "words": ["e", "x"]}, ["c", "z", "d", "e"]),
        ({"kind": ["a"], "mode": {"x": "y"}}, ["a", "x", "y"]),
        ({"inner": {"share": "f", "place": ["g"], "new": "h"}}, ["f", "g", "h"]),
        (
            {"inner": "i", "anything": "j", "new": {"k": [["l"], 1, None, True, ""]}},
            ["i", "j", "k", "l"],
        ),
        ({"kind": "a ", "mode": "x\n"}, ["a ", "x\n"]),
        ("m", ["m"]),
        (["n", 3], ["n"]),
        (None, []),
    ],
)
def test_text_names_code_unless_its_annotation_says_otherwise(value: Any, named: list[str]) -> None:
    assert list(code_names(value, Outer)) == named


@pytest.mark.parametrize("name", ["json", "os.path", "my_robot", "", "one.PY", "one.py\n"])
def test_only_a_reference_is_loaded(folder: Path, name: str) -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"names no Python file; give FILE\.py, FILE\.py:NAME or module:NAME$",
    ):
        load_object(name, "path")
