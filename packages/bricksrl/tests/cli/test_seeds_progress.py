"""Progress of several seeds, and what an interrupted tuning tells."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from brickhub.files import quoted
from bricksrl.cli import main
from bricksrl.cli.progress import RunProgress, SeedsProgress, clock, sparkline
from bricksrl.errors import HubError
from bricksrl.training.callbacks import Episode, Phase, Progress, RobotState
from bricksrl.training.config import TrainConfig


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


def ended(number: int, **changes: Any) -> Episode:
    usual = {"steps": 40, "length": 20, "return_": 12.345678, "success": None}
    return Episode(number, **{"phase": Phase.TRAIN, **usual, **changes})


def test_a_run_without_a_terminal_tells_a_line_an_episode(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    progress = RunProgress()
    assert progress.saved() == "no episode was finished, so nothing was saved"
    config = TrainConfig("RunAway-v0", "sac", episodes=4, seed=3, run_dir=tmp_path)
    progress.on_start(config, tmp_path, 0)
    again = f"`bricksrl resume {quoted(tmp_path)}`"
    assert progress.saved() == f"no episode was finished; {again} begins again"
    at = Progress(episodes_total=4, steps_per_s=12.3456, remaining_s=3725.4)
    progress.on_episode(ended(1, phase=Phase.PREFILL), at)
    progress.on_episode(ended(2, robot="left", updates_per_step=2.0), at)
    assert progress.saved() == f"saved 2 episodes in {tmp_path}; {again} goes on"
    progress.on_start(replace(config, asynchronous=True), tmp_path, 2)
    progress.on_episode(ended(3, updates_per_step=1.5), replace(at, remaining_s=59.6))
    progress.on_episode(ended(4), replace(at, remaining_s=0.0))
    progress.on_catching_up(1)
    rate = "12.3 steps/s  1:02:05 left"
    start = f"sac on RunAway-v0, seed 3: {tmp_path}"
    assert capsys.readouterr().out.splitlines() == [
        start,
        f"episode 1/4  return 12.35  {rate}  (random start)",
        f"episode 2/4  return 12.35  left  {rate}",
        start,
        "episode 3/4  return 12.35  12.3 steps/s  1:00 left  1.5 updates/step",
        "episode 4/4  return 12.35  12.3 steps/s  0:00 left",
        "the robot is done; 1 update left to learn, Ctrl-C leaves out the rest",
    ]


def test_trouble_with_a_robot_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    progress = RunProgress()
    for length, reason in (
        (0, "no answer"),
        (0, "no answer"),
        (7, "no answer"),
        (0, "switched off"),
    ):
        progress.on_link_lost(3, length, HubError(reason))
    tries = "trying to reach it again, Ctrl-C ends it"
    assert capsys.readouterr().out.splitlines() == [
        f"the robot is out of reach (no answer); {tries}",
        f"the link broke in episode 3 after 7 steps (no answer); {tries}",
        f"the robot is out of reach (switched off); {tries}",
    ]
    for state in RobotState:
        progress.on_robot("left", state, "it is gone")
    assert capsys.readouterr().err.splitlines() == [
        "put left where an episode starts",
        "left has left: it is gone",
        "left is given up: it is gone",
    ]


@pytest.mark.parametrize(
    ("hub", "says"), [("virtual", ""), ("ble", "connecting to the robot (ble)\n")]
)
def test_a_real_robot_is_connected_to_with_a_note(
    capsys: pytest.CaptureFixture[str], hub: str, says: str
) -> None:
    progress, ready = RunProgress(hub), list[object]()
    progress.on_ready = ready.append
    progress.on_env("env")  # type: ignore[arg-type]
    assert ready == ["env"] and capsys.readouterr().err == says


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0:00"),
        (59.4, "0:59"),
        (59.6, "1:00"),
        (3599.0, "59:59"),
        (3600.0, "1:00:00"),
        (36_061.0, "10:01:01"),
    ],
)
def test_a_clock_has_hours_only_where_there_are_some(seconds: float, text: str) -> None:
    assert clock(seconds) == text


def rows_of(progress: SeedsProgress) -> list[list[str]]:
    """Words of the rows that a terminal shows."""
    console = Console(file=io.StringIO(), width=100)
    console.print(progress.get_renderable())
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return [line.split() for line in text.splitlines()]


def test_rows_of_seeds_show_what_each_does(capsys: pytest.CaptureFixture[str]) -> None:
    progress = SeedsProgress(range(5, 7), 3, live=True)
    assert rows_of(progress) == [
        ["seed", "5", "episode", "0/3", "waiting"],
        ["seed", "6", "episode", "0/3", "waiting"],
    ]
    assert [task.fields["value"] for task in progress.tasks] == ["", ""]
    progress.tell(5, {"started": 0, "node": "one"})
    progress.tell(5, {"episode": 2, "return": -1.23456})
    progress.tell(6, {"started": 0})
    assert rows_of(progress) == [
        ["seed", "5", "episode", "2/3", "return", "-1.235", "training", "one"],
        ["seed", "6", "episode", "0/3", "training"],
    ]
    progress.tell(6, {"error": "no light"})
    progress.tell(5, {"evaluated": 7.0})
    assert rows_of(progress) == [
        ["seed", "5", "episode", "2/3", "return", "7", "evaluated", "one"],
        ["seed", "6", "episode", "0/3", "failed"],
    ]
    assert capsys.readouterr().out == "", "a row tells it, and no line"


@pytest.mark.parametrize("is_terminal", [False, True])
def test_rows_are_for_a_terminal(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: is_terminal, raising=False)
    assert SeedsProgress(range(1), 3).disable is not is_terminal
    assert SeedsProgress(range(1), 3, live=True).disable is False
    assert SeedsProgress(range(1), 3, live=False).disable is True
