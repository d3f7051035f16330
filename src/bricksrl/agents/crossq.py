"""CrossQ: soft actor-critic whose batch-normalised critics need no targets; TorchRL's ``CrossQLoss`` is its oracle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import StackedCritics, make_normalised_actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent, step
from bricksrl.agents.presets import CrossQSettings
from bricksrl.agents.sac import Temperature, sample_action

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class CrossQAgent(OffPolicyAgent):
    """CrossQ for one robot; see `CrossQSettings`.

    Between updates actor and critics are in evaluation: they normalise by running statistics. The critics learn from this step
    and the next in one batch, so that one statistic serves both.
    """

    loss_names = ("critic_loss", "actor_loss", "entropy", "alpha")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: CrossQSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, momentum = self.encoder.size, settings.momentum
        self.actor = make_normalised_actor(size, action_size, settings.hidden, settings.min_scale, momentum).eval()
        self.critics = StackedCritics(size, action_size, settings.hidden, batch_norm=momentum).eval()
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        parameters = [*self._critic_parameters, *self._actor_parameters, self.temperature.log_alpha]
        betas = (settings.adam_beta, 0.999)
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A drawn action ``[m]`` with ``explore``, else the mode of the policy."""
        with torch.no_grad():
            loc, scale = self.actor(self.encoder(observation)[None])
            x = torch.addcmul(loc, scale, torch.randn_like(loc)) if explore else loc
            return x[0].tanh()

    def critic_loss(self, batch: Batch) -> Tensor:
        """Loss of the critics on a batch; their running statistics move with it."""
        n = batch.features.shape[0]
        with torch.no_grad():
            next_action, next_log_prob = sample_action(*self.actor(batch.next_features))
        self.critics.train()
        both = self.critics(torch.cat((batch.features, batch.next_features)), torch.cat((batch.action, next_action)))
        self.critics.eval()
        next_value = both[:, n:].detach().amin(0) - self.temperature.alpha() * next_log_prob
        target = batch.reward + self.settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        loss: Tensor = (both[:, :n] - target).square().mean(-1).sum()
        return loss

    def actor_loss(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Loss of the actor on a batch, whose running statistics move with it, and its entropy there, a constant."""
        self.actor.train()
        action, log_prob = sample_action(*self.actor(batch.features))
        self.actor.eval()
        value = self.critics(batch.features, action).amin(0)
        return (self.temperature.alpha() * log_prob - value).mean(), -log_prob.detach().mean()

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` only the first."""
        critic_loss = self.critic_loss(batch)
        if not actor:
            step(self._optimiser, (critic_loss, self._critic_parameters))
            return (critic_loss.detach(),)
        actor_loss, entropy = self.actor_loss(batch)
        step(
            self._optimiser,
            (critic_loss, self._critic_parameters),
            (actor_loss, self._actor_parameters),
            (self.temperature.loss(entropy), [self.temperature.log_alpha]),
        )
        return critic_loss.detach(), actor_loss.detach(), entropy, self.temperature.alpha()

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "temperature": self.temperature,
            "optimiser": self._optimiser,
        }
