"""Our own processes: whose code they run."""

import subprocess
import sys
from pathlib import Path

import pytest

from bricksrl.child_process import own_python

ASK = "import sys; sys.path.append('somewhere'); import copy; print(copy.__file__)"


def _answer(command: list[str], variables: dict[str, str], folder: Path) -> str:
    process = subprocess.run(
        command, env=variables, cwd=folder, capture_output=True, text=True, check=True
    )
    return process.stdout.strip()


@pytest.mark.parametrize("arguments", [("-c", ASK), ("-m", "copy_says")])
def test_code_that_lies_in_the_present_folder_is_not_run(arguments, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "copy.py").write_text("raise SystemExit('code of a stranger')\n")
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "copy_says.py").write_text(ASK)
    monkeypatch.syspath_prepend(str(tmp_path / "ours"))
    command, variables = own_python(*arguments)
    assert (
        Path(_answer(command, variables, tmp_path / "here")).parent
        == Path(subprocess.__file__).parent
    )


def test_a_process_of_ours_imports_what_this_one_imports(tmp_path, monkeypatch):
    (tmp_path / "beside.py").write_text("print('found')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "elsewhere").mkdir()
    command, variables = own_python("-c", "import beside")
    assert command[0] == sys.executable
    assert _answer(command, variables, tmp_path / "elsewhere") == "found"


def test_the_folder_of_a_program_that_was_typed_in_stays_the_same_in_another_folder(
    tmp_path, monkeypatch
):
    (tmp_path / "beside.py").write_text("print('found')\n")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    assert _answer(*own_python("-c", "import beside"), tmp_path / "elsewhere") == "found"
