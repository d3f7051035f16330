"""``bricksrl twin record`` and ``twin fit``."""

from __future__ import annotations

import json

import pytest

from bricksrl.cli import main, twin
from bricksrl.training import RunFolder
from bricksrl.twin.system_id import FITTED


def test_fit_uses_identifiable_parameters():
    assert twin.FITTED == FITTED


@pytest.fixture
def log(tmp_path):
    (tmp_path / "hidden.json").write_text('{"battery_v": 6.9}')
    path = tmp_path / "logs" / "robot.jsonl"
    arguments = ["--steps", "60", "--physics", str(tmp_path / "hidden.json")]
    assert main(["twin", "record", "bench", "--out", str(path), *arguments]) == 0
    return path


def test_record_fit_train(bricksrl, log, capsys, tmp_path):
    capsys.readouterr()
    assert main(["twin", "fit", str(log), "--parameters", "battery_v", "friction_scale"]) == 0
    written = capsys.readouterr()
    assert written.err == ""
    assert "motor_a_angle" in written.out
    assert "friction_scale                 1    not identifiable from this log" in written.out
    physics = log.with_suffix(".physics.json")
    assert str(physics) in written.out
    found = json.loads(physics.read_text())
    assert found["battery_v"] == pytest.approx(6.9, abs=0.1)
    run = tmp_path / "run"
    done = bricksrl("train", "RunAway-v0", "--episodes", "1", "--physics", str(physics), "--run", str(run))
    assert (done.returncode, done.stderr) == (0, "")
    assert RunFolder(run).read_config().physics.battery_v == found["battery_v"]


def test_invalid_log_or_physics_prints_one_line(fails, tmp_path):
    fails("twin", "fit", str(tmp_path / "nothing.jsonl"), says="cannot read the log")
    fails("twin", "record", "robo-ant", "--out", str(tmp_path / "x"), says="no robot 'robo-ant'")
    fails("train", "RunAway-v0", "--physics", str(tmp_path / "nothing.json"), says="cannot read the physics")
    (tmp_path / "wrong.json").write_text('{"gravity": 3}')
    fails("train", "RunAway-v0", "--physics", str(tmp_path / "wrong.json"), says="no parameter 'gravity'")
    fails("train", "RunAway-v0", "--randomize", "--physics", str(tmp_path / "wrong.json"), says="gravity")
