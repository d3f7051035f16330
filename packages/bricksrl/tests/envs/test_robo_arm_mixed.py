"""The arm with an image of its goal."""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from forked import ForkServer
from gymnasium.utils.env_checker import check_env
from tensordict import TensorDictBase
from torchrl.envs import check_env_specs
from toys import assert_equal

import bricksrl
from bricksrl.agents import preset
from bricksrl.cli import main
from bricksrl.data.summary import summarise
from bricksrl.envs import get_task
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.robo_arm_mixed import GOAL
from bricksrl.errors import RenderingUnavailableError
from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint
from bricksrl.training.config import settings_for

ID = "RoboArm_mixed-v0"
# Angle of the joint "high", and how far the ball is then from the middle of the frame.
HIGH_DEG, RADIUS_PX = (-140, -95, -70, -40, 7), (97, 141, 163, 192, 219)


@pytest.fixture(scope="module", autouse=True)
def _opengl() -> None:
    env = bricksrl.make(ID)
    try:
        env.reset()
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    finally:
        env.close()


def random_actions(seed: int = 1) -> Callable[[TensorDictBase], TensorDictBase]:
    generator = torch.Generator().manual_seed(seed)
    return lambda td: td.set("action", torch.rand(3, generator=generator) * 2 - 1)


def steer(env: HubEnv) -> Callable[[TensorDictBase], TensorDictBase]:
    """Turn and stretch the arm towards the green disc in the image."""

    def act(td: TensorDictBase) -> TensorDictBase:
        red, green, blue = td["image"].int().unbind(-1)
        rows, columns = torch.nonzero((green > red + 100) & (green > blue + 100), as_tuple=True)
        right, down = (columns.float().mean() - 31.5) * 10, (rows.float().mean() - 31.5) * 7.5
        turn_deg = (math.degrees(math.atan2(right, down)) - td["observation"][0] + 180) % 360 - 180
        high_deg = np.interp(math.hypot(right, down), RADIUS_PX, HIGH_DEG) - td["observation"][2]
        return td.set(
            "action", torch.tensor([0.7 * turn_deg / 90, 0.0, high_deg / 60]).clamp(-1, 1)
        )

    return act


def short(steps: int = 6) -> HubEnv:
    """Episodes of a few steps."""
    env = bricksrl.make(ID)
    assert isinstance(env, HubEnv)
    env.task = replace(env.task, max_steps=steps)
    return env


def test_specs() -> None:
    env = bricksrl.make(ID, seed=0)
    check_env_specs(env)
    assert env.observation_spec["observation"].low.tolist() == [0, 10, -150]
    assert env.observation_spec["observation"].high.tolist() == [360, 70, 10]
    assert env.observation_spec["image"].shape == (64, 64, 3)
    assert env.observation_spec["image"].dtype == torch.uint8
    assert env.action_spec.shape == (3,)
    env.close()


def test_as_in_the_paper() -> None:
    task = get_task(ID)
    assert task.max_steps == 30
    assert [(c.low, c.high, c.speed_deg_s) for c in task.interface.commands] == [
        (-90, 90, 250),
        (-30, 30, 250),
        (-60, 60, 250),
    ]
    assert len(set(GOAL.places)) == 26
    assert all(
        math.hypot(x - 320, y - 240) == pytest.approx(200, abs=1.5) and y >= 240
        for x, y in GOAL.places
    )
    assert (GOAL.jitter_px, GOAL.radius_px, GOAL.red.area_px) == ((25, 20), 25, 10)


def test_rewards_and_ends_from_image() -> None:
    dense, sparse = get_task(ID), get_task(ID, sparse=True)
    seen = torch.tensor([[0.0, 40, -70, 250, 250], [0, 40, -70, 120, 40], [0, 40, -70, 120, 800]])
    action = torch.zeros(3, 3)
    assert dense.reward(seen, action, seen)[:, 0].tolist() == pytest.approx([-2.5, -1.2, -1.2])
    assert sparse.reward(seen, action, seen)[:, 0].tolist() == [0, 1, 0]
    assert (
        dense.terminated(seen)[:, 0].tolist()
        == sparse.terminated(seen)[:, 0].tolist()
        == [False, True, False]
    )
    assert dense.success(seen[None]).tolist() == [False]
    assert dense.success(seen[None, :2]).tolist() == [True]
    assert dense.metrics(seen[None, :2])["final_distance_px"].tolist() == [40]


def test_equal_seeds_give_identical_runs() -> None:
    env, other = bricksrl.make(ID, seed=3), bricksrl.make(ID, seed=4)
    first = env.rollout(6, random_actions(), break_when_any_done=False)
    env.set_seed(3)
    assert (env.rollout(6, random_actions(), break_when_any_done=False) == first).all()
    assert not torch.equal(other.reset()["image"], first["image"][0])
    env.close()
    other.close()


def test_scripted_policy_brings_ball_to_goal() -> None:
    env = bricksrl.make(ID, seed=0)
    gains, arrived = [], []
    for _ in range(6):
        steps = env.rollout(30, steer(env))
        rewards = steps["next", "reward"][:, 0]
        judged = env.task_observations(steps["next", "observation"])
        assert torch.allclose(rewards, -judged[:, -2] / 100)
        gains.append((rewards[-1] - rewards[0]).item())
        arrived.append(bool(env.task.success(judged)))
        assert steps["next", "terminated"][-1].item() == arrived[-1] == (rewards[-1].item() >= -0.4)
    assert all(arrived)
    assert max(gains) > 1
    assert min(gains) >= 0
    env.close()


