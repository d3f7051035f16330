"""The policy of one agent as that of another, which goes on learning in its own way."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from bricksrl.agents.agent import Agent
from bricksrl.agents.lean.agent import LeanAgent
from bricksrl.agents.lean.gaussian import LEAST_SCALE, SCALE_SHIFT
from bricksrl.agents.networks import StackedBatchNorm, StackedLayerNorm, StackedLinear
from bricksrl.agents.off_policy import OffPolicyAgent
from bricksrl.agents.soft import SoftAgent

ROOM = 1.2
"""Deviation of the actions where the policy had none, as a multiple of the least one: below that it could not be learned."""
ALPHA = 0.01
"""Temperature at most where the policy had none: entropy is not to outweigh what the policy can do; it is learned from there."""


class PolicyFormError(Exception):
    """One network cannot stand for the other; whoever knows where they are from tells the user."""


@torch.no_grad()
def take_policy(agent: Agent, other: Agent) -> None:
    """Make the policy of ``other`` that of ``agent``, which has learned nothing yet and is held near it at first.

    A policy with a deviation of its own keeps it where the agent has one, and so does the temperature.

    Raises:
        PolicyFormError: their networks differ in form.
    """
    if not (isinstance(agent, LeanAgent) and isinstance(other, OffPolicyAgent)):
        raise PolicyFormError("that takes a network from observations to one action, and critics to learn on with")
    mine, theirs = _layers(agent.actor), _layers(other.actor)
    here, there = (f"{_form(layers)} on {one.sight}" for layers, one in ((mine, agent), (theirs, other)))
    if here != there:
        raise PolicyFormError(f"its network is {there}, not {here}")
    for to, of in zip(mine, theirs, strict=True):
        size = min(to.shape[-1], of.shape[-1])
        to[..., :size] = of[..., :size]
    if isinstance(agent, SoftAgent):
        size = mine[-1].shape[-1] // 2
        if len(theirs[-1]) == size:
            mine[-2][:, size:] = 0.0
            mine[-1][size:] = math.log(math.expm1(ROOM * agent.settings.min_scale - LEAST_SCALE)) - SCALE_SHIFT
        temperature = getattr(other, "temperature", None)
        log_alpha = agent.temperature.log_alpha
        log_alpha.copy_(log_alpha.clamp_max(math.log(ALPHA)) if temperature is None else temperature.log_alpha)
    agent.begin_with_actor()


def _layers(network: nn.Module) -> list[Tensor]:
    """The parameters of its layers in their order, ``[in, out]`` and ``[out]``, as views."""
    found: list[Tensor] = []
    for layer in network.modules():
        if isinstance(layer, nn.Linear):
            found += [layer.weight.mT, layer.bias]
        elif isinstance(layer, StackedLinear):
            found += [layer.weight[0], layer.bias[0, 0]]
        elif isinstance(layer, nn.LayerNorm | StackedLayerNorm | StackedBatchNorm):
            found += [layer.weight.view(-1), layer.bias.view(-1)]
    return found


def _form(layers: list[Tensor]) -> str:
    """What has to be equal, in words: all but how many numbers come out."""
    weights = [part for part in layers if part.ndim > 1]
    normalised = len(layers) // 2 - len(weights)
    return "-".join(str(len(weight)) for weight in weights) + (
        f" units with {normalised} normalisations" if normalised else " units"
    )
