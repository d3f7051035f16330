"""Adapters of networks and encoders for TorchRL's losses and environments."""

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
    """Action value ``[*batch, out]`` of observations and an action (last argument)."""

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
    """A policy with shared parameters that acts without dropout while a loss trains with it."""
    shared = {id(parameter): parameter for parameter in policy.parameters()}
    return copy.deepcopy(policy, shared).eval()


class EncodeObservation(ObservationTransform):  # type: ignore[misc]
    """An encoder as a transform: adds "features" ``[*batch, size]`` to an environment or a replay buffer."""

    def __init__(self, encoder: ObservationEncoder, out_key: str = "features") -> None:
        super().__init__(in_keys=["observation"], out_keys=[out_key])
        self.encoder = encoder

    def _apply_transform(self, observation: Tensor) -> Tensor:
        return self.encoder.forward(observation)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: Any) -> Any:
        """The spec with unbounded features."""
        shape = (*observation_spec.shape, self.encoder.size)
        observation_spec[self.out_keys[0]] = Unbounded(shape, device=observation_spec.device)
        return observation_spec
