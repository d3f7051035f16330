"""Operators: networks and encoders in the forms that losses and environments of TorchRL's take."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn
from torchrl.data import Unbounded
from torchrl.envs.transforms import ObservationTransform
from torchrl.modules import ValueOperator

from bricksrl.agents.encoder import ObservationEncoder, encoder_keys
from bricksrl.agents.networks import Actor

M = TypeVar("M", bound=nn.Module)


class Critic(nn.Module):
    """An action value ``[*batch, out]`` of what is observed and an action, the action last: for TorchRL's losses."""

    def __init__(self, encoder: nn.Module, body: nn.Module) -> None:
        super().__init__()
        self.encoder, self.body = encoder, body

    def forward(self, *inputs: Tensor) -> Tensor:
        value: Tensor = self.body(torch.cat((self.encoder(*inputs[:-1]), inputs[-1]), -1))
        return value


def value_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """A state value for TorchRL's losses."""
    return ValueOperator(Actor(encoder, body, nn.Identity()), in_keys=encoder_keys(encoder))


def critic_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """An action value for TorchRL's losses."""
    return ValueOperator(Critic(encoder, body), in_keys=[*encoder_keys(encoder), "action"])


def acting_copy(policy: M) -> M:
    """A policy of the same parameters that acts without dropout while a loss trains them with it."""
    shared = {id(parameter): parameter for parameter in policy.parameters()}
    return copy.deepcopy(policy, shared).eval()


class EncodeObservation(ObservationTransform):  # type: ignore[misc]
    """An encoder as a transform: adds "features" ``[*batch, size]`` to what an environment or a replay buffer gives."""

    def __init__(self, encoder: ObservationEncoder, out_key: str = "features") -> None:
        super().__init__(in_keys=["observation"], out_keys=[out_key])
        self.encoder = encoder

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return self.encoder.forward(observation)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Any) -> Any:
        """The environment's spec and the features', which have no bounds."""
        shape = (*observation_spec.shape, self.encoder.size)
        observation_spec[self.out_keys[0]] = Unbounded(shape, device=observation_spec.device)
        return observation_spec
