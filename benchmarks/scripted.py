"""The hand-written controllers of `bricksrl.envs.tasks.scripted`, for TensorDicts without batch dimensions."""

from __future__ import annotations

import functools
from collections.abc import Callable

import torch
from tensordict import TensorDictBase
from torch import Tensor

from bricksrl.envs.tasks import scripted
from bricksrl.envs.tasks.scripted import ArrayPolicy

Controller = Callable[[TensorDictBase], Tensor]


def controller(policy: ArrayPolicy) -> Controller:
    """The controller of a policy of arrays."""

    @functools.wraps(policy)
    def act(state: TensorDictBase) -> Tensor:
        inputs = {key: state[key].numpy().copy() for key in ("observation", "image") if key in state}
        return torch.as_tensor(policy(inputs), dtype=torch.float32)

    return act


CONTROLLERS = {env: controller(policy) for env, policy in scripted.CONTROLLERS.items()}
