"""Arenas in PettingZoo's parallel API."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

from bricksrl.envs.arenas import get_arena_task
from bricksrl.errors import RunError, UnknownOptionError


@pytest.mark.parametrize("name", ["Tag-v0", "Carry-v0", "Guide-v0"])
def test_pettingzoo_checks_its_interface(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pettingzoo.test import parallel_api_test

        from bricksrl.interfaces.pettingzoo import ArenaParallelEnv

        env = ArenaParallelEnv(name)
        parallel_api_test(env, num_cycles=15)
    first, _ = env.reset(seed=5)
    again, _ = env.reset(seed=5)
    assert env.render_mode is env.render() is None
    assert all(
        np.isfinite(space.low).all() and space.contains(first[robot])
        for robot, space in env.observation_spaces.items()
    )
    assert first.keys() == set(get_arena_task(name).robots)
    assert all(np.array_equal(first[robot], again[robot]) for robot in first)
    env.close()


def test_pettingzoo_needs_an_episode_and_an_action_of_each_robot() -> None:
    from bricksrl.interfaces.pettingzoo import ArenaParallelEnv

    still = np.zeros(2, np.float32)
    env = ArenaParallelEnv("Carry-v0")
    with pytest.raises(
        RunError, match="Carry-v0 got actions of left, right; reset it, then give one of each agent"
    ):
        env.step({"left": still, "right": still})
    env.reset()
    for actions in ({}, {"left": still}):
        with pytest.raises(RunError, match="got actions of (none|left); reset it"):
            env.step(actions)
    env.close()
    with pytest.raises(UnknownOptionError, match="omit batch_size"):
        ArenaParallelEnv("Tag-v0", batch_size=4)
    with pytest.raises(UnknownOptionError, match="no render_mode 'human'; choose rgb_array"):
        ArenaParallelEnv("Tag-v0", render_mode="human")


def test_pettingzoo_draws_the_arena() -> None:
    from bricksrl.interfaces.pettingzoo import ArenaParallelEnv

    env = ArenaParallelEnv("Tag-v0", render_mode="rgb_array")
    images = []
    for seed in (1, 2, 1):  # each seed has a world of its own
        env.reset(seed=seed)
        image = env.render()
        assert image is not None and image.shape == (360, 480, 3) and image.dtype == np.uint8
        images.append(image)
    assert np.array_equal(images[0], images[2]) and (images[0] != images[1]).any(-1).mean() > 0.01
    assert env.metadata["render_fps"] == 4
    pickle.loads(pickle.dumps(env)).close()  # noqa: S301  it was made here
    env.close()
    env.close()


def test_pettingzoo_state_is_what_all_robots_observe() -> None:
    """Critics that see everything, such as MAPPO's, read it."""
    from pettingzoo.test.state_test import test_state_space as check_state_space
    from torchrl.envs import PettingZooWrapper, check_env_specs

    from bricksrl.interfaces.pettingzoo import ArenaParallelEnv

    env = ArenaParallelEnv("Carry-v0", render_mode=None)
    with pytest.raises(
        RunError, match="Carry-v0 has no state before its first episode; reset it first"
    ):
        env.state()
    observations, _ = env.reset(seed=5)
    draws = env.np_random.integers(0, 100, 9)
    for _ in range(2):
        assert env.state_space.contains(env.state())
        assert np.array_equal(
            env.state(), np.concatenate([observations["left"], observations["right"]])
        )
        observations, *_, infos = env.step(dict.fromkeys(env.agents, np.ones(2, np.float32)))
        assert (
            infos["left"]
            == infos["right"]
            == {"link_lost": False, "success": False, "is_success": False}
        )
    env.reset(seed=5)
    assert np.array_equal(env.np_random.integers(0, 100, 9), draws)
    with warnings.catch_warnings():
        # they say that it is unbounded, and that they know another version of PettingZoo
        warnings.simplefilter("ignore")
        check_state_space(env)
        wrapped = PettingZooWrapper(env, return_state=True)
        check_env_specs(wrapped)
        assert wrapped.rollout(2)["state"].shape == (2, 24)
    wrapped.close()
