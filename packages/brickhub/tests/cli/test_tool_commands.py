"""``brickhub scan | program | check | latency | calibrate | stop`` on the virtual hub, for robots
in a user's file."""

from __future__ import annotations

import ast
import io
import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import described
import pytest
from bench_arm import BenchArm
from described import ROBO_ARM, TWO_WHEELER

from brickhub import target
from brickhub.cli import main
from brickhub.hub.program.generate import generate
from brickhub.target import Target, whole_interface
from brickhub.virtual import virtual_transport

CAR, LEGS, ARM = (f"{described.__file__}:{name}" for name in ("TWO_WHEELER", "WALKER", "ROBO_ARM"))


def test_scan_shows_the_virtual_hub(told) -> None:
    code, out = told("scan", "--hub", "virtual")
    assert code == 0 and "virtual hub" in out and "prime" in out
    code, out = told("scan", "--hub", "virtual", "--json")
    assert json.loads(out) == [
        {"name": "virtual hub", "address": "virtual", "rssi_dbm": 0, "kind": "prime"}
    ]


def test_scan_without_hub_gives_remedy(told, monkeypatch) -> None:
    monkeypatch.setattr("brickhub.cli.hub_tools.scan", lambda seconds: [])
    code, out = told("scan")
    assert code == 1 and "switch one on" in out
    assert told("scan", "--json") == (1, "[]\n")


def test_program_equals_generated_one(told, tmp_path: Path) -> None:
    code, out = told("program", CAR)
    assert (
        code == 0
        and out.strip() == generate(TWO_WHEELER, whole_interface(TWO_WHEELER)).source.strip()
    )
    ast.parse(out)
    path = tmp_path / "new" / "program.py"
    assert told("program", CAR, "--out", str(path)) == (
        0,
        f"{len(out.splitlines())} lines: {path}\n",
    )
    assert path.read_text() == out


def test_latency(told, fails) -> None:
    code, out = told("latency", CAR, "--hub", "virtual", "--exchanges", "5")
    assert (
        code == 0
        and "round trip           p50" in out
        and "of 5 exchanges" in out
        and "is the link" in out
    )
    for link, interval_ms in ((), 45.0), (("--link", "mac"), 15.0):
        _, out = told("latency", CAR, "--hub", "virtual", *link, "--json")
        found = json.loads(out)
        assert (
            found["interval_ms"] == pytest.approx(interval_ms, abs=1.25)
            and found["exchanges"] == 100
        )
        assert found["link_share"] == pytest.approx(
            2 * interval_ms / (50 + 2 * interval_ms), abs=0.03
        )
    fails("latency", CAR, "--hub", "virtual", "--link", "car", says="no link 'car'")
    fails("latency", CAR, "--hub", "ble", "--link", "mac", says="leave out --link")
    fails(
        "latency",
        CAR,
        "--hub",
        "virtual",
        "--exchanges",
        "0",
        says="exchanges is 0; give 1 or more",
    )


def test_cable_has_no_connection_interval(told, tmp_path) -> None:
    path = tmp_path / "rover.py"
    path.write_text(
        "from brickhub.robot import HubKind, Motor, MotorKind, Robot\n"
        "ROVER = Robot('rover', HubKind.EV3, (Motor('left', 'B', MotorKind.EV3_LARGE),))\n"
    )
    code, out = told("latency", str(path), "--hub", "virtual", "--exchanges", "5")
    assert code == 0 and "round trip           p50" in out
    assert "interval" not in out


def test_good_robot_passes_check(told) -> None:
    code, out = told("check", CAR, "--hub", "virtual", "--link", "mac", "--yes")
    assert code == 0
    assert out.splitlines()[-1] == "ready for two-wheeler"
    assert all(line.startswith("ok ") for line in out.splitlines()[:-1] if "wheel" not in line)
    assert out.count("skipped  wheel") == 2, "its hub lies on the bench"
    assert "motor left        moved by 30 deg" in out


def test_nothing_moves_without_confirmation(told, monkeypatch) -> None:
    moved = []
    monkeypatch.setattr(
        "brickhub.hub.link.lockstep.HubLink.act", lambda self, values: moved.append(values)
    )
    code, out = told("check", CAR, "--hub", "virtual")
    assert code == 0 and not moved and "skipped  directions" in out


@pytest.mark.parametrize(("answer", "code"), [("y\ny\ny\n", 0), ("y\nn\ny\n", 1)])
def test_user_is_asked_after_each_move(capfd, monkeypatch, answer: str, code: int) -> None:
    terminal = io.StringIO(answer)
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stdin", terminal)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert main(("check", CAR, "--hub", "virtual")) == code
    written = capfd.readouterr()
    assert (
        written.err.count("[y/N, Enter is no]") == 1
        and written.err.count("[y/n]") == 2
        and "Move it now?" in written.err
    )
    assert ("--hub virtual --reverse left`" in written.out) == (code == 1)


class Unplugged(virtual_transport.VirtualHub):
    """A robot whose right motor is in the wrong port."""

    def __init__(self, *args, **options) -> None:
        super().__init__(*args, **options)
        motors = tuple(
            replace(motor, port="B") if motor.port == "A" else motor for motor in self.robot.motors
        )
        self.machine.robot = replace(self.robot, motors=motors)
        del self.machine.servos["A"]


