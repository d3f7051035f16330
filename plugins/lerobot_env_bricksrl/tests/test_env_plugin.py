"""Environments as LeRobot uses them, on the virtual hub."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("lerobot", reason="could not import 'lerobot'")

import gymnasium
import lerobot_env_bricksrl as plugin
import numpy as np
from lerobot.envs.configs import EnvConfig
from lerobot.envs.factory import make_env
from lerobot.envs.utils import env_to_policy_features, preprocess_observation

import bricksrl.interfaces.gymnasium

ACT = (
    *(
        "--policy.type=act",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--policy.pretrained_backbone_weights=null",
    ),
    *(
        "--policy.chunk_size=4",
        "--policy.n_action_steps=4",
        "--policy.n_heads=2",
        "--policy.dim_model=32",
    ),
    *(
        "--policy.dim_feedforward=64",
        "--policy.n_encoder_layers=1",
        "--policy.n_vae_encoder_layers=1",
        "--policy.latent_dim=4",
    ),
)


def one(task: str, **options: Any) -> tuple[EnvConfig, gymnasium.vector.VectorEnv]:
    config = EnvConfig.get_choice_class("bricksrl")(task=task, render_mode=None, **options)
    return config, make_env(config)["bricksrl"][0]


def own(folder: Path) -> str:
    (folder / "short.py").write_text(
        "from dataclasses import replace\n"
        "from bricksrl.envs.tasks.spinning import SPINNING\n"
        "TASK = replace(SPINNING, id='Short-v0', max_steps=3)\n"
    )
    return f"{folder / 'short.py'}:TASK"


@pytest.mark.parametrize("task", ["Walker-v0", "WalkerSim-v0", "RoboArm_mixed-v0"])
def test_features_are_what_a_policy_gets(task: str) -> None:
    config, envs = one(task)
    observation, _ = envs.reset(seed=[1])
    shapes = {
        key: tuple(value.shape[1:]) for key, value in preprocess_observation(observation).items()
    }
    features = {key: feature.shape for key, feature in env_to_policy_features(config).items()}
    assert shapes | {"action": envs.single_action_space.shape} == features
    assert envs.single_observation_space.contains(
        {"agent_pos": observation["agent_pos"][0]} | _images(observation)
    )
    assert envs.call("task") == (task,) and config.fps == envs.metadata["render_fps"]
    envs.close()


def _images(observation: dict[str, Any]) -> dict[str, Any]:
    return (
        {"pixels": {key: image[0] for key, image in observation["pixels"].items()}}
        if "pixels" in observation
        else {}
    )


def test_actions_are_commands_in_their_units() -> None:
    """Those of the robot of ``lerobot_robot_bricksrl``, so that a policy trained on its recordings
    can be evaluated."""
    _, envs = one("RunAway-v0")
    ours = bricksrl.interfaces.gymnasium.GymnasiumEnv("RunAway-v0")
    envs.reset(seed=[5])
    ours.reset(seed=5)
    for _ in range(3):
        theirs = envs.step(np.array([[50.0]], np.float32))
        again = ours.step(np.array([0.5], np.float32))
        assert (theirs[0]["agent_pos"][0] == again[0]).all() and theirs[1][0] == again[1]
    envs.close()
    ours.close()


def test_an_episode_of_an_own_task_ends_with_its_success(tmp_path: Path) -> None:
    _, envs = one(own(tmp_path))
    envs.reset(seed=[0])
    assert envs.call("_max_episode_steps") == (3,)
    for step in range(3):
        *_, truncated, info = envs.step(envs.action_space.sample())
        assert truncated[0] == (step == 2)
    assert info["final_info"]["is_success"].shape == (1,)
    envs.close()


def test_a_lost_link_is_no_success() -> None:
    env = plugin.BricksEnv("Walker-v0")
    env.reset(seed=0)
    env.unwrapped.env.twin.in_reach = lambda: False
    *_, truncated, info = env.step(np.zeros(4, np.float32))
    assert truncated and info == {"link_lost": True, "is_success": False}
    env.close()


def test_lerobots_own_command_evaluates_a_policy(tmp_path: Path) -> None:
    """Two processes, and a film of each episode."""
    env = (
        "--env.type=bricksrl",
        "--env.task=RoboArm_mixed-v0",
        "--eval.n_episodes=2",
        "--eval.batch_size=2",
    )
    line = [
        sys.executable,
        "-m",
        "lerobot.scripts.lerobot_eval",
        *env,
        *ACT,
        f"--output_dir={tmp_path}",
    ]
    done = subprocess.run(line, check=False, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads((tmp_path / "eval_info.json").read_text())["overall"]
    assert found["n_episodes"] == 2 and -100.0 < found["avg_sum_reward"] < 0.0
    assert all(
        (tmp_path / "videos" / "bricksrl_0" / f"eval_episode_{n}.mp4").stat().st_size > 3000
        for n in (0, 1)
    )
