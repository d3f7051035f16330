"""``bricksrl hub scan | check | latency | calibrate | stop``: the commands of brickhub, for the
robot of an environment."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bricksrl.cli import main

pytestmark = pytest.mark.realtime


def told(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(arguments)
    written = capfd.readouterr()
    assert written.err == ""
    return code, written.out


def test_scan_and_stop_are_those_of_brickhub(capfd) -> None:
    code, out = told(capfd, "hub", "scan", "--hub", "virtual")
    assert code == 0 and "virtual hub" in out and "prime" in out
    assert told(capfd, "hub", "stop", "--hub", "virtual")[0] == 0


def test_latency(capfd, fails) -> None:
    code, out = told(capfd, "hub", "latency", "Walker-v1", "--hub", "virtual", "--exchanges", "5")
    assert (
        code == 0
        and "round trip           p50" in out
        and "of 5 exchanges" in out
        and "is the link" in out
    )
    _, out = told(capfd, "hub", "latency", "RunAway-v0", "--hub", "virtual", "--json")
    found = json.loads(out)
    assert (found["interval_ms"], found["link_share"], found["exchanges"]) == (
        pytest.approx(45.0, abs=1.25),
        None,
        100,
    )
    fails(
        "hub",
        "latency",
        "RunAway-v0",
        "--hub",
        "virtual",
        "--exchanges",
        "0",
        says="exchanges is 0; give 1 or more",
    )


def test_good_robot_passes_check(capfd) -> None:
    code, out = told(
        capfd, "hub", "check", "Spinning-v0", "--hub", "virtual", "--link", "mac", "--yes"
    )
    assert code == 0
    assert out.splitlines()[-1] == "ready for Spinning-v0"
    assert all(line.startswith("ok ") for line in out.splitlines()[:-1])
    assert "motor left        moved by 30 deg" in out


def test_joints_are_calibrated_by_end_stops(capfd, tmp_path: Path, fails) -> None:
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    fails("hub", "calibrate", "RoboArm-v0", *place, says="nothing was moved")
    assert told(capfd, "hub", "calibrate", "RoboArm-v0", "--yes", *place)[0] == 0
    zeros = json.loads((tmp_path / "virtual" / "robo-arm.json").read_text())["zeros_deg"]
    assert set(zeros) == {"low", "high", "grab"} and all(abs(zero) <= 2 for zero in zeros.values())


def test_a_check_uses_the_calibration(capfd, tmp_path: Path) -> None:
    """A wrong calibration puts the joints out of range, which the check reports."""
    place = ("--hub", "virtual", "--calibrations", str(tmp_path))
    folder = tmp_path / "virtual"
    folder.mkdir()
    (folder / "robo-arm.json").write_text(
        '{"hub": "virtual", "zeros_deg": {"low": 90}, "reversed": []}'
    )
    code, out = told(capfd, "hub", "check", "RoboArm-v0", *place)
    assert code == 1 and "error    angle low" in out and "brickhub calibrate" in out


def test_every_tool_prints_one_line_errors(fails) -> None:
    for tool in ("check", "latency", "calibrate"):
        fails("hub", tool, "RunAwy-v0", "--hub", "virtual", says="did you mean")
        fails("hub", tool, "RunAway-v0", "--hub", "pigeon", says="there is no hub 'pigeon'")