def test_failed_check_gives_remedy(told, monkeypatch) -> None:
    monkeypatch.setattr(virtual_transport, "VirtualHub", Unplugged)
    code, out = told("check", CAR, "--hub", "virtual", "--yes", "--json")
    found = json.loads(out)
    assert code == 1 and (found["ok"], found["env"], found["hub"]) == (
        False,
        "two-wheeler",
        "virtual",
    )
    errors = [finding for finding in found["findings"] if finding["outcome"] == "error"]
    assert [error["name"] for error in errors] == ["port A"]
    assert "nothing is there; move it from port B to A" in errors[0]["detail"]


def test_calibrations_are_saved_shown_and_removed(told, fails, tmp_path: Path) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    code, out = told("calibrate", CAR, "--reverse", "left", *place)
    path = tmp_path / "virtual" / "two-wheeler.json"
    assert code == 0 and "reversed left" in out and str(path) in out
    assert json.loads(path.read_text())["reversed"] == ["left"]
    told("calibrate", CAR, "--reverse", "left", "right", *place)
    assert json.loads(path.read_text())["reversed"] == ["left", "right"], (
        "said twice, it changes nothing"
    )
    told("calibrate", CAR, "--as-described", "left", *place)
    assert json.loads(path.read_text())["reversed"] == ["right"]
    fails(
        "calibrate",
        CAR,
        "--reverse",
        "left",
        "--as-described",
        "left",
        *place,
        says="cannot be reversed and as described",
    )
    told("calibrate", CAR, "--forget", *place)
    assert not path.exists()
    fails("calibrate", CAR, "--reverse", "tail", *place, says="no motor 'tail'")
    fails(
        "calibrate",
        CAR,
        "--forget",
        "--reverse",
        "left",
        *place,
        says="--reverse has no effect with --forget",
    )
    fails(
        "calibrate",
        CAR,
        "--by-hand",
        "--reverse",
        "left",
        *place,
        says="--by-hand has no effect with --reverse",
    )


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of an arm whose joints have ends."""
    found = Target("robo-arm", ROBO_ARM, whole_interface(ROBO_ARM), BenchArm)
    monkeypatch.setattr(target, "_finder", lambda: {"arm": found}.__getitem__)
    return "arm"


def test_joints_are_calibrated_by_end_stops(told, fails, tmp_path: Path, arm: str) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    fails("calibrate", arm, *place, says="nothing was moved")
    assert told("calibrate", arm, "--yes", *place)[0] == 0
    zeros = json.loads((tmp_path / "virtual" / "robo-arm.json").read_text())["zeros_deg"]
    assert set(zeros) == {"low", "high", "grab"} and all(abs(zero) <= 2 for zero in zeros.values())


def test_joint_that_meets_no_stops_is_not_calibrated(fails, tmp_path: Path) -> None:
    fails(
        "calibrate",
        ARM,
        "--hub",
        "virtual",
        "--yes",
        "--calibrations",
        str(tmp_path),
        says="motor 'low' meets no stops",
    )
    assert not list(tmp_path.iterdir())


def test_other_motors_are_calibrated_in_place(told, fails, tmp_path: Path) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    fails("calibrate", LEGS, *place, says="add --by-hand")
    told("calibrate", LEGS, "--by-hand", *place)
    zeros = json.loads((tmp_path / "virtual" / "walker.json").read_text())["zeros_deg"]
    assert set(zeros) == {"left_front", "right_front", "left_back", "right_back"}


def test_a_check_uses_the_calibration(told, tmp_path: Path, arm: str) -> None:
    """A wrong calibration puts the joints out of range, which the check reports."""
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    code, out = told("check", arm, *place)
    assert code == 0 and "angle low" in out
    folder = tmp_path / "virtual"
    folder.mkdir()
    (folder / "robo-arm.json").write_text(
        '{"hub": "virtual", "zeros_deg": {"low": 90}, "reversed": []}'
    )
    code, out = told("check", arm, *place)
    assert code == 1 and "error    angle low" in out and "brickhub calibrate" in out


def test_stop(told, fails) -> None:
    assert told("stop", "--hub", "virtual") == (
        0,
        "a virtual hub lives in the command that uses it; none runs here\n",
    )
    fails("stop", "--hub", "pigeon", says="there is no hub 'pigeon'")


@pytest.mark.parametrize("tool", ["check", "latency", "calibrate"])
def test_every_tool_prints_one_line_errors(fails, tool: str) -> None:
    run = partial(fails, tool)
    run("nowhere.py", "--hub", "virtual", says="there is no file nowhere.py")
    run("rover", "--hub", "virtual", says="there is no robot 'rover'; name a Python file with one")
    run(f"{described.__file__}:ROVER", "--hub", "virtual", says="there is no 'ROVER' in")
    run(
        described.__file__,
        "--hub",
        "virtual",
        says="has 3 robots (TWO_WHEELER, WALKER, ROBO_ARM); name one:",
    )
    run(
        f"{described.__file__}:SPINNING",
        "--hub",
        "virtual",
        says="is not a robot; name a Robot that is written there",
    )
    run(CAR, "--hub", "pigeon", says="there is no hub 'pigeon'")
