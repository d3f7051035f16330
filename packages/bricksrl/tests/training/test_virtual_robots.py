"""Training on virtual robots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from bricksrl.agents.sac import SACSettings
from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint


def weights(run_dir: Path) -> list[torch.Tensor]:
    return list(load_checkpoint(run_dir / "checkpoint.bin")["agent"]["policy"].values())


@pytest.mark.parametrize("env", ["RunAway-v0", "Spinning-v0"])
def test_resumed_run_equals_uninterrupted(env: str, tmp_path: Path) -> None:
    settings = SACSettings(hidden=(8,), batch_size=8, prefill_episodes=1, updates_per_step=0.1)
    whole = TrainConfig(env=env, episodes=3, seed=2, settings=settings, run_dir=tmp_path / "whole")
    one = train(whole)
    train(replace(whole, episodes=2, run_dir=tmp_path / "parts"))
    other = resume(tmp_path / "parts", episodes=3)
    assert [episode.return_ for episode in one.episodes] == [
        episode.return_ for episode in other.episodes
    ]
    assert all(
        torch.equal(a, b) for a, b in zip(weights(one.run_dir), weights(other.run_dir), strict=True)
    )
    assert evaluate(one.run_dir, episodes=1).returns == evaluate(other.run_dir, episodes=1).returns


@pytest.mark.slow
def test_the_default_settings_learn_to_run_away(tmp_path: Path) -> None:
    result = train(TrainConfig(env="RunAway-v0", episodes=12, run_dir=tmp_path / "run"))
    assert evaluate(result.run_dir, episodes=3).return_mean >= 15.0
