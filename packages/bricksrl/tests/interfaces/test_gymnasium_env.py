"""The Gymnasium interface."""

from __future__ import annotations

import copy
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from forked import ForkServer, Scratch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs

import bricksrl
from bricksrl.errors import (
    BricksError,
    DescriptionError,
    RenderingUnavailableError,
    UnknownOptionError,
)
from bricksrl.interfaces.gymnasium import GoalObservation, GymnasiumEnv

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
    with pytest.raises(
        TypeError, match="WalkerSim-v1 simulates no body that could be drawn; omit render_mode"
    ):
        # Stable-Baselines3 tries it out
        gymnasium.make("bricksrl/WalkerSim-v1", render_mode="rgb_array")


@pytest.mark.parametrize("named", [{"batch_size": 8}, {"device": "cuda"}])
def test_simulation_is_one_environment_on_the_cpu(named: dict[str, Any]) -> None:
    remedy = "omit batch_size and device, or use bricksrl.make"
    with pytest.raises(TypeError, match=f"WalkerSim-v1 is one environment on the CPU; {remedy}"):
        gymnasium.make("bricksrl/WalkerSim-v1", **named)


@pytest.mark.parametrize(
    ("env_id", "fps"), [("Walker-v2", 10), ("Park-v0", 5), ("LineFollow-v0", 17), ("RunAway-v0", 1)]
)
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
    run_away, spinning = (
        gymnasium.make("bricksrl/RunAway-v0"),
        gymnasium.make("bricksrl/Spinning-v0"),
    )
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
        assert info["success"] is info["is_success"]
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


def test_gymnasium_make_by_both_names(processes: ForkServer | Scratch, tmp_path: Path) -> None:
    """After ``import bricksrl``, and by naming the module in the id: with new modules of ours and
    of Gymnasium; what these import costs most."""
    program = (
        "import sys, warnings; warnings.simplefilter('error')\n"
        "for name in [*sys.modules]:\n"
        "    if name.partition('.')[0] in ('brickhub', 'bricktwin', 'bricksrl', 'gymnasium'):\n"
        "        del sys.modules[name]\n"
        "import gymnasium; gymnasium.make('bricksrl:bricksrl/RunAway-v0').reset(); print('fine')"
    )
    done = processes.run((), tmp_path, os.environ, 120.0, program)
    assert (done.stdout.strip(), done.stderr) == ("fine", "")


def test_simulation_is_vectorized_as_one_batch() -> None:
    envs = gymnasium.make_vec("bricksrl/RoboArmSim-v0", num_envs=64)
    reference = bricksrl.make("RoboArmSim-v0", seed=3, batch_size=64)
    assert type(envs.unwrapped.env) is type(reference) and envs.observation_space.shape == (64, 8)
    observation, info = envs.reset(seed=3)
    state, ended, rng, successes = (
        reference.reset(),
        np.zeros(64, bool),
        np.random.default_rng(0),
        0,
    )
    assert info == {} and np.array_equal(observation, state["observation"].numpy())
    for _ in range(250):
        action = rng.uniform(-1, 1, (64, 4)).astype(np.float32)
        before = ended
        observation, reward, terminated, truncated, info = envs.step(action)
        assert envs.observation_space.contains(
            observation
        ) and reward.shape == terminated.shape == truncated.shape == (64,)
        state["action"] = torch.from_numpy(action)
        result = reference.step(state)["next"]
        if before.any():
            result = reference.maybe_reset(result.set("done", torch.from_numpy(before)[:, None]))
            assert (
                not reward[before].any()
                and not terminated[before].any()
                and not truncated[before].any()
            )
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
    # a step between episodes resets
    assert truncated == [[step in (2, 6)] * 2 for step in range(8)]
    robots = gymnasium.make_vec("bricksrl/RunAway-v0", num_envs=2)
    assert isinstance(robots, gymnasium.vector.SyncVectorEnv)
    robots.close()


def _length(env: gymnasium.Env[Any, Any], most: int = 300) -> int:
    """Steps of an episode of zeros; ``most`` if it has no end by then."""
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)
    for step in range(most):
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            assert info["is_success"] is info["success"]
            return step + 1
    return most


