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


def uniform_actions(
    observation: Tensor,
    *,
    size: int,
    dims: int = 1,
) -> Tensor:
    """Uniform actions ``[*batch, size]`` in -1..1, with or without exploration, for observations of
    ``dims`` dimensions."""
    batch = observation.shape[: observation.ndim - dims]
    shares = torch.rand(*batch, size, device=observation.device)
    return 2.0 * shares - 1.0


def build(
    env: EnvBase,
    settings: RandomSettings,
    device: torch.device | str = "cpu",
) -> Learner:
    """Random actions for an environment."""
    # nothing is learned, and the observation's device is that of the actions
    del settings, device
    layout = layout_of(env)
    # any one input tells the batch; vectors come first, and an image has three dimensions
    dims = 3
    if layout.vectors:
        _, shape = layout.vectors[0]
        dims = len(shape)
    act = functools.partial(uniform_actions, size=action_size(env), dims=dims)
    policy = TensorDictModule(act, in_keys=layout.keys[:1], out_keys=["action"])
    return Learner(policy)
