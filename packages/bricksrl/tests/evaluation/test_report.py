"""The report of a run."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Never

import pytest

from bricksrl.errors import WriteError
from bricksrl.evaluation.evaluator import EvaluationResult, evaluate
from bricksrl.evaluation.report import _commands, labelled, rows, write_report
from bricksrl.evaluation.statistics import Interval
from bricksrl.training import TrainConfig, train
from bricksrl.training.run_folder import Origin


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("forward_speed_m_s", 0.0524649, ("forward speed", "0.05246 m/s")),
        ("forward_m", 1.416, ("forward", "1.416 m")),
        ("turned_deg", -38.1, ("turned", "-38.1 deg")),
        ("mean_yaw_rate_deg_s", 170.0, ("mean yaw rate", "170 deg/s")),
        ("final_distance_px", 162.2, ("final distance", "162.2 px")),
        ("straightness", 0.8, ("straightness", "0.8")),
    ],
)
def test_metrics_are_shown_with_their_units(
    name: str, value: float, shown: tuple[str, str]
) -> None:
    assert labelled(name, value) == shown


def test_success_and_return_have_their_intervals() -> None:
    result = EvaluationResult(
        run_dir="runs/away",
        env="RunAway-v0",
        agent="sac",
        hub="virtual",
        seed=0,
        episodes=5,
        trained_episodes=10,
        as_trained=True,
        return_mean=19.6,
        return_std=0.5,
        return_iqm=19.5,
        return_interval=Interval(19.25, 20.0),
        returns=(20.0, 20.0, 20.0, 19.0, 19.0),
        lengths=(20,) * 5,
        action_size=0.9,
        success_rate=1.0,
        success_interval=Interval(0.57, 1.0),
        metrics={},
    )
    assert list(rows(result)) == [
        ("return", "19.6 ± 0.5 (95 % interval of the mean: 19.25 to 20)"),
        ("success", "5 of 5 episodes (95 % interval of the rate: 57 % to 100 %)"),
    ]


@pytest.mark.parametrize(
    ("config", "longer", "on_robot"),
    [
        (TrainConfig("RunAway-v0"), "bricksrl resume 'my run' --episodes 80 --page", True),
        (TrainConfig("WalkerSim-v0"), "bricksrl resume 'my run' --episodes 80 --page", False),
        (
            TrainConfig("RunAway-v0", "bc", data="d", updates=100),
            "bricksrl train RunAway-v0 --demonstrations 'my run'",
            True,
        ),
    ],
)
def test_commands_suit_the_run(config: TrainConfig, longer: str, on_robot: bool) -> None:
    """A run that has learned from data cannot be resumed for longer, and a simulation has no
    hub."""
    origin = Origin(config.env, config.robot, config.agent, config.seed, bool(config.updates))
    text = _commands(Path("my run"), origin, 40)
    assert f"<code>{longer}</code>" in text and ("--hub ble" in text) is on_robot


@pytest.mark.skipif(sys.platform != "linux", reason="names are bytes there")
def test_folder_with_an_unreadable_name_gets_its_report(tmp_path: Path) -> None:
    """As "läuft" in a terminal whose locale is C."""
    result = train(
        TrainConfig(
            "WalkerSim-v0",
            "random",
            episodes=1,
            run_dir=tmp_path / os.fsdecode(b"l\xe4uft"),
            record=False,
        )
    )
    path, _ = write_report(result.run_dir, result.episodes, evaluate(result.run_dir, episodes=1))
    assert b"l\xe4uft" in path.read_bytes()


def test_disk_that_is_full_for_the_film_leaves_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> Never:
        raise WriteError("film.mp4: No space left on device; free some space")

    monkeypatch.setattr("bricksrl.evaluation.report.film_before_and_after", full)
    config = TrainConfig(
        "WalkerSim-v0", "random", episodes=1, run_dir=tmp_path / "run", record=False
    )
    result = train(config)
    evaluation = evaluate(result.run_dir, episodes=1)
    path, film = write_report(result.run_dir, result.episodes, evaluation)
    assert film == "none: film.mp4: No space left on device; free some space"
    assert "No space left on device" in path.read_text(encoding="utf-8")
