"""``bricktwin twin record`` and ``twin fit``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bricktwin.twin import motion_log
from bricktwin.twin.motion_log import read_log
from bricktwin.twin.physics import read_physics


@pytest.fixture
def log(bricktwin, tmp_path: Path) -> Path:
    (tmp_path / "hidden.json").write_text('{"battery_v": 6.9}')
    path = tmp_path / "logs" / "robot.jsonl"
    arguments = ["--steps", "60", "--physics", str(tmp_path / "hidden.json")]
    done = bricktwin("twin", "record", "bench", "--out", str(path), *arguments)
    assert (done.code, done.err) == (0, "") and "60 commands in" in done.out
    return path


@pytest.mark.slow
def test_record_and_fit(bricktwin, log: Path) -> None:
    done = bricktwin("twin", "fit", str(log), "--parameters", "battery_v", "friction_scale")
    assert (done.code, done.err) == (0, "")
    assert "motor_a_angle" in done.out
    assert "friction_scale                 1    not identifiable from this log" in done.out
    physics = log.with_suffix(".physics.json")
    assert str(physics) in done.out
    assert json.loads(physics.read_text())["battery_v"] == pytest.approx(6.9, abs=0.1)
    assert read_physics(physics).battery_v == pytest.approx(6.9, abs=0.1)


def test_invalid_log_or_physics_prints_one_line(fails, tmp_path: Path) -> None:
    fails("twin", "fit", str(tmp_path / "nothing.jsonl"), says="cannot read the log")
    fails(
        "twin",
        "record",
        "robo-ant",
        "--out",
        str(tmp_path / "x"),
        says="there is no robot 'robo-ant'; choose two-wheeler",
    )
    wrong = tmp_path / "wrong.json"
    record = ("twin", "record", "bench", "--out", str(tmp_path / "x"))
    fails(*record, "--physics", str(wrong), says="cannot read the physics")
    wrong.write_text('{"gravity": 3}')
    fails(*record, "--physics", str(wrong), says="no parameter 'gravity'")
    for options, says in (
        (("--steps", "0"), "steps is 0"),
        (("--seed", "-1"), "seed is -1"),
        (("--hub", "telepathy"), "telepathy"),
        (("--hub", "ble", "--physics", str(wrong)), "its own physics"),
    ):
        fails(*record, *options, says=says)
    assert not (tmp_path / "x").exists()


def test_robot_from_a_file(bricktwin, fails, tmp_path: Path) -> None:
    robot, log = tmp_path / "my_robot.py", tmp_path / "robot.jsonl"
    robot.write_text(
        "from brickhub.robot import HubKind, Motor, Robot\n"
        "ROBOT = Robot('my-robot', HubKind.CITY, motors=(Motor('wheel', 'A'),))\n"
    )
    worn = tmp_path / "worn.json"
    worn.write_text('{"motor_friction_scale": 1.4}')
    assert (
        "20 commands in"
        in bricktwin(
            *("twin", "record", str(robot), "--steps", "20", "--out", str(log)),
            *("--physics", str(worn)),
        ).out
    )
    assert read_log(log).robot == "my-robot"
    fails(
        "twin",
        "fit",
        str(log),
        says="is of the robot 'my-robot', which is not built in; name its file",
    )
    done = bricktwin(
        *("twin", "fit", str(log), "--robot", f"{robot}:ROBOT"),
        *("--parameters", "motor_friction_scale", "backlash_deg"),
    )
    assert (done.code, done.err) == (0, "")
    physics = log.with_suffix(".physics.json")
    found = read_physics(physics).motor_friction_scale
    assert found == pytest.approx(1.4, abs=0.2)
    head, error, parameters, friction, backlash, last = done.out.splitlines()
    assert head == "error of the twin (root mean square)"
    assert error.split()[0] == "wheel_angle" and error.endswith("-> 0")
    assert parameters == "parameters"
    assert friction == f"  {'motor_friction_scale':24}       1 -> {found:.3g}"
    assert backlash == f"  {'backlash_deg':24}     2.5    not identifiable from this log"
    assert last == f"physics  {physics}"


def test_robot_does_not_move_if_the_log_cannot_be_written(
    fails, monkeypatch, tmp_path: Path
) -> None:
    def move(*_: object) -> None:
        pytest.fail("the robot moved")

    monkeypatch.setattr(motion_log, "record", move)
    (tmp_path / "file").write_text("an earlier log")
    for out in (
        tmp_path / "file" / "log.jsonl",
        tmp_path / "file" / "folder" / "log.jsonl",
        tmp_path / ("x" * 300),
    ):
        fails("twin", "record", "bench", "--out", str(out), says=f"cannot write {out} (")
    for out in (tmp_path / "logs" / "log.jsonl", tmp_path / "file"):
        fails("twin", "record", "bench", "--hub", "ble", "--out", str(out), says="give --yes")
    assert [path.name for path in tmp_path.iterdir()] == ["file"], "nothing was made"
    assert (tmp_path / "file").read_text() == "an earlier log"
