"""Operators: encoders and networks as values of states and actions, for TorchRL's losses."""

import torch
from torch import Tensor, nn
from torchrl.modules import ValueOperator

from bricksrl.agents.features.encoder import encoder_keys
from bricksrl.agents.networks import Actor


class Critic(nn.Module):
    """Action value ``[*batch, out]`` of observations and an action (last argument)."""

    def __init__(
        self,
        encoder: nn.Module,
        body: nn.Module,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.body = body

    def forward(self, *inputs: Tensor) -> Tensor:
        *observed, action = inputs
        features = self.encoder(*observed)
        value: Tensor = self.body(torch.cat((features, action), -1))
        return value


def value_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """A state value for TorchRL's losses."""
    # a value has no head: it may be any number
    return ValueOperator(Actor(encoder, body, nn.Identity()), in_keys=encoder_keys(encoder))


def critic_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """An action value for TorchRL's losses."""
    return ValueOperator(Critic(encoder, body), in_keys=[*encoder_keys(encoder), "action"])
