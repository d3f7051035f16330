"""Environments that are pickled, as multiprocessing, TorchRL and Ray do."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from torchrl.envs import EnvBase, TransformedEnv

import bricksrl
from bricksrl.envs.arenas import make_arena
from bricksrl.envs.env import HubEnv
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.errors import BricksError


def pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))  # noqa: S301  it was made here


def start(env: EnvBase) -> list[float]:
    """First observation of an episode."""
    found: list[float] = env.reset()["observation"].flatten().tolist()
    return found


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        ("RunAway-v0", {"randomize": True}),
        ("RoboArm-v0", {"sparse": True, "streaming": False}),
        ("WalkerSim-v0", {}),
        ("RoboArmSim-v0", {"batch_size": [8], "sparse": True}),
    ],
)
def test_pickle_makes_equal_environment(env_id: str, options: dict[str, Any]) -> None:
    env = bricksrl.make(env_id, seed=3, **options)
    first = start(env)
    for one in (pickled(env), copy.deepcopy(env), pickled(TransformedEnv(env))):
        assert start(one) == first
        one.close()
    env.set_seed(np.int64(5))
    second = start(env)
    one = pickled(env)
    assert start(one) == second != first
    assert one.batch_size == env.batch_size
    assert one.action_spec == env.action_spec
    one.close()
    env.close()


@pytest.mark.parametrize("env_id", ["RoboArm-v0", "WalkerSim-v0"])
def test_pickles_without_seed_differ(env_id: str) -> None:
    env = bricksrl.make(env_id)
    one, other = pickled(env), pickled(env)
    assert start(one) != start(other)
    for each in (env, one, other):
        each.close()


def test_arena_pickles() -> None:
    env = make_arena("Tag-v0", batch_size=4, seed=3)
    assert (pickled(env).reset() == env.reset()).all()
    assert pickled(make_arena("Carry-v0", realtime=True)).task.id == "Carry-v0"


def test_gymnasium_environment_pickles_within_episode() -> None:
    env = gymnasium.make("bricksrl/RunAway-v0", render_mode="rgb_array")
    first, _ = env.reset(seed=3)
    env.step(env.action_space.sample())
    one = pickled(env)
    assert one.render_mode == "rgb_array"
    again, _ = one.reset()
    assert np.array_equal(again, first)
    *_, info = one.step(env.action_space.sample())
    assert info
    env.close()
    one.close()


def test_environment_with_link_to_robot_raises() -> None:
    made = HubEnv(RUN_AWAY, lambda _seed: pytest.fail("no link is needed"))
    for env in (
        bricksrl.make("RunAway-v0", hub="ble"),
        gymnasium.make("bricksrl/RunAway-v0", hub="ble"),
        made,
    ):
        with pytest.raises(
            BricksError, match="RunAway-v0 cannot be pickled.* pass a function that makes it"
        ) as caught:
            pickle.dumps(env)
        assert "\n" not in str(caught.value)
