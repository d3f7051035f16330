"""TD3+BC: TD3 whose actor stays near the data (Fujimoto and Gu 2021); TorchRL's ``TD3BCLoss`` is its oracle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import TD3BCSettings
from bricksrl.agents.td3 import TD3Agent

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class TD3BCAgent(TD3Agent):
    """TD3+BC for one robot; see `TD3BCSettings`."""

    def __init__(self, layout: ObservationLayout, action_size: int, settings: TD3BCSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self._value_weight = settings.value_weight

    def actor_loss(self, batch: Batch, action: Tensor) -> tuple[Tensor, Tensor]:
        """What the first critic thinks of the actor's actions, against how far they are from those of the data; its gradient."""
        values, of_action = self.values(batch.features, action)
        weight = self._value_weight / values.abs().mean()
        away = action - batch.action
        return away.square().mean() - weight * values.mean(), away * (2.0 / away.numel()) - weight * of_action
