"""Summaries of datasets: counts, rates and what a reader is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from toy_data import TOY, steps

from bricksrl.data import About, Recorder, load
from bricksrl.data.summary import summarise

EPISODES = (
    (3, About(policy="sac", success=True)),
    (2, About(policy="random", success=False, whole=False)),
    (5, About(policy="sac", success=None)),
    (4, About(policy="sac", success=True)),
)


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    root = tmp_path / "set"
    with Recorder(root, TOY) as recorder:
        for seed, (length, about) in enumerate(EPISODES):
            recorder.write(steps(seed, length), about)
    return root


def test_counts_are_those_of_the_episodes(recorded: Path) -> None:
    summary = summarise(recorded)
    returns = [row.return_ for row in load(recorded).rows]
    assert (summary.episodes, summary.transitions, summary.broken_off) == (4, 14, 1)
    assert summary.length_mean == 3.5
    assert summary.success_rate == pytest.approx(2 / 3), "of those that were judged"
    assert summary.policies == {"sac": 3, "random": 1}
    assert (summary.return_min, summary.return_max) == (min(returns), max(returns))
    assert summary.interventions == 1 + 1 + 2 + 2, "every third step is by hand"
    assert json.loads(summary.to_json())["broken_off"] == 1


def test_reader_is_told_what_there_is(recorded: Path) -> None:
    rows = dict(summarise(recorded).rows())
    assert rows["episodes"] == "4, broken off 1"
    assert rows["policy"] == "sac (3), random (1)"
    assert rows["success"] == "67 %"
    assert rows["steps an episode"] == "3.5"
    assert rows["robot"] == "toy" and rows["steps a second"] == "4"


def test_task_without_success_has_no_rate(tmp_path: Path) -> None:
    with Recorder(tmp_path / "set", TOY) as recorder:
        recorder.write(steps(0, 3), About(policy="random"))
    summary = summarise(tmp_path / "set")
    assert summary.success_rate is None
    assert "success" not in dict(summary.rows())
