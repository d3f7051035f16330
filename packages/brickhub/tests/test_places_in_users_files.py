"""What is in a user's files, and where; what is said of a file that is not there, and of code that
raises."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from brickhub.errors import DescriptionError, TwinError, UnknownNameError
from brickhub.user_files import (
    beside,
    calling,
    check_there,
    is_reference,
    load_object,
    objects_in,
    with_absolute_file,
    without_folder,
    without_name,
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    return tmp_path


MATS = """
class Mat:
    def __init__(self, name):
        self.name = name

    def __eq__(self, other):
        return True

    __hash__ = None


PLAIN = SAME = Mat("plain")
MATS = [PLAIN, Mat("first"), (Mat("second"), {"third": Mat("third")})]
MATS.append(MATS)
ROWS = {"a": Mat("fourth"), 3: {Mat}}
NUMBER = 3
"""


def test_objects_are_found_by_their_names_and_places(folder: Path) -> None:
    (folder / "mats_of_this_test.py").write_text(MATS)
    kind = load_object("mats_of_this_test:Mat", "Mat")
    try:
        found = objects_in("mats_of_this_test:X", kind)
    finally:
        del sys.modules["mats_of_this_test"]
    names = {place: mat.name for place, mat in found.items()}
    # One object of two names counts once.
    plain = {place for place, name in names.items() if name == "plain"}
    assert len(plain) == 1
    assert plain < {"PLAIN", "SAME"}
    others = {place: name for place, name in names.items() if place not in plain}
    assert others == {
        "MATS[1]": "first",
        "MATS[2][0]": "second",
        "MATS[2][1]['third']": "third",
        "ROWS['a']": "fourth",
    }


def test_objects_in_a_list_need_names(folder: Path) -> None:
    (folder / "many.py").write_text("BOTH = [3, 4]\nNAMED = 5\n")
    assert load_object("many.py", int) == 5
    (folder / "listed.py").write_text("BOTH = [3, 4]\n")
    says = (
        r"listed.py has 2 ints \(BOTH\[0\], BOTH\[1\]\); give one a name of its own, INT = "
        r"BOTH\[0\], and name it: listed.py:INT"
    )
    with pytest.raises(UnknownNameError, match=f"^{says}$"):
        load_object("listed.py", int)
    (folder / "alone.py").write_text("ONLY = [7]\n")
    assert load_object("alone.py", int) == 7


def test_noun_of_a_message(folder: Path) -> None:
    (folder / "none.py").write_text("")
    (folder / "two.py").write_text("A, B = 1, 2\n")
    with pytest.raises(UnknownNameError, match="^none.py has no plate; bake one$"):
        load_object("none.py", int, missing="bake one", noun="plate")
    with pytest.raises(
        UnknownNameError, match=r"^two.py has 2 plates \(A, B\); name one: two.py:P"
    ):
        load_object("two.py", int, noun="plate")
    with pytest.raises(UnknownNameError, match="^there is no 'C' in two.py; name a plate that is"):
        load_object("two.py:C", int, noun="plate")
    with pytest.raises(UnknownNameError, match="^there is no 'C' in two.py; name what is written"):
        load_object("two.py:C", "A")


def test_plan_is_no_code(folder: Path) -> None:
    for reference in ("arm.ldr:joint", "ARM.IO:x", "c.mpd:y"):
        plan = reference.partition(":")[0]
        says = "names something in a building plan, which is no Python file; give the plan alone"
        with pytest.raises(UnknownNameError, match=f"{says}, {plan}"):
            load_object(reference, "x")


@pytest.mark.parametrize(
    ("reference", "is_one"),
    [
        ("mine.py", True),
        ("mine.PY", False),
        ("module:NAME", True),
        ("walker", False),
        ("", False),
    ],
)
def test_references(reference: str, is_one: bool) -> None:
    assert is_reference(reference) is is_one


@pytest.mark.parametrize(
    ("reference", "location", "shown"),
    [
        ("a/mine.py:ROBOT", "a/mine.py", "mine.py:ROBOT"),
        ("a/mine.py", "a/mine.py", "mine.py"),
        ("a/arm.ldr", "a/arm.ldr", "arm.ldr"),
        ("C:/robots/mine.py", "C:/robots/mine.py", "mine.py"),
        ("C:/robots/mine.py:ROBOT", "C:/robots/mine.py", "mine.py:ROBOT"),
        ("module.inner:ROBOT", "module.inner", "module.inner:ROBOT"),
        ("walker", "walker", "walker"),
    ],
)
def test_parts_of_a_reference(reference: str, location: str, shown: str) -> None:
    assert without_name(reference) == location
    assert without_folder(reference) == shown


def test_absolute_file(folder: Path) -> None:
    assert with_absolute_file("a/../mine.py") == str(Path.cwd() / "mine.py")
    assert with_absolute_file("arm.ldr") == str(Path.cwd() / "arm.ldr")
    assert with_absolute_file("mine.py:X") == f"{Path.cwd() / 'mine.py'}:X"
    assert with_absolute_file("module:X") == "module:X"


def test_file_that_is_not_there(folder: Path) -> None:
    (folder / "mine.py").touch()
    (folder / "arm.ldr").touch()
    for reference in ("mine.py", "mine.py:X", "arm.ldr", "module:X", "walker"):
        check_there(reference)
    here = Path.cwd()
    right = "or go to the right folder"
    told = {
        "": "the name '' is empty; give one, or leave the option out",
        "  ": "the name '  ' is empty; give one, or leave the option out",
        "no.py:X": f"there is no file no.py in {here}; give the path of a Python file, {right}",
        "no.LDR": f"there is no file no.LDR in {here}; give the path of a plan, {right}",
    }
    absolute = str(here / "no.py")
    told[absolute] = (
        f"there is no file {absolute}; put it there, or give the path of another Python file"
    )
    for reference, says in told.items():
        with pytest.raises(UnknownNameError) as caught:
            check_there(reference)
        assert str(caught.value) == says


def test_what_lies_beside_a_file_is_found(folder: Path) -> None:
    (folder / "inner").mkdir()
    path = list(sys.path)
    with beside("inner/mine.py:X"):
        assert sys.path == [str((folder / "inner").resolve()), *path]
    with beside("module:X"):
        assert sys.path[0] == str(Path.cwd())
    assert sys.path == path


def failing(error: Exception, *, is_of_user: bool = True) -> None:
    with calling("mine.py:reward", "gives no reward", is_of_user=is_of_user):
        raise error


def test_code_of_a_user_that_raises() -> None:
    here = Path(__file__).name
    says = (
        rf"^mine\.py:reward gives no reward \(ValueError: too much, {here}, line \d+\); correct it"
    )
    with pytest.raises(DescriptionError, match=says):
        failing(ValueError("too\nmuch"))
    # Ours say what to do, and other code's are no mistakes of the user.
    with pytest.raises(TwinError, match="^ours$"):
        failing(TwinError("ours"))
    with pytest.raises(ValueError, match="^too much$"):
        failing(ValueError("too much"), is_of_user=False)
