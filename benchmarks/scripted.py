"""The hand-written controllers of `bricksrl.envs.tasks.scripted`, as policies of TorchRL."""

from __future__ import annotations

import functools

import torch
from tensordict import TensorDictBase

from bricksrl.envs.rollout import Policy
from bricksrl.envs.tasks import scripted
from bricksrl.envs.tasks.scripted import ArrayPolicy


def controller(policy: ArrayPolicy) -> Policy:
    """The controller of a policy of arrays."""

    @functools.wraps(policy)
    def act(state: TensorDictBase) -> TensorDictBase:
        inputs = {
            key: state[key].numpy().copy() for key in ("observation", "image") if key in state
        }
        return state.set("action", torch.as_tensor(policy(inputs), dtype=torch.float32))

    return act


CONTROLLERS = {env: controller(policy) for env, policy in scripted.CONTROLLERS.items()}
