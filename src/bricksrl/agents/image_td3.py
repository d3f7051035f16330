"""TD3 from images: the losses of `td3`, over the features of an encoder that the critics teach."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bricksrl.agents.image_agent import ImageAgent
from bricksrl.agents.image_presets import ImageTD3Settings
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import step
from bricksrl.agents.networks import StackedCritics, make_deterministic_actor
from bricksrl.agents.off_policy import Batch


class ImageTD3Agent(ImageAgent):
    """TD3 for one robot before a camera; see `ImageTD3Settings`."""

    loss_names = ("critic_loss", "actor_loss")

    def __init__(self, layout: ObservationLayout, side_px: int, action_size: int, settings: ImageTD3Settings) -> None:
        super().__init__(layout, side_px, action_size, settings)
        self.settings = settings
        size, hidden = self.encoder.size, settings.hidden
        self.actor, self.target_actor = (make_deterministic_actor(size, action_size, hidden) for _ in range(2))
        self.critics, self.target_critics = (
            StackedCritics(size, action_size, hidden, layer_norm=settings.layer_norm) for _ in range(2)
        )
        for network, target in ((self.actor, self.target_actor), (self.critics, self.target_critics)):
            target.load_state_dict(network.state_dict())
            target.requires_grad_(False)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._encoder_parameters: list[Tensor] = list(self.encoder.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        self._target_parameters: list[Tensor] = [*self.target_critics.parameters(), *self.target_actor.parameters()]
        parameters = [*self._encoder_parameters, *self._critic_parameters, *self._actor_parameters]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def choose(self, features: Tensor, *, explore: bool) -> Tensor:
        """The actor's actions ``[batch, m]``, with noise on them where it is to ``explore``."""
        action: Tensor = self.actor(features)
        if explore:
            action = action + self.settings.exploration_noise * torch.randn_like(action)
        return action.clamp(-1.0, 1.0)

    def critic_loss(self, batch: Batch) -> Tensor:
        """Loss of the critics, and of the encoder."""
        settings = self.settings
        with torch.no_grad():
            limit = settings.target_noise_limit
            noise = (settings.target_noise * torch.randn_like(batch.action)).clamp_(-limit, limit)
            next_action = (self.target_actor(batch.next_features) + noise).clamp_(-1.0, 1.0)
            next_value = self.target_critics(batch.next_features, next_action).amin(0)
            target = batch.reward + settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        loss: Tensor = (self.critics(batch.features, batch.action) - target).square().mean(-1).sum()
        return loss

    def actor_loss(self, batch: Batch) -> Tensor:
        """Loss of the actor, which leaves the encoder as it is: what the first critic thinks of its actions."""
        features = batch.features.detach()
        loss: Tensor = -self.critics(features, self.actor(features), first=1).mean()
        return loss

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` only the first."""
        critic_loss = self.critic_loss(batch)
        seeing = (critic_loss, [*self._encoder_parameters, *self._critic_parameters])
        if not actor:
            step(self._optimiser, seeing)
            return (critic_loss.detach(),)
        actor_loss = self.actor_loss(batch)
        step(self._optimiser, seeing, (actor_loss, self._actor_parameters))
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, [*self._critic_parameters, *self._actor_parameters], self.settings.tau)
        return critic_loss.detach(), actor_loss.detach()

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "encoder": self.encoder,
            "actor": self.actor,
            "target_actor": self.target_actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "optimiser": self._optimiser,
        }
