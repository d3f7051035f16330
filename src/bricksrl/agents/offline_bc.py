"""Behaviour cloning: the actor learns to do what the dataset did; TorchRL's ``BCLoss`` is its oracle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from bricksrl.agents.agent import Transition
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import step
from bricksrl.agents.networks import Dropout
from bricksrl.agents.off_policy import Batch, OffPolicyAgent
from bricksrl.agents.presets import BCSettings

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class BCAgent(OffPolicyAgent):
    """Behaviour cloning for one robot; see `BCSettings`. What it does itself teaches it nothing."""

    loss_names = ("actor_loss",)

    def __init__(self, layout: ObservationLayout, action_size: int, settings: BCSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        self.actor = make_imitator(self.encoder.size, action_size, settings).eval()
        betas = (settings.adam_beta, 0.999)
        self._parameters: list[Tensor] = list(self.actor.parameters())
        self._optimiser = torch.optim.Adam(self._parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """The actor's action ``[m]``; it never explores."""
        with torch.no_grad():
            action: Tensor = self.actor(self.encoder(observation))
            return action

    def remember(self, transition: Transition) -> None:
        """Forget it: there is nothing to imitate in what the imitator did."""

    def actor_loss(self, batch: Batch) -> Tensor:
        """Mean squared distance between the actor's and the dataset's actions."""
        return functional.mse_loss(self.actor(batch.features), batch.action)

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update."""
        self.actor.train()
        loss = self.actor_loss(batch)
        step(self._optimiser, (loss, self._parameters))
        self.actor.eval()
        return (loss.detach(),)

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {"actor": self.actor, "optimiser": self._optimiser}


class _Dropout(Dropout):
    """Dropout in training, nothing in evaluation."""

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x) if self.training else x


def make_imitator(feature_size: int, action_size: int, settings: BCSettings) -> nn.Sequential:
    """A network from features ``[*batch, f]`` to actions ``[*batch, m]`` in -1..1."""
    layers: list[nn.Module] = []
    size = feature_size
    for units in settings.hidden:
        layers.append(nn.Linear(size, units))
        if settings.dropout > 0:
            layers.append(_Dropout(settings.dropout))
        if settings.layer_norm:
            layers.append(nn.LayerNorm(units))
        layers.append(nn.ReLU())
        size = units
    return nn.Sequential(*layers, nn.Linear(size, action_size), nn.Tanh())
