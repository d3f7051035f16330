"""Adapters of networks and encoders for TorchRL's losses and environments."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torchrl.envs.transforms import UnaryTransform
from torchrl.modules import ValueOperator

from bricksrl.agents.encoder import ObservationEncoder, encoder_keys
from bricksrl.agents.networks import Actor


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


class EncodeObservation(UnaryTransform):  # type: ignore[misc]
    """An encoder as a transform: adds "features" ``[*batch, size]`` to an environment or a replay buffer."""

    def __init__(self, encoder: ObservationEncoder, out_key: str = "features") -> None:
        super().__init__(in_keys=["observation"], out_keys=[out_key], fn=encoder)