@pytest.mark.parametrize(
    ("env_id", "named", "steps"),
    [
        ("RunAway-v0", {"max_episode_steps": 30}, 30),
        ("RunAway-v0", {"max_episode_steps": 7}, 7),
        ("RunAway-v0", {"max_episode_steps": -1}, 50),
        ("RunAway-v0", {}, 20),
        ("WalkerSim-v1", {"max_episode_steps": 150}, 150),
        ("WalkerSim-v0", {"step_ms": 100, "max_episode_steps": 250}, 250),
        ("RoboArmSim-v0", {"threshold_deg": 1e-3, "max_episode_steps": 130}, 130),
    ],
)
def test_steps_of_an_episode_are_what_gymnasium_is_asked_for(env_id, named, steps) -> None:
    """Longer than the task's as well as shorter; success is known at the end in any case."""
    env = gymnasium.make(gymnasium.spec(f"bricksrl/{env_id}"), **named)
    assert _length(env, 50 if named.get("max_episode_steps") == -1 else 300) == steps
    env.close()


def test_limit_of_the_environment_itself() -> None:
    """Without Gymnasium's wrapper, also in copies."""
    env = GymnasiumEnv("WalkerSim-v1", max_episode_steps=120)
    copied = copy.deepcopy(env)
    assert (_length(env), _length(copied), _length(GymnasiumEnv("WalkerSim-v1"))) == (120, 120, 100)
    assert (
        _length(
            gymnasium.wrappers.TimeLimit(gymnasium.make("bricksrl/WalkerSim-v1").unwrapped, 130)
        )
        == 130
    )
    for wrong in (0, -2, 2.5, True):
        with pytest.raises(DescriptionError, match=f"max_episode_steps is {wrong}; give"):
            GymnasiumEnv("WalkerSim-v1", max_episode_steps=wrong)


def test_our_own_limit_is_refused_by_gymnasium() -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(
            UnknownOptionError, match="give max_episode_steps=150 in place of max_steps"
        ):
            make("bricksrl/WalkerSim-v1", max_steps=150)
    assert _length(GymnasiumEnv("WalkerSim-v1", max_steps=130)) == 130


def test_option_that_gymnasium_cuts_short_is_named(caplog) -> None:
    remedy = "an episode has 250 steps, and Gymnasium ends it after 100; give max_episode_steps=250"
    env = gymnasium.make("bricksrl/WalkerSim-v1", step_ms=100)
    assert _length(env) == 100 and not caplog.messages
    env.reset()
    env.reset()
    assert [remedy in message for message in caplog.messages] == [True]
    gymnasium.make_vec("bricksrl/WalkerSim-v1", step_ms=100).close()
    assert [remedy in message for message in caplog.messages] == [True, True]
    gymnasium.make_vec("bricksrl/WalkerSim-v1", step_ms=100, max_episode_steps=250).close()
    assert len(caplog.messages) == 2


@pytest.mark.parametrize("steps", [9, 150, -1])
def test_batch_has_the_time_limit_that_is_asked_for(steps: int) -> None:
    envs = gymnasium.make_vec("bricksrl/WalkerSim-v1", 2, max_episode_steps=steps)
    envs.reset(seed=0)
    ends = [envs.step(np.zeros((2, 4), np.float32))[3].any() for _ in range(250)]
    assert (ends.index(True) + 1 if True in ends else -1) == steps
    envs.close()


def test_success_has_the_name_of_other_libraries() -> None:
    """At the end of an episode, whoever ends it, and in the final info of any vector
    environment."""
    env = GoalObservation(gymnasium.make("bricksrl/RoboArmSim-v0", threshold_deg=1000.0))
    env.reset(seed=0)
    *_, terminated, _, info = env.step(env.action_space.sample())
    assert terminated and info["is_success"] is True
    for mode in ("sync", None):
        envs = gymnasium.make_vec("bricksrl/RoboArmSim-v0", 2, mode, threshold_deg=1000.0)
        envs.reset(seed=0)
        info = envs.step(envs.action_space.sample())[-1]
        assert info["is_success"].tolist() == info["_is_success"].tolist() == [True, True]
        envs.close()
    envs = gymnasium.make_vec(
        "bricksrl/RoboArmSim-v0", 2, threshold_deg=1000.0, autoreset_mode="SameStep"
    )
    envs.reset(seed=0)
    assert envs.step(envs.action_space.sample())[-1]["final_info"]["is_success"].all()
    envs.close()


