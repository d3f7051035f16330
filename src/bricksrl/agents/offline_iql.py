"""Implicit Q-learning (Kostrikov et al. 2021): no action is ever valued that the data does not have.

A state's value is an expectile of the values of the actions that were taken there, and the actor imitates those actions, the
better ones more. TorchRL's ``IQLLoss`` is the oracle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import step
from bricksrl.agents.networks import StackedCritics, make_deterministic_actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent
from bricksrl.agents.presets import IQLSettings

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

MAX_WEIGHT = 100.0
"""Limit of the weight of an imitated action, as its authors have it."""
LOG_SCALE = (-5.0, 2.0)
"""Limits of the logarithm of the policy's deviation, as its authors have them."""


class GaussianActor(nn.Module):
    """Features ``[*batch, f]`` to the mean ``[*batch, m]`` in -1..1 of a normal, whose deviation is the same everywhere."""

    def __init__(self, feature_size: int, action_size: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.mean = make_deterministic_actor(feature_size, action_size, hidden)
        self.log_scale = nn.Parameter(torch.zeros(action_size))

    def scale(self) -> Tensor:
        """The deviation ``[m]``."""
        return torch.exp(self.log_scale.clamp(*LOG_SCALE))

    def forward(self, features: Tensor) -> Tensor:
        mean: Tensor = self.mean(features)
        return mean

    def log_prob(self, features: Tensor, action: Tensor) -> Tensor:
        """Log-density ``[*batch]`` of actions ``[*batch, m]``."""
        log_scale = self.log_scale.clamp(*LOG_SCALE)
        z = (action - self.mean(features)) / log_scale.exp()
        log_density: Tensor = -0.5 * z.square() - log_scale - 0.5 * math.log(2 * math.pi)
        return log_density.sum(-1)


class IQLAgent(OffPolicyAgent):
    """IQL for one robot; see `IQLSettings`."""

    actor: GaussianActor
    loss_names = ("critic_loss", "value_loss", "actor_loss")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: IQLSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, hidden, layer_norm = self.encoder.size, settings.hidden, settings.layer_norm
        self.actor = GaussianActor(size, action_size, hidden)
        self.critics, self.target_critics = (StackedCritics(size, action_size, hidden, layer_norm=layer_norm) for _ in range(2))
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.target_critics.requires_grad_(False)
        self.value = StackedCritics(size, 0, hidden, layer_norm=layer_norm, k=1)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._target_parameters: list[Tensor] = list(self.target_critics.parameters())
        self._value_parameters: list[Tensor] = list(self.value.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        parameters = [*self._critic_parameters, *self._value_parameters, *self._actor_parameters]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """The mean of the policy ``[m]``, with ``explore`` a draw."""
        with torch.no_grad():
            action = self.actor(self.encoder(observation))
            if explore:
                action = torch.addcmul(action, self.actor.scale(), torch.randn_like(action))
            return torch.clamp(action, -1.0, 1.0)

    def value_of(self, features: Tensor) -> Tensor:
        """Values ``[batch]`` of states."""
        values: Tensor = self.value(features, features[:, :0])
        return values[0]

    def losses(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Losses of critics, values and actor on a batch."""
        settings = self.settings
        with torch.no_grad():
            next_value = self.value_of(batch.next_features)
            target = batch.reward + settings.gamma * torch.where(batch.terminated, 0.0, next_value)
            taken = self.target_critics(batch.features, batch.action).amin(0)
        critic_loss = (self.critics(batch.features, batch.action) - target).square().mean(-1).sum()
        advantage = taken - self.value_of(batch.features)
        share = torch.where(advantage > 0, settings.expectile, 1.0 - settings.expectile)
        value_loss = (share * advantage.square()).mean()
        weight = (settings.temperature * advantage.detach()).exp().clamp_max(MAX_WEIGHT)
        actor_loss = -(weight * self.actor.log_prob(batch.features, batch.action)).mean()
        return critic_loss, value_loss, actor_loss

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` all but the last."""
        critic_loss, value_loss, actor_loss = self.losses(batch)
        critics = ((critic_loss, self._critic_parameters), (value_loss, self._value_parameters))
        if actor:
            step(self._optimiser, *critics, (actor_loss, self._actor_parameters))
        else:
            step(self._optimiser, *critics)
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, self._critic_parameters, self.settings.tau)
        numbers = critic_loss.detach(), value_loss.detach(), actor_loss.detach()
        return numbers if actor else numbers[:2]

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "value": self.value,
            "optimiser": self._optimiser,
        }
