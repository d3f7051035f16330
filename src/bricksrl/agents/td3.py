"""Twin delayed deep deterministic policy gradient, gradients by hand as in our SAC; TorchRL's ``TD3Loss`` is its oracle."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.lean.agent import LeanAgent
from bricksrl.agents.lean.critics import descend
from bricksrl.agents.lean.flat import Flat, Learned, working_type
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.networks import StackedCritics, make_deterministic_actor
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import TD3Settings

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class TD3Agent(LeanAgent):
    """TD3 for one robot; see `TD3Settings`."""

    loss_names = ("critic_loss", "actor_loss")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: TD3Settings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, hidden = self.encoder.size, settings.hidden
        self.actor, self.target_actor = (
            make_deterministic_actor(size, action_size, hidden, layer_norm=settings.actor_layer_norm) for _ in range(2)
        )
        self.critics, self.target_critics = (
            StackedCritics(size, action_size, hidden, layer_norm=settings.layer_norm) for _ in range(2)
        )
        self.target_actor.load_state_dict(self.actor.state_dict())
        self.target_critics.load_state_dict(self.critics.state_dict())

        dtype = working_type(settings.precision)
        learned = functools.partial(Learned, learning_rate=settings.learning_rate, adam_beta=settings.adam_beta, dtype=dtype)
        self.learned_critics, self.learned_actor = learned(self.critics), learned(self.actor)
        self._targets, self._target = Flat(self.target_critics, dtype=dtype), Flat(self.target_actor, dtype=dtype)
        self.flats = self.learned_critics, self.learned_actor, self._targets, self._target
        rows, body = settings.batch_size, self.actor.body
        self._acting = Pass(body, 1)
        self._foreseeing = functools.cache(functools.partial(Pass, self.target_actor.body, flat=self._target))
        self._aiming = functools.cache(functools.partial(Pass, self.target_critics, flat=self._targets))
        self._judging = Pass(self.critics, rows, self.learned_critics)
        self._climbing = Pass(body, rows, self.learned_actor)
        self._leading = Pass(self.critics, rows, self.learned_critics, nets=slice(1), sought=slice(size, None))

    def begin_with_actor(self) -> None:
        """As any agent, and the target begins with it too."""
        self.target_actor.load_state_dict(self.actor.state_dict())
        super().begin_with_actor()

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """The actor's action ``[m]``, with noise on it when it is to ``explore``."""
        with torch.no_grad():
            action = self._acting.forward(self.encoder.forward(observation)[None])[0, 0].tanh()
            if explore:
                action += self.settings.exploration_noise * torch.randn_like(action)
            return action.clamp_(-1.0, 1.0)

    @torch.no_grad()
    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update of the critics with each batch, of the actor and all targets with the last."""
        targets = self.targets(batches)
        found = [self.descend_critics(batch, target) for batch, target in zip(batches, targets, strict=True)]
        if actor:
            found[-1] += self.descend_actor(batches[-1])
            self._targets.follow(self.learned_critics, self.settings.tau)
            self._target.follow(self.learned_actor, self.settings.tau)
        return found

    def targets(self, batches: Sequence[Batch]) -> Sequence[Tensor]:
        """What the critics are to say of each batch, ``[batch]``: all at once, as the targets wait for the actor too."""
        settings = self.settings
        features = torch.cat([batch.next_features for batch in batches])
        action = self._foreseeing(len(features)).forward(features)[0].tanh_()
        noise = (settings.target_noise * torch.randn_like(action)).clamp_(
            -settings.target_noise_limit, settings.target_noise_limit
        )
        action = (action + noise).clamp_(-1.0, 1.0)
        values = self._aiming(len(features)).forward(features, action).amin(0)
        return [
            batch.reward + settings.gamma * torch.where(batch.terminated, 0.0, value)
            for batch, value in zip(batches, values.view(len(batches), -1), strict=True)
        ]

    def descend_critics(self, batch: Batch, target: Tensor) -> tuple[Tensor, ...]:
        """A step of the critics down their squared errors; returns the sum of these."""
        loss = descend(self._judging, batch.features, batch.action, target)
        self.learned_critics.step()
        return (loss,)

    def descend_actor(self, batch: Batch) -> tuple[Tensor, ...]:
        """A step of the actor down its loss; returns that."""
        outputs = self._climbing.forward(batch.features)[0]
        action = outputs.tanh()
        loss, of_action = self.actor_loss(batch, action)
        of_outputs = of_action * (1.0 - action.square())
        self.pull(batch.features, outputs, of_outputs)
        self._climbing.backward(of_outputs[None])
        self.learned_actor.step()
        return (loss,)

    def actor_loss(self, batch: Batch, action: Tensor) -> tuple[Tensor, Tensor]:
        """Loss of the actor for actions ``[batch, m]``, and its gradient by them: what the first critic thinks of them."""
        values, of_action = self.values(batch.features, action)
        return -values.mean(), -of_action

    def values(self, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """The first critic's values ``[batch]``, and the gradient ``[batch, m]`` of their mean by the actions."""
        values = self._leading.forward(features, action)
        of_action = self._leading.backward(torch.full_like(values, 1.0 / len(action)), weights=False, inputs=True)
        return values[0, :, 0], of_action[0]

    def _parts(self) -> dict[str, Any]:
        return {
            "actor": self.actor,
            "target_actor": self.target_actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "adam_of_actor": self.learned_actor,
            "adam_of_critics": self.learned_critics,
        }