def test_lost_episode_is_no_success() -> None:
    env, is_lost = gymnasium.make("bricksrl/RunAway-v0"), False
    env.unwrapped.env.in_reach = lambda: not is_lost
    env.reset(seed=0)
    *_, before = env.step(np.ones(1, np.float32))
    is_lost = True
    *_, truncated, info = env.step(np.ones(1, np.float32))
    assert truncated and info == before | {"link_lost": True, "success": False, "is_success": False}
    env.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_environment_resets_copies_as_asked(mode: AutoresetMode) -> None:
    """As Gymnasium's own vector environments of single ones."""
    ours = gymnasium.make_vec("bricksrl/WalkerSim-v1", 3, max_episode_steps=2, autoreset_mode=mode)
    theirs = gymnasium.make_vec(
        "bricksrl/WalkerSim-v1",
        3,
        "sync",
        max_episode_steps=2,
        vector_kwargs={"autoreset_mode": mode.value},
    )
    assert ours.metadata["autoreset_mode"] is ours.unwrapped.autoreset_mode is mode
    seen: list[list[Any]] = []
    for envs in (ours, theirs):
        envs.reset(seed=3)
        steps = []
        for _ in range(7):
            observation, reward, _, truncated, info = envs.step(np.zeros((3, 4), np.float32))
            final = info.get("final_obs", observation)
            steps.append(
                [truncated.tolist(), (reward != 0).tolist(), np.shape(final), "final_info" in info]
            )
            if mode is AutoresetMode.DISABLED and truncated.any():
                with pytest.raises((BricksError, AssertionError)):
                    envs.step(np.zeros((3, 4), np.float32))
                envs.reset(options={"reset_mask": truncated})
        seen.append(steps)
        envs.close()
    assert seen[0] == seen[1]


def test_vector_environment_keeps_the_end_of_an_episode() -> None:
    envs = gymnasium.make_vec(
        "bricksrl/RoboArmSim-v0", 64, max_episode_steps=9, autoreset_mode=AutoresetMode.SAME_STEP
    )
    state, rng, ends = envs.reset(seed=3)[0], np.random.default_rng(0), 0
    for _ in range(40):
        before = state
        state, _, terminated, truncated, info = envs.step(
            rng.uniform(-1, 1, (64, 4)).astype(np.float32)
        )
        ended = terminated | truncated
        goals = slice(4, None)
        assert np.array_equal(state[~ended, goals], before[~ended, goals])
        if ended.any():
            ends += ended.sum()
            assert np.array_equal(info["_final_obs"], ended) and np.array_equal(
                info["_final_info"], ended
            )
            final = np.stack(list(info["final_obs"][ended]))
            assert np.array_equal(final[:, goals], before[ended, goals]), (
                "the goals of the episode that ended"
            )
            assert (state[ended, goals] != before[ended, goals]).any(-1).all(), (
                "and those of the next one"
            )
            assert np.array_equal(info["final_info"]["success"][ended], terminated[ended])
    assert ends > 64
    envs.close()


def test_vector_environment_resets_the_copies_of_a_mask() -> None:
    envs = gymnasium.make_vec("bricksrl/RoboArmSim-v0", 4, autoreset_mode="Disabled")
    before, _ = envs.reset(seed=1)
    mask = np.array([True, False, True, False])
    after, _ = envs.reset(options={"reset_mask": mask})
    assert np.array_equal((after != before).any(-1), mask)
    for wrong in (mask[:2], mask.astype(int), ~mask & mask):
        with pytest.raises(
            TypeError,
            match="RoboArmSim-v0 needs a reset_mask of 4 bools, one of them True at least",
        ):
            envs.reset(options={"reset_mask": wrong})
    with pytest.raises(
        ValueError, match="no autoreset_mode 'never'; choose one of NextStep, SameStep, Disabled"
    ):
        gymnasium.make_vec("bricksrl/RoboArmSim-v0", 4, autoreset_mode="never")
    envs.close()


