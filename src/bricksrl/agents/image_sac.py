"""Soft actor-critic from images: the losses of `sac`, over the features of an encoder that the critics teach."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bricksrl.agents.image_agent import ImageAgent
from bricksrl.agents.image_presets import ImageSACSettings
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import step
from bricksrl.agents.networks import StackedCritics, make_actor
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.soft import Temperature, sample_action


class ImageSACAgent(ImageAgent):
    """SAC for one robot before a camera; see `ImageSACSettings`."""

    loss_names = ("critic_loss", "actor_loss", "entropy", "alpha")

    def __init__(self, layout: ObservationLayout, side_px: int, action_size: int, settings: ImageSACSettings) -> None:
        super().__init__(layout, side_px, action_size, settings)
        self.settings = settings
        size = self.encoder.size
        self.actor = make_actor(size, action_size, settings.hidden, settings.min_scale)
        self.critics, self.target_critics = (
            StackedCritics(size, action_size, settings.hidden, layer_norm=settings.layer_norm) for _ in range(2)
        )
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.target_critics.requires_grad_(False)
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._encoder_parameters: list[Tensor] = list(self.encoder.parameters())
        self._target_parameters: list[Tensor] = list(self.target_critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        parameters = [*self._encoder_parameters, *self._critic_parameters, *self._actor_parameters, self.temperature.log_alpha]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def choose(self, features: Tensor, *, explore: bool) -> Tensor:
        """Drawn actions ``[batch, m]`` with ``explore``, else the mode of the policy."""
        loc, scale = self.actor(features)
        return (torch.addcmul(loc, scale, torch.randn_like(loc)) if explore else loc).tanh()

    def critic_loss(self, batch: Batch) -> Tensor:
        """Loss of the critics, and of the encoder."""
        with torch.no_grad():
            next_action, next_log_prob = sample_action(*self.actor(batch.next_features))
            next_value = self.target_critics(batch.next_features, next_action).amin(0)
            next_value = next_value - self.temperature.alpha() * next_log_prob
            target = batch.reward + self.settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        loss: Tensor = (self.critics(batch.features, batch.action) - target).square().mean(-1).sum()
        return loss

    def actor_loss(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Loss of the actor, which leaves the encoder as it is, and the policy's entropy, a constant."""
        features = batch.features.detach()
        action, log_prob = sample_action(*self.actor(features))
        value = self.critics(features, action).amin(0)
        return (self.temperature.alpha() * log_prob - value).mean(), -log_prob.detach().mean()

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` only the first."""
        critic_loss = self.critic_loss(batch)
        seeing = (critic_loss, [*self._encoder_parameters, *self._critic_parameters])
        numbers: tuple[Tensor, ...] = (critic_loss.detach(),)
        if actor:
            actor_loss, entropy = self.actor_loss(batch)
            alpha_loss = self.temperature.loss(entropy)
            step(self._optimiser, seeing, (actor_loss, self._actor_parameters), (alpha_loss, [self.temperature.log_alpha]))
            numbers = (*numbers, actor_loss.detach(), entropy, self.temperature.alpha())
        else:
            step(self._optimiser, seeing)
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, self._critic_parameters, self.settings.tau)
        return numbers

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "encoder": self.encoder,
            "actor": self.actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "temperature": self.temperature,
            "optimiser": self._optimiser,
        }
