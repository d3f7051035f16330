"""Several seeds in parallel."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from killed import assert_runs_end_with

from bricksrl.agents.sac import SACSettings
from bricksrl.child_process import ChildProcess
from bricksrl.errors import RunError
from bricksrl.evaluation import multi_seed
from bricksrl.evaluation.multi_seed import train_seeds
from bricksrl.training import RunFolder, TrainConfig, train

pytestmark = pytest.mark.usefixtures("forked_children")

SMALL = SACSettings(hidden=(16,), batch_size=16, prefill_episodes=1, updates_per_step=1)


def test_seeds_equal_single_runs(tmp_path: Path) -> None:
    few = TrainConfig("WalkerSim-v0", episodes=2, settings=SMALL, options={"step_ms": 1000})
    config = replace(few, seed=3, run_dir=tmp_path / "all")
    heard: list[tuple[int, str]] = []
    group = train_seeds(
        config, 2, on_line=lambda seed, message: heard.append((seed, next(iter(message))))
    )
    assert sorted(heard) == [
        (seed, kind) for seed in (3, 4) for kind in ("episode", "episode", "evaluated")
    ]
    assert group.seeds == (3, 4)
    assert group.interval is None, "two seeds say too little"
    assert len(group.curves) == 2 and group.scores[0] != group.scores[1]
    summary = json.loads((tmp_path / "all" / "summary.json").read_text())
    assert summary["scored_by"] == "evaluation" and summary["groups"][0]["scores"] == list(
        group.scores
    )
    assert (tmp_path / "all" / "learning_curves.png").read_bytes().startswith(b"\x89PNG")
    alone = train(replace(few, seed=4, run_dir=tmp_path / "alone"))
    together = RunFolder(tmp_path / "all" / "seed-4").read_episodes()
    assert [episode.return_ for episode in together] == [
        episode.return_ for episode in alone.episodes
    ]


def test_failing_seed_raises_one_line(tmp_path: Path) -> None:
    config = TrainConfig(
        "RoboArmSim-v0", realtime=True, episodes=1, settings=SMALL, run_dir=tmp_path / "all"
    )
    with pytest.raises(
        RunError, match="2 of 2 seeds failed; seed 0: RoboArmSim-v0 is simulated without a robot"
    ):
        train_seeds(config, 2)
    assert not (tmp_path / "all").exists(), "it can be tried again"
    (tmp_path / "all").mkdir()
    with pytest.raises(RunError, match="exists already"):
        train_seeds(config, 2)
    with pytest.raises(RunError, match="seeds is 1; give 2 to 1000"):
        train_seeds(config, 1)
    with pytest.raises(RunError, match="seeds is 1000000; give 2 to 1000"):
        train_seeds(config, 1_000_000)
    with pytest.raises(RunError, match="one robot"):
        train_seeds(TrainConfig("Walker-v0", hub="ble", run_dir=tmp_path / "robot"), 2)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[ChildProcess]:
    """Processes of the seeds."""
    processes: list[ChildProcess] = []

    class Noted(ChildProcess):
        def __init__(self, *args: Any, **variables: str) -> None:
            super().__init__(*args, **variables)
            processes.append(self)

    monkeypatch.setattr(multi_seed, "ChildProcess", Noted)
    return processes


def test_killed_seed_is_an_error(tmp_path: Path, started: list[ChildProcess]) -> None:
    config = TrainConfig("RoboArmSim-v0", episodes=200, settings=SMALL, run_dir=tmp_path / "all")
    with pytest.raises(
        RunError, match=r"2 of 2 seeds failed; seed 0: its process ended with exit code -?\d+"
    ):
        train_seeds(config, 2, jobs=1, on_line=lambda seed, message: started[seed].end())
    assert RunFolder(tmp_path / "all" / "seed-0").read_episodes(), "what was learned is kept"


def test_interrupted_seeds_end_by_themselves(tmp_path: Path, started: list[ChildProcess]) -> None:
    def interrupt(seed: int, message: dict[str, Any]) -> None:
        raise KeyboardInterrupt

    config = TrainConfig("RoboArmSim-v0", episodes=10_000, settings=SMALL, run_dir=tmp_path / "all")
    with pytest.raises(KeyboardInterrupt):
        train_seeds(config, 3, jobs=1, on_line=interrupt)
    assert {process.wait(0) for process in started} == {1}, "not killed"


@pytest.mark.slow
def test_seeds_end_with_a_program_that_is_killed(tmp_path: Path) -> None:
    run = [
        "train",
        "RoboArmSim-v0",
        "--agent",
        "random",
        "--episodes",
        "1000000",
        "--seeds",
        "2",
        "--run",
        str(tmp_path / "all"),
    ]
    assert_runs_end_with(run, tmp_path)


def test_several_seeds_are_two_to_a_limit() -> None:
    for count in (2, multi_seed.MAX_SEEDS):
        multi_seed.check_count(count)
    for count in (0, 1, multi_seed.MAX_SEEDS + 1):
        with pytest.raises(RunError, match=f"^seeds is {count}; give 2 to {multi_seed.MAX_SEEDS}"):
            multi_seed.check_count(count)
