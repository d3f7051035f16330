"""``bricksrl hub scan | check | latency | calibrate | stop``, on the virtual hub and over a simulated radio."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from brickhub.virtual import transport
from bricksrl.cli import main

pytestmark = pytest.mark.realtime


def told(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(arguments)
    written = capfd.readouterr()
    assert written.err == ""
    return code, written.out


def test_scan_shows_the_virtual_hub(capfd) -> None:
    code, out = told(capfd, "hub", "scan", "--hub", "virtual")
    assert code == 0 and "virtual hub" in out and "prime" in out
    code, out = told(capfd, "hub", "scan", "--hub", "virtual", "--json")
    assert json.loads(out) == [{"name": "virtual hub", "address": "virtual", "rssi_dbm": 0, "kind": "prime"}]


def test_scan_without_hub_gives_remedy(capfd, monkeypatch) -> None:
    monkeypatch.setattr("brickhub.hub.transports.scan.scan", lambda seconds: [])
    code, out = told(capfd, "hub", "scan")
    assert code == 1 and "switch one on" in out
    assert told(capfd, "hub", "scan", "--json") == (1, "[]\n")


def test_wrong_scans_print_one_line(fails) -> None:
    fails("hub", "scan", "--hub", "infrared", says="choose ble or virtual")
    fails("hub", "scan", "--seconds", "0", says="from 0 to 600")


def test_latency(capfd, fails) -> None:
    code, out = told(capfd, "hub", "latency", "Walker-v1", "--hub", "virtual", "--exchanges", "5")
    assert code == 0 and "p50 30.0 ms" in out and "of 5 exchanges" in out and "15 ms" in out and "11 %" in out
    _, out = told(capfd, "hub", "latency", "RunAway-v0", "--hub", "virtual", "--json")
    found = json.loads(out)
    assert (found["interval_ms"], found["link_share"], found["exchanges"]) == (15.0, None, 100)
    fails("hub", "latency", "RunAway-v0", "--hub", "virtual", "--exchanges", "0", says="at least 1")


def test_good_robot_passes_check(capfd) -> None:
    code, out = told(capfd, "hub", "check", "Spinning-v0", "--hub", "virtual", "--yes")
    assert code == 0
    assert out.splitlines()[-1] == "ready for Spinning-v0"
    assert all(line.startswith("ok ") for line in out.splitlines()[:-1])
    assert "motor left        moved by 30 deg" in out


def test_nothing_moves_without_confirmation(capfd, monkeypatch) -> None:
    moved = []
    monkeypatch.setattr("brickhub.hub.link.lockstep.HubLink.act", lambda self, values: moved.append(values))
    code, out = told(capfd, "hub", "check", "RunAway-v0", "--hub", "virtual")
    assert code == 0 and not moved and "skipped  directions" in out


@pytest.mark.parametrize(("answer", "code"), [("y\ny\ny\n", 0), ("y\nn\ny\n", 1)])
def test_user_is_asked_after_each_move(capfd, monkeypatch, answer: str, code: int) -> None:
    import io

    terminal = io.StringIO(answer)
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stdin", terminal)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert main(("hub", "check", "Spinning-v0", "--hub", "virtual")) == code
    written = capfd.readouterr()
    assert written.err.count("[y/N]") == 3 and "Move it now?" in written.err
    assert ("calibrate --reverse left" in written.out) == (code == 1)


class Unplugged(transport.VirtualHub):
    """A robot whose right motor is in the wrong port."""

    def __init__(self, *args, **options) -> None:
        super().__init__(*args, **options)
        motors = tuple(replace(motor, port="B") if motor.port == "A" else motor for motor in self.robot.motors)
        self.machine.robot = replace(self.robot, motors=motors)
        del self.machine.servos["A"]


def test_failed_check_gives_remedy(capfd, monkeypatch) -> None:
    monkeypatch.setattr(transport, "VirtualHub", Unplugged)
    code, out = told(capfd, "hub", "check", "Spinning-v0", "--hub", "virtual", "--yes", "--json")
    found = json.loads(out)
    assert code == 1 and found["ok"] is False
    errors = [finding for finding in found["findings"] if finding["outcome"] == "error"]
    assert [error["name"] for error in errors] == ["port A"]
    assert "nothing is there; move it from port B to A" in errors[0]["detail"]


def test_calibrations_are_saved_shown_and_removed(capfd, tmp_path: Path, fails) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    code, out = told(capfd, "hub", "calibrate", "RunAway-v0", "--reverse", "left", *place)
    path = tmp_path / "virtual" / "two-wheeler.json"
    assert code == 0 and "reversed left" in out and str(path) in out
    assert json.loads(path.read_text())["reversed"] == ["left"]
    told(capfd, "hub", "calibrate", "RunAway-v0", "--reverse", "left", "right", *place)
    assert json.loads(path.read_text())["reversed"] == ["right"], "the other way round again"
    told(capfd, "hub", "calibrate", "RunAway-v0", "--forget", *place)
    assert not path.exists()
    fails("hub", "calibrate", "RunAway-v0", "--reverse", "tail", *place, says="no motor 'tail'")
    fails("hub", "calibrate", "RunAway-v0", "--forget", "--reverse", "left", *place, says="--reverse has no effect with --forget")
    fails(
        "hub", "calibrate", "RunAway-v0", "--by-hand", "--reverse", "left", *place, says="--by-hand has no effect with --reverse"
    )


def test_joints_are_calibrated_by_end_stops(capfd, tmp_path: Path, fails) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    fails("hub", "calibrate", "RoboArm-v0", *place, says="nothing was moved")
    assert told(capfd, "hub", "calibrate", "RoboArm-v0", "--yes", *place)[0] == 0
    zeros = json.loads((tmp_path / "virtual" / "robo-arm.json").read_text())["zeros_deg"]
    assert set(zeros) == {"low", "high", "grab"} and all(abs(zero) <= 2 for zero in zeros.values())


def test_other_motors_are_calibrated_in_place(capfd, tmp_path: Path, fails) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    fails("hub", "calibrate", "Walker-v1", *place, says="add --by-hand")
    told(capfd, "hub", "calibrate", "Walker-v1", "--by-hand", *place)
    zeros = json.loads((tmp_path / "virtual" / "walker.json").read_text())["zeros_deg"]
    assert set(zeros) == {"left_front", "right_front", "left_back", "right_back"}


def test_a_check_uses_the_calibration(capfd, tmp_path: Path) -> None:
    """A wrong calibration puts the joints out of range, which the check reports."""
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    folder = tmp_path / "virtual"
    folder.mkdir()
    (folder / "robo-arm.json").write_text('{"hub": "virtual", "zeros_deg": {"low": 90}, "reversed": []}')
    code, out = told(capfd, "hub", "check", "RoboArm-v0", *place)
    assert code == 1 and "error    angle low" in out and "brickhub calibrate" in out


def test_stop(capfd, fails) -> None:
    assert told(capfd, "hub", "stop", "--hub", "virtual")[0] == 0
    fails("hub", "stop", "--hub", "pigeon", says="there is no hub 'pigeon'")


def test_every_tool_prints_one_line_errors(fails) -> None:
    for tool in ("check", "latency", "calibrate"):
        fails("hub", tool, "RunAwy-v0", "--hub", "virtual", says="did you mean")
        fails("hub", tool, "RunAway-v0", "--hub", "pigeon", says="there is no hub 'pigeon'")
