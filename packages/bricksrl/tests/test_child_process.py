"""Our own processes: whose code they run."""

import errno
import io
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from bricksrl.child_process import open_channel, own_python

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


class _Gone(io.BytesIO):
    """A pipe whose reader is gone."""

    code = errno.EPIPE

    def write(self, _data: object) -> int:
        raise OSError(self.code, os.strerror(self.code))


@pytest.mark.parametrize("code", [errno.EPIPE, errno.EINVAL])
def test_side_that_is_gone_is_a_broken_pipe_on_every_system(code, monkeypatch):
    """Windows calls it an invalid argument."""
    monkeypatch.setattr(_Gone, "code", code)
    send = open_channel(io.BytesIO(), _Gone(), lambda message: None)
    with pytest.raises(BrokenPipeError):
        send("ready")


def test_what_a_child_starts_does_not_read_its_messages():
    """On Windows it would wait until a message comes, as somebody reads already."""
    program = (
        "import subprocess, sys\n"
        "from bricksrl.child_process import leave, parent_channel\n"
        "send = parent_channel(lambda message: None)\n"
        "ask = [sys.executable, '-c', 'import sys; print(sys.stdin.read())']\n"
        "said = subprocess.run(ask, capture_output=True, timeout=30, text=True).stdout\n"
        "send('said', said.strip())\n"
        "leave()\n"
    )
    command, variables = own_python("-c", program)
    with subprocess.Popen(
        command, env=variables, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        said = child.stdout.read()
        child.stdin.close()
    assert pickle.loads(said) == ("said", "")  # noqa: S301  of our own process
