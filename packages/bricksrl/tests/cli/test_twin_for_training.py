"""``bricksrl twin record`` and ``twin fit``."""

from __future__ import annotations

import json

import pytest

from bricksrl.cli import main
from bricksrl.training import RunFolder
from bricktwin.twin.motion_log import read_log


@pytest.fixture
def log(tmp_path):
    (tmp_path / "hidden.json").write_text('{"battery_v": 6.9}')
    path = tmp_path / "logs" / "robot.jsonl"
    arguments = ["--steps", "60", "--physics", str(tmp_path / "hidden.json")]
    assert main(["twin", "record", "bench", "--out", str(path), *arguments]) == 0
    return path


@pytest.mark.slow  # the fit itself is tested in bricktwin
def test_record_fit_train(bricksrl, log, capsys, tmp_path):
    capsys.readouterr()
    assert main(["twin", "fit", str(log), "--parameters", "battery_v", "friction_scale"]) == 0
    written = capsys.readouterr()
    assert written.err == "" and "motor_a_angle" in written.out
    physics = log.with_suffix(".physics.json")
    found = json.loads(physics.read_text())
    assert found["battery_v"] == pytest.approx(6.9, abs=0.1)
    run = tmp_path / "run"
    done = bricksrl(
        "train", "RunAway-v0", "--episodes", "1", "--physics", str(physics), "--run", str(run)
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert RunFolder(run).read_config().physics.battery_v == found["battery_v"]


def test_invalid_log_or_physics_prints_one_line(fails, tmp_path):
    fails("twin", "fit", str(tmp_path / "nothing.jsonl"), says="cannot read the log")
    fails(
        "twin",
        "record",
        "robo-ant",
        "--out",
        str(tmp_path / "x"),
        says="there is no environment 'robo-ant'; choose one of",
    )
    fails(
        "train",
        "RunAway-v0",
        "--physics",
        str(tmp_path / "nothing.json"),
        says="cannot read the physics",
    )
    (tmp_path / "wrong.json").write_text('{"gravity": 3}')
    fails(
        "train",
        "RunAway-v0",
        "--physics",
        str(tmp_path / "wrong.json"),
        says="no parameter 'gravity'",
    )
    fails(
        "train",
        "RunAway-v0",
        "--randomize",
        "--physics",
        str(tmp_path / "wrong.json"),
        says="choose one of the two",
    )


def test_record_and_fit_take_a_robot_from_a_file(fails, capfd, tmp_path):
    """Also one on the bench, whose sensor has no reading but that of the scene of the task in its
    file."""
    robot, log = tmp_path / "my_robot.py", tmp_path / "robot.jsonl"
    assert main(["new", "robot", str(robot)]) == 0
    assert main(["twin", "record", str(robot), "--steps", "20", "--out", str(log)]) == 0
    assert "20 commands in" in capfd.readouterr().out
    assert read_log(log).robot == "my-robot"
    fails(
        "twin",
        "fit",
        str(log),
        says="is of the robot 'my-robot', which is not built in; name its file",
    )
    assert (
        main(["twin", "fit", str(log), "--robot", f"{robot}:ROBOT", "--parameters", "battery_v"])
        == 2
    )
    assert "give readings=" in capfd.readouterr().err, "the robot alone has no scene"
    assert main(["twin", "fit", str(log), "--robot", str(robot), "--parameters", "battery_v"]) == 0
    assert "disc_angle" in capfd.readouterr().out


def test_record_takes_the_robot_of_an_environment(tmp_path):
    path = tmp_path / "robot.jsonl"
    assert main(["twin", "record", "RunAway-v0", "--steps", "1", "--out", str(path)]) == 0
    assert read_log(path).robot == "two-wheeler"
    assert read_log(path).channels[0, -1] == 2000.0, (
        "on an open floor, as the two-wheeler by its own name"
    )
