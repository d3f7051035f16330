"""``bricksrl check``."""

from __future__ import annotations

import pytest

from bricksrl.cli import main

OWN = """
from dataclasses import replace
from bricksrl.envs.tasks import spinning
MINE = replace(spinning.SPINNING, id="Mine-v0", doc="Spins.", max_steps=4{change})
"""


def test_each_check_prints_one_line(capsys):
    assert main(["check", "RunAway-v0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8
    assert all(line.startswith("ok      ") for line in lines)


def test_task_from_file_is_checked(capsys, tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN.format(change=""))
    assert main(["check", str(path)]) == 0
    path.write_text(OWN.format(change=", reward=lambda p, a, o: o"))
    assert main(["check", f"{path}:MINE"]) == 1
    assert "error   functions    reward has the shape" in capsys.readouterr().out


def test_unknown_task_prints_one_line(fails, tmp_path):
    fails("check", "RunAwy-v0", says="did you mean")
    fails("check", str(tmp_path / "own.py"), says="no file")


@pytest.mark.parametrize(
    "arguments",
    [
        "check missing.py",
        "train RunAway-v0 --agent missing.py",
        "play missing",
        "data export missing --out x",
    ],
)
def test_what_is_missing_is_said_before_anything_is_loaded(monkeypatch, capsys, arguments):
    """Torch takes seconds."""
    from bricksrl.cli import data, envs, page, train

    for module in (data, envs, page, train):
        monkeypatch.setattr(module, "load_learning", lambda: pytest.fail("torch would be loaded"))
    assert main(arguments.split()) == 2
    assert "error: there is no" in capsys.readouterr().err
