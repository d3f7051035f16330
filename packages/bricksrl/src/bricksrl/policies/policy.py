"""Policies: a trained agent's deterministic actions, as a TorchRL module and for plain arrays; those of a run by their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from bricksrl.envs import rollout
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from torchrl.envs import EnvBase


class Policy(TensorDictModuleBase):  # type: ignore[misc]
    """Deterministic policy of a trained agent: ``env.rollout(100, policy)``, or `act` on an observation.

    Args:
        module: reads "observation", and "image" if the policy uses it, and writes "action"; may have a method ``reset``.
        size: n, the number of values of an observation.
    """

    def __init__(self, module: TensorDictModuleBase, size: int) -> None:
        super().__init__()
        self.size = size
        self.in_keys, self.out_keys = list(module.in_keys), ["action"]
        self.module = module.eval()

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        if tensordict["observation"].shape[-1:] != (self.size,):
            raise DescriptionError(f"the policy takes observations of {self.size} numbers; give [*batch, {self.size}]")
        if "image" in self.in_keys and "image" not in tensordict:
            raise DescriptionError("the policy uses images; give one too")
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            action = self.module(tensordict.select(*self.in_keys))["action"]
        return tensordict.set("action", action)

    def act(self, observation: Any, image: Any = None) -> Any:
        """Action ``[*batch, m]``, in -1..1, for an observation ``[*batch, n]``: an array for an array, a tensor for a tensor.
        ``image``: uint8 ``[*batch, side, side, 3]``, for a policy that uses images. Raises DescriptionError for another n, or
        without the image that the policy needs."""
        values = torch.as_tensor(observation, dtype=torch.float32)
        inputs = {"observation": values} if image is None else {"observation": values, "image": torch.as_tensor(image)}
        action: Tensor = self(TensorDict(inputs, values.shape[:-1]))["action"]
        return action if isinstance(observation, Tensor) else np.asarray(action)

    def reset(self) -> None:
        """Reset the policy's state at the start of an episode, such as a chunk of planned actions."""
        if hasattr(self.module, "reset"):
            self.module.reset()


@dataclass(frozen=True)
class Player:
    """A policy, and the reset of its state at the start of an episode."""

    act: rollout.Policy
    reset: Callable[[], None] = lambda: None


def named_policies(run_dir: Path, env: EnvBase, seed: int) -> dict[str, Callable[[], Player]]:
    """Factories of the policies of a run, or of a shared one, for comparison: random, first (untrained), best, last. Raises
    RunError or CheckpointError if there is no run in the folder, or, when called, the policy does not match ``env``.

    ``best`` exists only if the run was evaluated during training. ``seed`` is that of the random actions.
    """
    from bricksrl.policies import load_policy
    from bricksrl.policies.sharing import is_policy
    from bricksrl.training.restore import untrained_learner
    from bricksrl.training.run_folder import RunFolder

    def player(policy: Policy) -> Player:
        return Player(policy, policy.reset)

    def first() -> Player:
        learner = untrained_learner(run_dir, env)
        return player(Policy(learner.policy, env.observation_spec["observation"].shape[-1]))

    named = {"random": lambda: random_player(env, seed)}
    if not is_policy(run_dir):
        named["first"] = first
        if RunFolder(run_dir).best_path.exists():
            named["best"] = lambda: player(load_policy(run_dir, env, which="best"))
    return {**named, "last": lambda: player(load_policy(run_dir, env))}


def random_player(env: EnvBase, seed: int) -> Player:
    """Player of uniform random actions."""
    from bricksrl.data.collect import random_policy

    return Player(random_policy(env, seed))
