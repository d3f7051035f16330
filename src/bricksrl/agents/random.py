"""Uniformly random actions: a baseline, and a source of random data."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import action_size


@dataclass(frozen=True)
class RandomSettings:
    """No settings."""


class UniformActions(torch.nn.Module):
    """Uniform actions ``[*batch, m]`` in -1..1, with or without exploration."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.action_size = size

    def forward(self, observation: Tensor) -> Tensor:
        return 2.0 * torch.rand(*observation.shape[:-1], self.action_size, device=observation.device) - 1.0


def build(env: EnvBase, settings: RandomSettings, device: torch.device | str = "cpu") -> Learner:
    """Random actions for an environment."""
    del settings, device
    policy = TensorDictModule(UniformActions(action_size(env)), in_keys=["observation"], out_keys=["action"])
    return Learner(policy=policy, updates_per_step=0.0)
