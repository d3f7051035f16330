"""Policies that an environment of ours has, by name: random, scripted, and best, which comes with it, trained by ``python -m
benchmarks policies``. Importing this loads no torch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from brickhub.tables import read_table
from bricksrl.envs.reference_returns import REFERENCES
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.scripted import CONTROLLERS, ArrayPolicy
from bricksrl.policies.plain import PlainPolicy

FOLDER = Path(__file__).with_name("trained")
TRAINED = {row["env"]: row for row in read_table(__package__, "trained/policies")}
"""Settings and mean return of each trained policy, by its environment."""


def scores_to_beat(env_id: str) -> dict[str, float]:
    """Mean returns in an environment of ours: of random actions, a controller by hand, the paper, and the policy that comes with
    it."""
    trained = {"ours": float(TRAINED[env_id]["return"])} if env_id in TRAINED else {}
    return {**REFERENCES.get(env_id, {}), **trained}


def path_of(env_id: str) -> Path:
    """File of the trained policy of an environment."""
    return FOLDER / f"{env_id}.npz"


def array_policies(env_id: str, task: Task, seed: int) -> dict[str, Callable[[], ArrayPolicy]]:
    """Factories of the policies of an environment, the best one last; ``seed`` is that of the random actions."""
    rng, size = np.random.default_rng(seed), len(task.interface.commands)
    policies: dict[str, Callable[[], ArrayPolicy]] = {"random": lambda: lambda _state: rng.uniform(-1.0, 1.0, size)}
    if env_id in CONTROLLERS:
        policies["scripted"] = lambda: CONTROLLERS[env_id]
    if env_id in TRAINED:
        best = PlainPolicy.load(path_of(env_id))
        policies["best"] = lambda: lambda state: best.act(state["observation"])
    return policies