def test_torchrl_wraps_vector_environment() -> None:
    """In the mode that it prefers."""
    env = GymWrapper(
        gymnasium.make_vec("bricksrl/RoboArmSim-v0", 8, autoreset_mode=AutoresetMode.DISABLED)
    )
    check_env_specs(env)
    steps = env.rollout(150, break_when_any_done=False)
    done, goals = steps["next", "done"][:, :-1, 0], steps["observation"][..., 4:]
    assert done.any() and torch.equal((goals[:, 1:] != goals[:, :-1]).any(-1), done)
    assert torch.equal(steps["next", "observation"][..., 4:], goals), (
        "the last observation of an episode is its own"
    )
    env.close()


def test_vector_environment_refuses_what_a_batch_cannot_do() -> None:
    with pytest.raises(TypeError, match="omit render_mode"):
        gymnasium.make_vec("bricksrl/WalkerSim-v1", 4, render_mode="rgb_array")
    envs = gymnasium.make_vec("bricksrl/WalkerSim-v1", 4)
    envs.reset()
    for shape in ((4,), (2, 4), (4, 1)):
        with pytest.raises(
            BricksError, match=re.escape(f"got an action of shape {list(shape)}; give [4, 4]")
        ):
            envs.step(np.zeros(shape, np.float32))
    with pytest.raises(TypeError, match="one seed"):
        gymnasium.make_vec("bricksrl/WalkerSim-v1", 4).reset(seed=[1, 2, 3, 4])


def test_step_after_the_end_raises() -> None:
    env = GymnasiumEnv("WalkerSim-v1")
    env.reset(seed=0)
    while not any(env.step(env.action_space.sample())[2:4]):
        pass
    with pytest.raises(
        BricksError, match="WalkerSim-v1 got a step after the end of an episode; reset it first"
    ):
        env.step(env.action_space.sample())
    env.reset()
    env.step(env.action_space.sample())


def test_missing_graphics_library_disables_pictures_only() -> None:
    """Whatever is imported first."""
    script = (
        "from bricksrl.evaluation import evaluate; import gymnasium; "
        "gymnasium.make('bricksrl/WalkerSim-v1').reset()"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(
        command,
        env={**os.environ, "MUJOCO_GL": "bogus"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stderr.count("MUJOCO_GL=bogus does not work") == 1, (
        done.stderr
    )


@pytest.mark.parametrize("env_id", ["Walker-v2", "RoboArmSim-v0"])
def test_features_are_those_of_our_agents(env_id):
    from bricksrl.agents import preset
    from bricksrl.agents.features.encoder import make_encoder
    from bricksrl.interfaces.gymnasium import FeatureObservation

    env = FeatureObservation(gymnasium.make(f"bricksrl/{env_id}"))
    observation, _ = env.reset(seed=0)
    raw = env.unwrapped.env
    encoder = make_encoder(raw, preset("default", "sac")).eval()
    plain, _ = gymnasium.make(f"bricksrl/{env_id}").reset(seed=0)
    assert observation.tolist() == pytest.approx(
        encoder(torch.from_numpy(plain)).detach().tolist(), abs=1e-6
    )
    assert env.observation_space.shape == observation.shape == (encoder.size,)
    after, *_ = env.step(env.action_space.sample())
    assert after.shape == observation.shape and abs(after).max() < 20.0
    env.close()


def test_features_need_an_environment_of_ours():
    from bricksrl.interfaces.gymnasium import FeatureObservation

    with pytest.raises(DescriptionError, match="no vector of ours"):
        FeatureObservation(gymnasium.make("CartPole-v1"))


@pytest.mark.slow
def test_another_library_learns_with_the_features():
    """The documentation's example; return 93 is a trot."""
    sb3 = pytest.importorskip("stable_baselines3")
    from bricksrl.interfaces.gymnasium import FeatureObservation

    env = FeatureObservation(gymnasium.make(gymnasium.spec("bricksrl/Walker-v1")))
    options = {
        "learning_rate": 1e-3,
        "gamma": 0.95,
        "gradient_steps": 2,
        "learning_starts": 100,
        "ent_coef": "auto_0.1",
    }
    agent = sb3.SAC("MlpPolicy", env, seed=0, **options)
    agent.learn(2000)
    observation, total, ended = env.reset(seed=1)[0], 0.0, False
    while not ended:
        observation, reward, terminated, truncated, _ = env.step(
            agent.predict(observation, deterministic=True)[0]
        )
        total, ended = total + reward, terminated or truncated
    assert total > 0.8 * 93.0
