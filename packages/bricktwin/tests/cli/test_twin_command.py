"""``bricktwin twin record`` and ``twin fit``."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import BENCH
from brickhub.target import whole_interface
from bricktwin.cli.twin import FitTwin, _bench_scene
from bricktwin.robots import TWO_WHEELER
from bricktwin.twin import motion_log
from bricktwin.twin.motion_log import RunLog, read_log, write_log
from bricktwin.twin.physics import FITTED, Physics, read_physics
from bricktwin.twin.scene import Scene
from bricktwin.twin.system_id import FittedPhysics


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


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_fit_tells_its_progress_what_it_found_and_where_it_wrote_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    interface = whole_interface(BENCH)
    width = len(interface.commands)
    channels = np.zeros((3, len(interface.channels)))
    log = RunLog("bench", interface, 7, np.ones((2, width)), np.zeros(2), np.arange(3), channels)
    path = tmp_path / "run.jsonl"
    write_log(path, log)
    asked: list[dict[str, Any]] = []

    def found(of: RunLog, *, on_replay: Any, **options: Any) -> FittedPhysics:
        assert of.program_hash == 7 and (of.commands == log.commands).all()
        asked.append(options)
        on_replay(1, 12.34)
        on_replay(2, 0.5)
        return FittedPhysics(
            physics=Physics(battery_v=6.9, tilt_noise_deg=0.7),
            identified={"battery_v": 3.0},
            unidentified=("friction_scale",),
            error_before={"motor_a_angle": 12.345},
            error_after={"motor_a_angle": 0.25},
            replays=2,
        )

    monkeypatch.setattr("bricktwin.twin.system_id.fit", found)
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    FitTwin(path, parameters=("battery_v", "friction_scale")).execute()
    assert asked == [{"robot": BENCH, "scene": None, "names": ("battery_v", "friction_scale")}]
    # Each line of progress takes the place of the one before, and nothing is left at the end.
    blank = f"\r{'':40}\r"
    progress = f"{blank}replay 1, error 12.3 {blank}replay 2, error 0.5 {blank}"
    assert terminal.getvalue() == progress
    out = tmp_path / "run.physics.json"
    lines = capsys.readouterr().out.splitlines()
    assert [" ".join(line.split()) for line in lines] == [
        "error of the twin (root mean square)",
        "motor_a_angle 12.3 -> 0.25",
        "parameters",
        "battery_v 8 -> 6.9 V",
        "tilt_noise_deg 0.3 -> 0.7 deg",
        "friction_scale 1 not identifiable from this log",
        f"physics {out}",
    ]
    assert read_physics(out) == Physics(battery_v=6.9, tilt_noise_deg=0.7)
    # Without a terminal there is no progress; the file may have another name.
    monkeypatch.setattr("sys.stderr", other := io.StringIO())
    FitTwin(path, robot="two-wheeler", out=tmp_path / "mine.json").execute()
    assert other.getvalue() == "" and (tmp_path / "mine.json").exists()
    assert asked[1]["robot"] is TWO_WHEELER and asked[1]["names"] == FITTED


def test_fit_of_a_robot_that_is_not_built_in_asks_for_its_file(tmp_path: Path) -> None:
    interface = whole_interface(BENCH)
    channels = np.zeros((1, len(interface.channels)))
    nothing = np.zeros((0, len(interface.commands)))
    path = tmp_path / "run.jsonl"
    write_log(path, RunLog("crab", interface, 7, nothing, np.zeros(0), np.arange(1), channels))
    with pytest.raises(TwinError, match="is of the robot 'crab', which is not built in; name its"):
        FitTwin(path).execute()


def test_of_a_task_a_bench_keeps_its_readings_and_its_stops() -> None:
    stops = {"arm": (-9.0, 9.0)}
    task = Scene(end_stops=stops, light_pct=70.0, heading_deg=(10.0, 10.0))
    assert _bench_scene(task) == Scene(end_stops=stops)
    reading = {"eyes": lambda angles: 300.0}
    assert _bench_scene(Scene(readings=reading)) == Scene(readings=reading)
    assert _bench_scene(Scene(light_pct=70.0)) is _bench_scene(None) is None
