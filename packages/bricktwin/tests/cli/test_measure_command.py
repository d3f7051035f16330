"""``bricktwin twin measure``."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from ble_world import World

from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.transports.address import HubAddress
from bricktwin.measure import results, session
from bricktwin.measure.session import read_log
from bricktwin.twin.physics import read_physics


def test_nobody_is_asked_for_two_minutes_of_work_that_cannot_be_written(
    fails, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # Imported before, or it would keep this measurement for the tests that follow.
    for module in (results, session):
        monkeypatch.setattr(module, "measure", lambda *_: pytest.fail("it was measured"))
    (tmp_path / "file").write_text("an earlier one")
    out = str(tmp_path / "file" / "measured")
    fails("twin", "measure", "two-wheeler", "--out", out, says=f"cannot write {out}")


def test_measure_a_virtual_robot(bricktwin, fails, tmp_path: Path) -> None:
    (tmp_path / "hidden.json").write_text('{"gyro_scale_error_pct": 0.8, "distance_bias_mm": 25}')
    out = tmp_path / "measured"
    done = bricktwin(
        "twin",
        "measure",
        "two-wheeler",
        "--physics",
        str(tmp_path / "hidden.json"),
        "--out",
        str(out),
    )
    assert (done.code, done.err) == (0, "")
    assert "outside of what --randomize draws (distance_bias_mm)" in done.out
    physics = read_physics(out / "physics.json")
    assert physics.gyro_scale_error_pct == pytest.approx(0.8, abs=0.3)
    assert physics.distance_bias_mm == pytest.approx(25, abs=5)
    report = (out / "report.html").read_text()
    assert (
        "gyroscope, scale error" in report and report.count("<svg") == report.count("</svg>") == 1
    )
    assert "<main>" in report and "@media print" in report, "the look of a run's report"
    assert not re.search(r"\de[+-]\d\d", done.out + re.sub(r'd="[^"]*"', "", report)), (
        "numbers without exponents"
    )
    assert read_log(out / "log.jsonl").about["hub"] == "virtual"
    again = tmp_path / "again"
    fails("twin", "measure", "robo-arm", "--out", str(again), says="cannot be taken in hand")
    fitted = tmp_path / "fitted.json"
    fitted.write_text("{}")
    fails(
        "twin",
        "measure",
        "two-wheeler",
        "--hub",
        "ble",
        "--physics",
        str(fitted),
        "--out",
        str(again),
        says="its own physics",
    )


@pytest.fixture
def short(world: World, monkeypatch: pytest.MonkeyPatch) -> World:
    """A hub over the simulated radio, and a session of seconds."""

    def link(*arguments) -> HubLink:
        made = HubLink(*arguments)
        world.hub.library.append(made.program.source)
        return made

    for name in ("_REST_S", "_TURNED_S", "_LIFTED_S", "_WALL_S", "_HELD_S"):
        monkeypatch.setattr(session, name, 0.5)
    monkeypatch.setattr(session, "HubLink", link)
    monkeypatch.setattr(HubAddress, "transport", lambda self, *_: world.transport())
    return world


MEASURE = ("twin", "measure", "two-wheeler", "--hub", "ble", "--out")


@pytest.mark.realtime
def test_a_person_who_presses_enter_over_bluetooth(
    bricktwin, short: World, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pressed = io.StringIO("\n" * 9)
    monkeypatch.setattr("sys.stdin", pressed)
    done = bricktwin(*MEASURE, str(tmp_path))
    assert done.code == 0
    assert done.err.count("Then press Enter.") == 9 and pressed.read() == ""
    log = read_log(tmp_path / "log.jsonl")
    assert {row.phase for row in log.rows} >= {
        "rest",
        "turned",
        "wall",
        "aslant",
        "free left",
        "back right",
        "held right",
    }
    assert any(abs(row.values["left_angle"]) > 300 for row in log.rows if row.phase == "free left")
    assert not short.hub.is_driven and not short.hub.is_running


@pytest.mark.realtime
def test_the_robot_is_let_go_if_nobody_is_there(bricktwin, short: World, tmp_path: Path) -> None:
    done = bricktwin(*MEASURE, str(tmp_path))
    assert (done.code, done.out) == (2, "")
    assert (
        done.err.splitlines()[-1]
        == "error: nobody is there to handle the robot: standard input ended; run it in a terminal"
    )
    assert not short.hub.is_driven and not short.hub.is_running
