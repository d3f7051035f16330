"""Policies of a run by name, to compare: random, first (before it had learned), best, last."""

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
    """A policy, and what makes it forget its plans when an episode starts."""

    act: Acting
    reset: Callable[[], None] = lambda: None


def named_policies(run_dir: Path, env: EnvBase) -> dict[str, Callable[[], Player]]:
    """The policies of a run, or of one that was shared, each made when it is called; the last name is the last checkpoint.

    ``best`` is there only where the run was evaluated while it learned.

    Raises:
        RunError, CheckpointError: there is no run in the folder, or, when it is made, it does not fit ``env``.
    """
    from bricksrl.policies import load_policy
    from bricksrl.policies.sharing import is_policy
    from bricksrl.training.run_folder import RunFolder

    def load(which: str) -> Player:
        policy = load_policy(run_dir, env, which="best" if which == "best" else "last")
        return Player(policy, policy.reset)

    if is_policy(run_dir):
        return {"random": lambda: random_player(env), "last": lambda: load("last")}
    best = {"best": lambda: load("best")} if RunFolder(run_dir).best_path.exists() else {}
    return {"random": lambda: random_player(env), "first": lambda: _first(run_dir, env), **best, "last": lambda: load("last")}


def random_player(env: EnvBase) -> Player:
    """Uniform actions."""
    return Player(lambda state: state.set("action", env.action_spec.rand()))


def _first(run_dir: Path, env: EnvBase) -> Player:
    """The agent of a run as it was before it had learned anything."""
    from bricksrl.policies.policy import Policy
    from bricksrl.seed import derive_seed
    from bricksrl.training.restore import make_learner_for
    from bricksrl.training.run_folder import RunFolder
    from bricksrl.training.seeding import reproducible

    config = RunFolder(run_dir).read_config()
    with reproducible(derive_seed(config.seed, "agent")):
        learner = make_learner_for(config, env, device="cpu")
    policy = Policy(learner.policy, learner.reset_policy)
    return Player(policy, policy.reset)
