"""Trained policies: loading, sharing, export. Importing this loads no torch."""

from __future__ import annotations

from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brickhub.fields import check_value
from bricksrl.errors import RunError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.policies.policy import Policy
    from bricksrl.training.config import TrainConfig
    from bricksrl.training.restore import Which


def load_policy(
    path: Path | str,
    env: EnvBase | None = None,
    *,
    which: Which = "last",
) -> Policy:
    """Load the policy of a run, or a shared one, as a TensorDict module for ``env.rollout(100,
    policy)``.

    Args:
        path: folder of a run, or of a shared policy.
        env: environment to act in; by default that of the training. If it has no transforms and the
            training had some, the policy has them, and takes what the environment itself observes.
        which: the last checkpoint, or that of the best evaluation.

    Raises:
        RunError: there is no run in the folder, or a shared policy and ``which`` is not the last
            checkpoint.
        CheckpointError: the policy is damaged, or ``env`` has other observations or actions than
            the run's environment.
    """
    from bricksrl.policies.policy import Policy
    from bricksrl.policies.sharing import is_policy, load_shared
    from bricksrl.training.learners import load_learner, on_its_hub

    check_value("path", path, Path | str)
    path = Path(path)
    given = env
    if which != "last" and is_policy(path):
        raise RunError(f"{path} holds the policy of one checkpoint; take the last one")
    from bricksrl.envs.transforms import base_of, transformed, with_unit_actions

    with closing(make_env_of(path)) if env is None else nullcontext(env) as env:
        base = base_of(env)
        # A bare environment gets the transforms of the training; one with transforms has the user's
        # choice of them.
        if base is env:
            trained = transformed(env, config_of(path).robot)
        else:
            trained = with_unit_actions(env)
        if is_policy(path):
            learner = on_its_hub(load_shared(path, trained), trained)
        else:
            learner = load_learner(path, trained, which=which).learner
        # Whoever gave no transforms gives what the robot observes, and the policy transforms it.
        takes_own = trained is not base and (base is env or given is None)
        if takes_own:
            return Policy(learner.policy, base, trained)
        return Policy(learner.policy, trained)


def config_of(path: Path) -> TrainConfig:
    """Config of a run, or of a shared policy. Raises RunError or CheckpointError if the folder has
    neither, or it is damaged."""
    from bricksrl.policies.sharing import is_policy, read_policy
    from bricksrl.training.run_folder import RunFolder

    return read_policy(path)[0] if is_policy(path) else RunFolder(path).read_config()


def make_env_of(path: Path, **changed: Any) -> EnvBase:
    """The environment that a run or a shared policy was trained in, of a single robot, with these
    options ``changed``. Raises the errors of `config_of`."""
    from bricksrl.envs.make import make

    config = config_of(path)
    return make(config.env, config.robot.changed(**changed), seed=config.seed)


__all__ = ["config_of", "load_policy", "make_env_of"]
