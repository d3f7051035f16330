"""Policies that every environment of ours has, by name: random, scripted, and best, the trained one that comes with it. Importing
this loads no torch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bricksrl.envs.task import Task
from bricksrl.policies.boxed import boxed_policy
from bricksrl.policies.scripted import CONTROLLERS, ArrayPolicy


def array_policies(env_id: str, task: Task, seed: int) -> dict[str, Callable[[], ArrayPolicy]]:
    """Factories of the policies of an environment, the best one last; ``seed`` is that of the random actions."""
    rng, size = np.random.default_rng(seed), len(task.interface.commands)
    policies: dict[str, Callable[[], ArrayPolicy]] = {"random": lambda: lambda _state: rng.uniform(-1.0, 1.0, size)}
    if env_id in CONTROLLERS:
        policies["scripted"] = lambda: CONTROLLERS[env_id]
    if (best := boxed_policy(env_id)) is not None:
        policies["best"] = lambda: lambda state: best.act(state["observation"])
    return policies
