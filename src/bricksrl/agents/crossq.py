"""CrossQ: soft actor-critic whose batch-normalised critics need no targets; TorchRL's ``CrossQLoss`` is its oracle."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.lean.critics import climb_least
from bricksrl.agents.lean.flat import Learned, working_type
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import StackedCritics, make_normalised_actor
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import CrossQSettings
from bricksrl.agents.soft import SoftAgent, Temperature

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class CrossQAgent(SoftAgent):
    """CrossQ for one robot; see `CrossQSettings`.

    Actions are chosen by running statistics. The critics learn from this step and the next in one batch, so that one statistic
    serves both; what the actor climbs are the critics by their running statistics.
    """

    settings: CrossQSettings

    def __init__(self, layout: ObservationLayout, action_size: int, settings: CrossQSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, hidden, momentum = self.encoder.size, settings.hidden, settings.momentum
        self.actor = make_normalised_actor(size, action_size, hidden, settings.min_scale, momentum).eval()
        self.critics = StackedCritics(size, action_size, hidden, batch_norm=momentum).eval()
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)

        dtype = working_type(settings.precision)
        learned = functools.partial(Learned, learning_rate=settings.learning_rate, adam_beta=settings.adam_beta, dtype=dtype)
        self.learned_actor, self.learned_critics = learned(self.actor, self.temperature), learned(self.critics)
        self.flats = self.learned_actor, self.learned_critics
        self.make_passes()
        self._judging = Pass(self.critics, 2 * settings.batch_size, self.learned_critics)
        self._leading = Pass(self.critics, settings.batch_size, self.learned_critics, training=False, sought=slice(size, None))

    def descend_critics(self, batch: Batch, next_action: Tensor, next_log_prob: Tensor) -> tuple[Tensor, ...]:
        """Gradients of the critics' squared errors, and their running statistics; returns the sum of the errors."""
        features, action = torch.cat((batch.features, batch.next_features)), torch.cat((batch.action, next_action))
        rows = len(batch.reward)
        values = self._judging.forward(features, action)[..., 0]
        next_value = torch.sub(values[:, rows:].amin(0), next_log_prob, alpha=self.temperature.weight())
        target = batch.reward + self.settings.gamma * torch.where(batch.terminated, 0.0, next_value)
        errors = values[:, :rows] - target
        of_values = torch.cat((errors * (2.0 / rows), torch.zeros_like(errors)), 1)
        self._judging.backward(of_values[..., None])
        return (errors.square().sum() / rows,)

    def climb(self, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """The lesser of the critics' values and its gradient by the actions."""
        return climb_least(self._leading, features, action)

    def move_critics(self) -> None:
        """A step of the critics."""
        self.learned_critics.step()

    def _parts(self) -> dict[str, Any]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "temperature": self.temperature,
            "adam_of_actor": self.learned_actor,
            "adam_of_critics": self.learned_critics,
        }