def test_the_image_shows_ball_and_goal_in_their_colours() -> None:
    env = bricksrl.make(ID, seed=0)
    images = torch.stack([env.reset()["image"] for _ in range(4)]).int()
    red, green, blue = images.unbind(-1)
    assert ((red > green + 100) & (red > blue + 100)).flatten(1).sum(1).min() > 5
    discs = (green > red + 100) & (green > blue + 100)
    assert 10 < discs.flatten(1).sum(1).min() <= discs.flatten(1).sum(1).max() < 50
    assert (discs[0] != discs[1]).any()  # another goal each time
    env.close()


def test_gymnasium() -> None:
    env = gymnasium.make(f"bricksrl/{ID}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    observation, _ = env.reset(seed=0)
    assert observation["image"].shape == (64, 64, 3)
    ended, steps = False, 0
    while not ended:
        observation, _, terminated, truncated, info = env.step(
            np.array([0.0, 0.0, -1.0], np.float32)
        )
        ended, steps = terminated or truncated, steps + 1
    assert info["success"] is terminated
    assert info["final_distance_px"] > 0
    env.close()


def test_random_agent_needs_no_images(tmp_path: Path) -> None:
    env = short()
    result = train(
        TrainConfig(ID, agent="random", episodes=2, run_dir=tmp_path / "random"), env=env
    )
    assert all(episode.success is not None for episode in result.episodes)
    outcome = evaluate(tmp_path / "random", env, episodes=2)
    assert outcome.metrics["final_distance_px"] > 0
    assert outcome.success_rate is not None


@pytest.mark.parametrize("agent", ["sac", pytest.param("td3", marks=pytest.mark.slow)])
def test_resumed_run_equals_uninterrupted(agent: str, tmp_path: Path) -> None:
    settings = replace(
        preset("default", agent, images=True), hidden=(16,), batch_size=8, prefill_episodes=1
    )
    whole = TrainConfig(
        ID, agent, episodes=3, seed=2, settings=settings, run_dir=tmp_path / "whole"
    )
    one = train(whole, env=short(3))
    train(replace(whole, episodes=2, run_dir=tmp_path / "parts"), env=short(3))
    other = resume(tmp_path / "parts", episodes=3, env=short(3))
    assert [episode.return_ for episode in one.episodes] == [
        episode.return_ for episode in other.episodes
    ]
    recorded = tmp_path / "recorded"
    # it sees too
    assert (
        main(
            ("record", ID, "--policy", str(one.run_dir), "--episodes", "1", "--out", str(recorded))
        )
        == 0
    )
    assert summarise(recorded).episodes == 1
    states = [
        load_checkpoint(path / "checkpoint.bin")["agent"] for path in (one.run_dir, other.run_dir)
    ]
    assert states[0]["memory"]["rows"]["image"].dtype == torch.uint8
    assert_equal(*states)


@pytest.mark.slow
def test_asynchronous_run_with_images(tmp_path: Path) -> None:
    settings = replace(
        preset("default", "sac", images=True), hidden=(16,), batch_size=8, prefill_episodes=1
    )
    config = TrainConfig(
        ID, episodes=3, settings=settings, asynchronous=True, run_dir=tmp_path / "run"
    )
    result = train(config, env=short())
    assert result.episodes[-1].measures
    state = load_checkpoint(result.run_dir / "checkpoint.bin")["agent"]
    assert 0 < state["updates"] <= sum(episode.length for episode in result.episodes[1:])
    assert len(state["memory"]["rows"]["image"]) == result.episodes[-1].steps
    evaluate(result.run_dir, short(), episodes=1)


def test_image_settings_are_saved(tmp_path: Path) -> None:
    for name in ("default", "paper"):
        config = TrainConfig(ID, settings=settings_for(ID, name, "sac"))
        assert config.settings.encoder == ("keypoints" if name == "default" else "convolutions")
        assert TrainConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    assert TrainConfig(ID).settings == preset("default", "sac", images=True)


@pytest.mark.slow
def test_sac_learns_to_bring_the_ball_to_the_disc(tmp_path: Path) -> None:
    """One seed only shows that it learns (random actions: 28 %); `benchmarks/camera_learning.py`
    has the rate."""
    train(TrainConfig(ID, episodes=80, run_dir=tmp_path / "run"))
    success = evaluate(tmp_path / "run", episodes=50).success_rate
    assert success is not None
    assert success >= 0.65


def test_raycast_image_without_opengl(forked: ForkServer, tmp_path: Path) -> None:
    program = (
        "import bricksrl, torch\ntorch.manual_seed(1)\n"
        f"steps = bricksrl.make('{ID}', seed=5).rollout(3)\n"
    )
    program += "print(steps['next', 'reward'][0].item(), steps['image'][0].float().mean().item())"
    done = forked.run((), tmp_path, {**os.environ, "MUJOCO_GL": "disable"}, 120.0, script=program)
    cast_reward, cast_light = (float(number) for number in done.stdout.split())
    with torch.random.fork_rng():
        torch.manual_seed(1)
        steps = bricksrl.make(ID, seed=5).rollout(3)
    assert cast_reward == pytest.approx(steps["next", "reward"][0].item(), abs=0.06)
    assert 0 < abs(cast_light - steps["image"][0].float().mean().item()) < 10
