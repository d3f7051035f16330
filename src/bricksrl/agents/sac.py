"""Soft actor-critic with a learned temperature, gradients by hand; DroQ and REDQ are settings of it.

TorchRL's ``SACLoss`` is its oracle: from the same batches and noise come the same losses, gradients and networks.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.lean.critics import climb_least, climb_mean, descend
from bricksrl.agents.lean.flat import Flat, Learned, working_type
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import StackedCritics, make_actor
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import SACSettings
from bricksrl.agents.soft import SoftAgent, Temperature

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class SACAgent(SoftAgent):
    """SAC for one robot; see `SACSettings`."""

    settings: SACSettings

    def __init__(self, layout: ObservationLayout, action_size: int, settings: SACSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, hidden, count = self.encoder.size, settings.hidden, settings.critics
        self.actor = make_actor(size, action_size, hidden, settings.min_scale, layer_norm=settings.actor_layer_norm)
        options: dict[str, Any] = {"layer_norm": settings.layer_norm, "dropout": settings.dropout, "k": count}
        self.critics, self.target_critics = (StackedCritics(size, action_size, hidden, **options) for _ in range(2))
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)

        dtype = working_type(settings.precision)
        learned = functools.partial(Learned, learning_rate=settings.learning_rate, adam_beta=settings.adam_beta, dtype=dtype)
        self.learned_actor, self.learned_critics = learned(self.actor, self.temperature), learned(self.critics)
        self._targets = Flat(self.target_critics, dtype=dtype)
        self.flats = self.learned_actor, self.learned_critics, self._targets
        self.make_passes()
        self._judging = Pass(self.critics, settings.batch_size, self.learned_critics, sought=slice(size, None))
        nets = [slice(None)] if settings.target_critics == count else [slice(net, net + 1) for net in range(count)]
        self._aiming = [Pass(self.target_critics, settings.batch_size, self._targets, nets=one) for one in nets]

    def target(self, batch: Batch, next_action: Tensor, next_log_prob: Tensor) -> Tensor:
        """What the critics are to say ``[batch]``: the reward and the soft value of what follows."""
        chosen = self._aiming
        if len(chosen) > 1:
            chosen = [chosen[net] for net in torch.randperm(len(chosen))[: self.settings.target_critics].tolist()]
        values = [critics.forward(batch.next_features, next_action) for critics in chosen]
        next_value = (values[0] if len(values) == 1 else torch.cat(values)).amin(0)[:, 0]
        soft_value = torch.sub(next_value, next_log_prob, alpha=self.temperature.weight())
        return torch.where(batch.terminated, batch.reward, torch.add(batch.reward, soft_value, alpha=self.settings.gamma))

    def descend_critics(self, batch: Batch, next_action: Tensor, next_log_prob: Tensor) -> tuple[Tensor, ...]:
        """Gradients of the critics' squared errors; returns their sum."""
        target = self.target(batch, next_action, next_log_prob)
        return (descend(self._judging, batch.features, batch.action, target),)

    def climb(self, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """The least of the critics' values, or the mean, and its gradient by the actions."""
        climb = climb_least if self.settings.actor_value == "min" else climb_mean
        return climb(self._judging, features, action)

    def move_critics(self) -> None:
        """A step of the critics, and a smaller one of their targets after them."""
        self.learned_critics.step()
        self._targets.follow(self.learned_critics, self.settings.tau)

    def _parts(self) -> dict[str, Any]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "temperature": self.temperature,
            "adam_of_actor": self.learned_actor,
            "adam_of_critics": self.learned_critics,
        }
