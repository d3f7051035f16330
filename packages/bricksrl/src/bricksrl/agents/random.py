"""Uniformly random actions: a baseline, and a source of random data."""

import functools
from dataclasses import dataclass

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import action_size
from bricksrl.agents.settings import Presets
from bricksrl.envs.transforms import layout_of


@dataclass(frozen=True)
class RandomSettings:
    """No settings."""


PRESETS = {"random": Presets(RandomSettings(), images=RandomSettings(), paper=RandomSettings())}


def uniform_actions(observation: Tensor, *, size: int, dims: int = 1) -> Tensor:
    """Uniform actions ``[*batch, size]`` in -1..1, with or without exploration, for observations of
    ``dims`` dimensions."""
    return (
        2.0
        * torch.rand(*observation.shape[: observation.ndim - dims], size, device=observation.device)
        - 1.0
    )


def build(env: EnvBase, settings: RandomSettings, device: torch.device | str = "cpu") -> Learner:
    """Random actions for an environment."""
    del settings, device
    layout = layout_of(env)
    act = functools.partial(
        uniform_actions,
        size=action_size(env),
        dims=len(layout.vectors[0][1]) if layout.vectors else 3,
    )
    policy = TensorDictModule(act, in_keys=layout.keys[:1], out_keys=["action"])
    return Learner(policy=policy, updates_per_step=0.0)
