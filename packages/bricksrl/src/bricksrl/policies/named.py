"""Policies of a run by name, for comparison: random, first (untrained), best, last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bricksrl.envs.rollout import Policy as Acting

if TYPE_CHECKING:
    from torchrl.envs import EnvBase


@dataclass(frozen=True)
class Player:
    """A policy, and the reset of its state at the start of an episode."""

    act: Acting
    reset: Callable[[], None] = lambda: None


def named_policies(run_dir: Path, env: EnvBase, seed: int) -> dict[str, Callable[[], Player]]:
    """Factories of the policies of a run, or of a shared one, by name; the last name is the last checkpoint. Raises RunError or
    CheckpointError if there is no run in the folder, or, when called, the policy does not match ``env``.

    ``best`` exists only if the run was evaluated during training. ``seed`` is that of the random actions.
    """
    from bricksrl.policies import load_policy
    from bricksrl.policies.sharing import is_policy
    from bricksrl.training.run_folder import RunFolder

    def load(which: str) -> Player:
        policy = load_policy(run_dir, env, which="best" if which == "best" else "last")
        return Player(policy, policy.reset)

    if is_policy(run_dir):
        return {"random": lambda: random_player(env, seed), "last": lambda: load("last")}
    best = {"best": lambda: load("best")} if RunFolder(run_dir).best_path.exists() else {}
    return {
        "random": lambda: random_player(env, seed),
        "first": lambda: _first(run_dir, env),
        **best,
        "last": lambda: load("last"),
    }


def random_player(env: EnvBase, seed: int) -> Player:
    """Player of uniform random actions."""
    from bricksrl.data.collect import random_policy

    return Player(random_policy(env, seed))


def _first(run_dir: Path, env: EnvBase) -> Player:
    """The untrained agent of a run, with its initial parameters."""
    from bricksrl.policies.policy import Policy
    from bricksrl.training.restore import untrained_learner

    learner = untrained_learner(run_dir, env)
    policy = Policy(learner.policy, env.observation_spec["observation"].shape[-1])
    return Player(policy, policy.reset)
