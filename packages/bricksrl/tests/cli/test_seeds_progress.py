"""Progress of several seeds, and what an interrupted tuning tells."""

from __future__ import annotations

from pathlib import Path

import pytest

from bricksrl.cli import main
from bricksrl.cli.progress import SeedsProgress, sparkline


def test_progress_lines_show_episodes_and_lost_workers(capsys: pytest.CaptureFixture[str]) -> None:
    with SeedsProgress(range(2), 3, live=False) as progress:
        progress.tell(0, {"started": 0, "pid": 1, "node": "one"})
        progress.tell(0, {"episode": 1, "return": 2.5})
        progress.tell(0, {"started": 1, "pid": 2, "node": "two"})
        progress.tell(0, {"evaluated": 7.0})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "seed 0  episode 1/3  return 2.5"
    assert lines[1] == "seed 0  its worker was lost; resumed after episode 1"
    assert lines[2].endswith("trained and evaluated  return 7")
    first, second = progress.tasks
    assert [first.description, second.description] == ["0", "1"] and [
        first.completed,
        second.completed,
    ] == [1, 0]
    assert (
        first.fields == {"value": "return 7", "state": "evaluated", "node": "two"}
        and second.fields["state"] == "waiting"
    )


def test_interrupted_tuning_tells_what_is_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def press() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bricksrl.cli.tune.load_learning", press)
    assert main(["tune", "RoboArmSim-v0", "--folder", str(tmp_path / "study")]) == 130
    assert capfd.readouterr().err == "interrupted: nothing was saved\n"


def test_seed_that_failed_is_shown_so_and_its_node_is_kept(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with SeedsProgress(range(5, 7), 3, live=False) as progress:
        progress.tell(6, {"started": 0, "node": "one"})
        progress.tell(6, {"error": "it is broken"})
        first, second = progress.tasks
        assert (first.description, second.description, second.total) == ("5", "6", 3)
        assert (second.fields["state"], second.fields["node"]) == ("failed", "one")
        progress.tell(5, {"evaluated": 1.0})
        assert first.fields["node"] == ""
    assert capsys.readouterr().out == "seed 5  trained and evaluated  return 1\n"


def test_sparkline_reaches_from_the_lowest_to_the_highest_bar() -> None:
    assert sparkline([0.0, 7.0]) == "▁█"
    assert sparkline([3.0, 3.0]) == "▅▅"
    bars = sparkline([float(value) for value in range(8)])
    assert list(bars) == sorted(set(bars)) and len(bars) == 8
