"""Learning of the default settings in simulations within few steps."""

from __future__ import annotations

from pathlib import Path

import pytest

from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train


@pytest.mark.slow
def test_the_arm_reaches_its_goals_after_500_steps(tmp_path: Path) -> None:
    result = train(TrainConfig("RoboArmSim-v0", episodes=60, run_dir=tmp_path / "run"))
    assert result.episodes[-1].steps <= 500
    assert evaluate(result.run_dir, episodes=40).success_rate >= 0.95


@pytest.mark.slow
def test_the_walker_trots_after_10_episodes(tmp_path: Path) -> None:
    result = train(TrainConfig("WalkerSim-v0", episodes=10, run_dir=tmp_path / "run"))
    assert evaluate(result.run_dir, episodes=20).return_mean >= -20.0
