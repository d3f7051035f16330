"""Trained policies in Python."""

from __future__ import annotations

import pickle
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bricksrl
from bricksrl.agents import preset
from bricksrl.envs import register
from bricksrl.errors import DescriptionError
from bricksrl.policies import load_policy
from bricksrl.policies.policy import Policy
from bricksrl.training import TrainConfig, resume, train


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    small = replace(preset("default", "sac"), hidden=(16,))
    folder = tmp_path_factory.mktemp("runs") / "arm"
    return train(
        TrainConfig("RoboArmSim-v0", episodes=1, settings=small, run_dir=folder, record=False)
    ).run_dir


def test_policy_can_be_pickled(run_dir: Path) -> None:
    policy, observation = load_policy(run_dir), np.linspace(0.0, 90.0, 8)
    copied: Policy = pickle.loads(pickle.dumps(policy))  # noqa: S301
    np.testing.assert_array_equal(copied.act(observation), policy.act(observation))


@pytest.mark.parametrize("shape", [(), (7,), (8, 1)])
def test_observation_of_another_size_raises(run_dir: Path, shape: tuple[int, ...]) -> None:
    with pytest.raises(
        DescriptionError, match=r"takes observations of 8 numbers; give \[\*batch, 8\]"
    ):
        load_policy(run_dir).act(np.zeros(shape))


def test_policy_of_another_environment_raises(run_dir: Path) -> None:
    for env_id in ("WalkerSim-v0", "RunAway-v0"):
        with (
            closing(bricksrl.make(env_id)) as env,
            pytest.raises(DescriptionError, match="takes observations of 8 numbers"),
        ):
            env.rollout(1, load_policy(run_dir))


def test_unknown_checkpoint_raises(run_dir: Path) -> None:
    with pytest.raises(DescriptionError, match="which is 'newest'; choose last or best"):
        load_policy(run_dir, which="newest")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "use",
    [
        lambda: bricksrl.evaluate(None),  # type: ignore[arg-type]
        lambda: load_policy(None),  # type: ignore[arg-type]
        lambda: resume(3),  # type: ignore[arg-type]
        lambda: register("x"),  # type: ignore[arg-type]
    ],
)
def test_values_of_another_type_raise(use: Any) -> None:
    with pytest.raises(DescriptionError, match=r"^(run|path|task) is .*; give ") as caught:
        use()
    assert "\n" not in str(caught.value)
