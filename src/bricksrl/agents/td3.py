"""Twin delayed deep deterministic policy gradient, lean as our SAC; TorchRL's ``TD3Loss`` is its oracle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import StackedCritics, make_deterministic_actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent, step
from bricksrl.agents.presets import TD3Settings

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class TD3Agent(OffPolicyAgent):
    """TD3 for one robot; see `TD3Settings`."""

    loss_names = ("critic_loss", "actor_loss")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: TD3Settings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size = self.encoder.size
        self.actor, self.target_actor = (make_deterministic_actor(size, action_size, settings.hidden) for _ in range(2))
        self.critics, self.target_critics = (
            StackedCritics(size, action_size, settings.hidden, layer_norm=settings.layer_norm) for _ in range(2)
        )
        for network, target in ((self.actor, self.target_actor), (self.critics, self.target_critics)):
            target.load_state_dict(network.state_dict())
            target.requires_grad_(False)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        self._target_parameters: list[Tensor] = [*self.target_critics.parameters(), *self.target_actor.parameters()]
        parameters = [*self._critic_parameters, *self._actor_parameters]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """The actor's action ``[m]``, with noise on it when it is to ``explore``."""
        with torch.no_grad():
            action: Tensor = self.actor(self.encoder(observation))
            if explore:
                action += self.settings.exploration_noise * torch.randn_like(action)
            return action.clamp_(-1.0, 1.0)

    def critic_loss(self, batch: Batch) -> Tensor:
        """Loss of the critics on a batch."""
        settings = self.settings
        with torch.no_grad():
            noise = (settings.target_noise * torch.randn_like(batch.action)).clamp_(
                -settings.target_noise_limit, settings.target_noise_limit
            )
            next_action = (self.target_actor(batch.next_features) + noise).clamp_(-1.0, 1.0)
            next_value = self.target_critics(batch.next_features, next_action).amin(0)
            target = batch.reward + settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        loss: Tensor = (self.critics(batch.features, batch.action) - target).square().mean(-1).sum()
        return loss

    def actor_loss(self, batch: Batch) -> Tensor:
        """Loss of the actor on a batch: what the first critic thinks of its actions."""
        loss: Tensor = -self.critics(batch.features, self.actor(batch.features), first=1).mean()
        return loss

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` only the first."""
        critic_loss = self.critic_loss(batch)
        if not actor:
            step(self._optimiser, (critic_loss, self._critic_parameters))
            return (critic_loss.detach(),)
        actor_loss = self.actor_loss(batch)
        step(self._optimiser, (critic_loss, self._critic_parameters), (actor_loss, self._actor_parameters))
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, [*self._critic_parameters, *self._actor_parameters], self.settings.tau)
        return critic_loss.detach(), actor_loss.detach()

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "actor": self.actor,
            "target_actor": self.target_actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "optimiser": self._optimiser,
        }
