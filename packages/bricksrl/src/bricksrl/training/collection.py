"""Collection from many copies by TorchRL's collector: batched simulations, or virtual robots in processes."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Iterator
from typing import Any

from tensordict import TensorDictBase
from torchrl.envs import Compose, EnvBase, ParallelEnv, RewardSum, StepCounter, TransformedEnv
from torchrl.envs.utils import ExplorationType

from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import get_task, is_simulation, make
from bricksrl.errors import RunError


class _Processes(BricksEnv, ParallelEnv):  # type: ignore[misc]
    """Virtual robots, each in a process; nothing of a single one is reached from here."""


def make_copies(env_id: str, options: EnvOptions, copies: int, *, seed: int | None, device: str = "cpu") -> EnvBase:
    """Environment with batch ``[copies]`` that tracks return and length of episodes: a batched simulation, or one process per
    virtual robot. Raises RunError if these processes cannot be started."""
    if is_simulation(env_id):
        env = make(env_id, options, batch_size=copies, seed=seed, device=device)
    else:
        make_one = functools.partial(make, env_id, options.env_options, seed=seed)
        env = _Processes(copies, make_one, mp_start_method="spawn")
        try:
            env.start()
        except EOFError:  # it ended at once, as it imports the script that starts it
            raise RunError(f"the {copies} processes cannot start; put your script under `if __name__ == '__main__':`") from None
        env.task = get_task(env_id, **options.options)  # attributes do not cross process boundaries
    return TransformedEnv(env, Compose(RewardSum(), StepCounter()))


def collect_round(env: EnvBase, policy: Any, steps: int, steps_per_batch: int) -> Iterator[TensorDictBase]:
    """Frames ``[copies, steps_per_batch]``, at least ``steps`` per copy from a reset on; ended copies restart. ``policy``: a
    TensorDict module on the environment's device; it explores."""
    with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # raised by TorchRL's own import
        from torchrl.collectors import Collector

    copies = env.batch_size.numel()
    batches = math.ceil(steps / steps_per_batch)
    collector = Collector(
        env,
        policy,
        frames_per_batch=steps_per_batch * copies,
        total_frames=batches * steps_per_batch * copies,
        exploration_type=ExplorationType.RANDOM,
        auto_register_policy_transforms=False,
    )
    try:
        yield from collector
    finally:
        collector.shutdown(close_env=False)
