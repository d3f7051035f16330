"""The Gymnasium interface."""

from __future__ import annotations

import subprocess
import sys
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from torchrl.envs import GymEnv
from torchrl.envs.utils import check_env_specs

import bricksrl
from bricksrl.errors import RenderingUnavailableError

IDS = pytest.mark.parametrize("env_id", ["RunAway-v0", "Spinning-v0"])


@IDS
def test_gymnasium_checker_passes(env_id: str) -> None:
    env = gymnasium.make(f"bricksrl/{env_id}").unwrapped
    env.reset()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    env.close()


def test_simulation_offers_no_pictures() -> None:
    env = gymnasium.make("bricksrl/WalkerSim-v1").unwrapped
    check_env(env)
    env.close()
    with pytest.raises(TypeError, match="WalkerSim-v1 simulates no body that could be drawn; omit render_mode"):
        gymnasium.make("bricksrl/WalkerSim-v1", render_mode="rgb_array")  # Stable-Baselines3 tries it out


@pytest.mark.parametrize("named", [{"batch_size": 8}, {"device": "cuda"}])
def test_simulation_is_one_environment_on_the_cpu(named: dict[str, Any]) -> None:
    remedy = "omit batch_size and device, or use bricksrl.make"
    with pytest.raises(TypeError, match=f"WalkerSim-v1 is one environment on the CPU; {remedy}"):
        gymnasium.make("bricksrl/WalkerSim-v1", **named)


@pytest.mark.parametrize(("env_id", "fps"), [("Walker-v1", 4), ("Park-v0", 5), ("LineFollow-v0", 17), ("RunAway-v0", 1)])
def test_recorded_films_take_as_long_as_the_robot(env_id: str, fps: int) -> None:
    env = gymnasium.make(f"bricksrl/{env_id}")
    assert env.metadata["render_fps"] == fps
    env.close()


@IDS
def test_torchrl_wraps_gymnasium_env(env_id: str) -> None:
    """TorchRL first tries a rare option."""
    env = GymEnv(f"bricksrl/{env_id}")
    check_env_specs(env)
    env.close()
    with pytest.raises(TypeError, match="no option colour"):
        gymnasium.make(f"bricksrl/{env_id}", colour="red")


def test_spaces_cover_hub_range() -> None:
    run_away, spinning = gymnasium.make("bricksrl/RunAway-v0"), gymnasium.make("bricksrl/Spinning-v0")
    assert run_away.observation_space == gymnasium.spaces.Box(
        np.array([0, 0, -90, -90, 0], np.float32), np.array([360, 360, 90, 90, 2000], np.float32)
    )
    assert spinning.observation_space.high[4] == pytest.approx(3276.7)
    assert spinning.action_space == gymnasium.spaces.Box(-1, 1, (2,))


def test_gymnasium_episode_equals_torchrl() -> None:
    env = gymnasium.make("bricksrl/Spinning-v0")
    observation, info = env.reset(seed=5)
    reference = bricksrl.make("Spinning-v0", seed=5)
    td = reference.reset()
    assert info == {}
    turn = np.array([-1, 1] if observation[5] == 0 else [1, -1], dtype=np.float32)
    assert np.array_equal(observation, td["observation"].numpy())
    rewards = []
    for step in range(50):
        observation, reward, terminated, truncated, info = env.step(turn)
        td = reference.step(td.set("action", torch.from_numpy(turn)))["next"]
        assert np.array_equal(observation, td["observation"].numpy())
        assert reward == td["reward"].item()
        assert (terminated, truncated) == (False, step == 49)
        assert ("success" in info) is (step == 49)
        rewards.append(reward)
    assert info["mean_yaw_rate_deg_s"] == pytest.approx(np.mean(rewards), rel=1e-4)
    assert info["success"] is True
    env.close()


def test_drawing() -> None:
    env = gymnasium.make("bricksrl/RunAway-v0", render_mode="rgb_array")
    env.reset(seed=0)
    try:
        image = env.render()
    except RenderingUnavailableError:
        pytest.skip("no OpenGL library is here")
    assert image.shape == (240, 320, 3)
    assert image.dtype == np.uint8
    assert image.std() > 5
    env.step(np.array([-1], dtype=np.float32))
    assert (env.render() != image).any()
    env.reset(seed=0)
    assert np.array_equal(env.render(), image)
    env.close()


def test_first_version_of_spec_gives_no_warning() -> None:
    """As our documentation says; by its id, Gymnasium calls it out of date."""
    with pytest.warns(DeprecationWarning, match="out of date"):
        gymnasium.make("bricksrl/Walker-v0").close()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium.make(gymnasium.spec("bricksrl/Walker-v0")).close()


def test_gymnasium_make_by_both_names() -> None:
    """After ``import bricksrl``, and by naming the module in the id."""
    program = "import gymnasium; gymnasium.make('bricksrl:bricksrl/RunAway-v0').reset(); print('fine')"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False, timeout=120
    )
    assert (done.stdout.strip(), done.stderr) == ("fine", "")


def test_simulation_is_vectorized_as_one_batch() -> None:
    envs = gymnasium.make_vec("bricksrl/RoboArmSim-v0", num_envs=64)
    reference = bricksrl.make("RoboArmSim-v0", seed=3, batch_size=64)
    assert type(envs.unwrapped.env) is type(reference) and envs.observation_space.shape == (64, 8)
    observation, info = envs.reset(seed=3)
    state, ended, rng, successes = reference.reset(), np.zeros(64, bool), np.random.default_rng(0), 0
    assert info == {} and np.array_equal(observation, state["observation"].numpy())
    for _ in range(250):
        action = rng.uniform(-1, 1, (64, 4)).astype(np.float32)
        before = ended
        observation, reward, terminated, truncated, info = envs.step(action)
        assert envs.observation_space.contains(observation) and reward.shape == terminated.shape == truncated.shape == (64,)
        state["action"] = torch.from_numpy(action)
        result = reference.step(state)["next"]
        if before.any():
            result = reference.maybe_reset(result.set("done", torch.from_numpy(before)[:, None]))
            assert not reward[before].any() and not terminated[before].any() and not truncated[before].any()
        assert np.array_equal(observation, result["observation"].numpy())
        assert np.array_equal(reward[~before], result["reward"][:, 0].numpy()[~before])
        ended = terminated | truncated
        assert np.array_equal(info.get("_success", np.zeros(64, bool)), ended)
        assert not ended.any() or np.array_equal(info["success"], terminated)
        successes += terminated.sum()
        state = result.exclude("reward", "done", "terminated", "truncated")
    assert successes > 0
    envs.close()


def test_vector_environment_has_a_time_limit() -> None:
    envs = gymnasium.make_vec("bricksrl/WalkerSim-v1", num_envs=2, max_episode_steps=3)
    envs.reset()
    truncated = [envs.step(envs.action_space.sample())[3].tolist() for _ in range(8)]
    assert truncated == [[step in (2, 6)] * 2 for step in range(8)]  # a step between episodes resets
    robots = gymnasium.make_vec("bricksrl/RunAway-v0", num_envs=2)
    assert isinstance(robots, gymnasium.vector.SyncVectorEnv)
    robots.close()


def test_vector_environment_refuses_what_a_batch_cannot_do() -> None:
    with pytest.raises(TypeError, match="omit render_mode"):
        gymnasium.make_vec("bricksrl/WalkerSim-v1", 4, render_mode="rgb_array")
    with pytest.raises(TypeError, match="one seed"):
        gymnasium.make_vec("bricksrl/WalkerSim-v1", 4).reset(seed=[1, 2, 3, 4])
