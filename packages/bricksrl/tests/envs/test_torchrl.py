"""TorchRL's tools with our environments: serial, parallel, collectors, transforms."""

from __future__ import annotations

import functools
from typing import Any

import pytest
import torch
from torchrl.envs import (
    CatFrames,
    Compose,
    EnvBase,
    ParallelEnv,
    RewardSum,
    SerialEnv,
    StepCounter,
    TransformedEnv,
    UnsqueezeTransform,
)
from torchrl.envs.utils import check_env_specs

import bricksrl

MAKE = functools.partial(bricksrl.make, "RunAway-v0")


def returns(envs: EnvBase) -> list[float]:
    """Returns of four steps of two environments."""
    envs.set_seed(3)
    steps = envs.rollout(4, policy=lambda td: td.set("action", torch.full((2, 1), -1.0)))
    envs.close()
    assert steps.batch_size == (2, 4)
    found: list[float] = steps["next", "reward"].sum((1, 2)).tolist()
    return found


@pytest.mark.slow
def test_serial_and_parallel_envs_are_equal() -> None:
    here, there = returns(SerialEnv(2, MAKE)), returns(ParallelEnv(2, MAKE))
    assert here == there
    assert all(one > 0 for one in here)


# TorchRL's own, when it is loaded
@pytest.mark.filterwarnings("ignore:Creating .*WeightUpdater:DeprecationWarning")
@pytest.mark.parametrize(("env_id", "frames"), [("RunAway-v0", 50), ("WalkerSim-v0", 150)])
def test_collector_continues_over_episode_ends(env_id: str, frames: int) -> None:
    from torchrl.collectors import Collector

    collector = Collector(
        bricksrl.make(env_id, seed=0), None, frames_per_batch=frames, total_frames=2 * frames
    )
    batches = list(collector)
    collector.shutdown()
    assert [len(batch) for batch in batches] == [frames, frames]
    assert sum(int(batch["next", "done"].sum()) for batch in batches) >= 2


def test_transforms() -> None:
    transforms: list[Any] = [
        RewardSum(),
        StepCounter(12),
        CatFrames(N=3, dim=-1, in_keys=["observation"]),
    ]
    env = TransformedEnv(bricksrl.make("RoboArm-v0", seed=0), Compose(*transforms))
    check_env_specs(env)
    steps = env.rollout(20)
    env.close()
    assert len(steps) <= 12
    assert steps["observation"].shape == (len(steps), 3 * 8)
    assert torch.allclose(steps["next", "episode_reward"], steps["next", "reward"].cumsum(0))


@pytest.mark.parametrize("dim", [-1, -2])
@pytest.mark.parametrize("frames", [1, 3])
def test_transforms_add_dimensions_to_the_observation(dim: int, frames: int) -> None:
    """They change a spec in place, without its methods."""
    unsqueeze, stack = (
        UnsqueezeTransform(dim=dim, in_keys=["observation"]),
        CatFrames(N=frames, dim=dim, in_keys=["observation"]),
    )
    env = TransformedEnv(bricksrl.make("WalkerSim-v0", seed=0), Compose(unsqueeze, stack))
    check_env_specs(env)
    spec, seen = env.observation_spec["observation"], env.reset()["observation"]
    assert seen.shape == {-1: (7, frames), -2: (frames, 7)}[dim] and spec.is_in(seen)
    assert torch.equal(spec.project(seen), seen) and not spec.is_in(
        torch.full_like(seen, torch.inf)
    )
    assert frames > 1 or not spec.is_in(torch.full_like(seen, -1.0)), (
        "no angle of a leg is negative"
    )


@pytest.mark.parametrize("env_id", ["RunAway-v0", "WalkerSim-v0"])
def test_missing_action_is_named(env_id: str) -> None:
    env = bricksrl.make(env_id, seed=0)
    with pytest.raises(KeyError, match='"action" not found'):
        env.step(env.reset())
    env.close()


def test_environment_moved_to_a_device_gives_its_tensors_there() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    assert env.rollout(3).device is None
    assert env.to("cpu").rollout(3).device == torch.device("cpu")
    env.close()
