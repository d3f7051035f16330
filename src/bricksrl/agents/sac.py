"""Soft actor-critic with a learned temperature, written out; DroQ and REDQ are settings of it.

TorchRL's ``SACLoss`` computes the same losses (the tests hold the two together) in more than twice the time for networks of this
size. The robot waits for its agent to learn, so this one is lean: critics side by side, three gradients, one fused Adam.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import StackedCritics, make_actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent, step
from bricksrl.agents.presets import SACSettings

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


def sample_action(loc: Tensor, scale: Tensor) -> tuple[Tensor, Tensor]:
    """A reparametrised draw ``[*batch, m]`` from a tanh-squashed normal, and its log-probability ``[*batch]``."""
    noise = torch.randn_like(loc)
    x = torch.addcmul(loc, scale, noise)
    log_normal = -0.5 * noise.square() - scale.log() - 0.5 * math.log(2 * math.pi)
    # log(1 - tanh(x)^2), written so that it stays finite where tanh saturates
    log_slope = 2.0 * (math.log(2.0) - x - functional.softplus(-2.0 * x))
    return x.tanh(), (log_normal - log_slope).sum(-1)


class Temperature(nn.Module):
    """The weight of the entropy, learned so that the entropy stays at ``target_entropy``."""

    def __init__(self, initial: float, target_entropy: float) -> None:
        super().__init__()
        self.log_alpha = nn.Parameter(torch.tensor(math.log(initial)))
        self.target_entropy = target_entropy

    def alpha(self) -> Tensor:
        """The temperature, as a constant."""
        return self.log_alpha.detach().exp()

    def loss(self, entropy: Tensor) -> Tensor:
        """What to descend for an entropy, a constant."""
        return self.log_alpha * (entropy - self.target_entropy)


class SACAgent(OffPolicyAgent):
    """SAC for one robot; see `SACSettings`."""

    loss_names = ("critic_loss", "actor_loss", "entropy", "alpha")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: SACSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        self.actor = make_actor(self.encoder.size, action_size, settings.hidden, settings.min_scale)
        self.critics, self.target_critics = (
            StackedCritics(
                self.encoder.size,
                action_size,
                settings.hidden,
                layer_norm=settings.layer_norm,
                dropout=settings.dropout,
                k=settings.critics,
            )
            for _ in range(2)
        )
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.target_critics.requires_grad_(False)
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._target_parameters: list[Tensor] = list(self.target_critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        parameters = [*self._critic_parameters, *self._actor_parameters, self.temperature.log_alpha]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A drawn action ``[m]`` with ``explore``, else the mode of the policy."""
        with torch.no_grad():
            loc, scale = self.actor(self.encoder(observation))
            x = torch.addcmul(loc, scale, torch.randn_like(loc)) if explore else loc
            return x.tanh()

    def losses(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Losses of critics, actor and temperature on a batch, and the policy's entropy there (all without shape)."""
        critic_loss = self.critic_loss(batch)
        action, log_prob = sample_action(*self.actor(batch.features))
        values = self.critics(batch.features, action)
        value = values.amin(0) if self.settings.actor_value == "min" else values.mean(0)
        actor_loss = (self.temperature.alpha() * log_prob - value).mean()
        entropy = -log_prob.detach().mean()
        return critic_loss, actor_loss, self.temperature.loss(entropy), entropy

    def critic_loss(self, batch: Batch) -> Tensor:
        """Loss of the critics alone."""
        with torch.no_grad():
            next_action, next_log_prob = sample_action(*self.actor(batch.next_features))
            next_values = self.target_critics(batch.next_features, next_action)
            if self.settings.target_critics < self.settings.critics:
                next_values = next_values[torch.randperm(self.settings.critics)[: self.settings.target_critics]]
            next_value = next_values.amin(0) - self.temperature.alpha() * next_log_prob
            target = batch.reward + self.settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        loss: Tensor = (self.critics(batch.features, batch.action) - target).square().mean(-1).sum()
        return loss

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` only the first."""
        if actor:
            critic_loss, actor_loss, alpha_loss, entropy = self.losses(batch)
            step(
                self._optimiser,
                (critic_loss, self._critic_parameters),
                (actor_loss, self._actor_parameters),  # it passes through the critics and must not move them
                (alpha_loss, [self.temperature.log_alpha]),
            )
            numbers: tuple[Tensor, ...] = (critic_loss, actor_loss, entropy, self.temperature.alpha())
        else:
            critic_loss = self.critic_loss(batch)
            step(self._optimiser, (critic_loss, self._critic_parameters))
            numbers = (critic_loss,)
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, self._critic_parameters, self.settings.tau)
        return tuple(number.detach() for number in numbers)

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "temperature": self.temperature,
            "optimiser": self._optimiser,
        }
