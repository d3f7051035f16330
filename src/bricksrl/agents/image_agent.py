"""What the agents share that learn from images: remembering, drawing batches, the order of updates, and their state.

What they are given as an observation is a TensorDict of ``observation`` ``[n]`` and ``image``, uint8 ``[side, side, 3]``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from bricksrl.agents.agent import Transition
from bricksrl.agents.image_networks import SightEncoder, shifted
from bricksrl.agents.image_presets import ImageSettings
from bricksrl.agents.image_replay import ImageReplay
from bricksrl.agents.layout import ObservationLayout
from bricksrl.errors import CheckpointError


@dataclass(frozen=True)
class SightBatch:
    """Transitions: ``features`` ``[batch, f]``, that carry the encoder's gradient, ``next_features``, that carry none,
    ``action`` ``[batch, m]``, ``reward`` and ``terminated`` (bool) ``[batch]``."""

    features: Tensor
    action: Tensor
    reward: Tensor
    next_features: Tensor
    terminated: Tensor


class ImageAgent(ABC):
    """A learner from images, for one robot. Networks are made from torch's global generator.

    One encoder serves critics and actor; only the critics' loss moves it, and their targets see through it as it is.
    """

    sees_images = True
    actor: nn.Module
    loss_names: tuple[str, ...]
    """Names of what `learn` returns."""

    def __init__(self, layout: ObservationLayout, side_px: int, action_size: int, settings: ImageSettings) -> None:
        self._common = settings
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = SightEncoder(layout, side_px, settings)
        self.replay = ImageReplay(settings.replay_size, side_px, len(layout), action_size)
        self._updates = 0

    @abstractmethod
    def choose(self, features: Tensor, *, explore: bool) -> Tensor:
        """Actions ``[batch, m]`` for features ``[batch, f]``."""

    @abstractmethod
    def learn(self, batch: SightBatch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update of encoder and critics, and with ``actor`` of the actor; returns the numbers that `loss_names` names."""

    @abstractmethod
    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        """Networks and optimisers by name: all that learning changes."""

    def act(self, observation: TensorDictBase, *, explore: bool) -> Tensor:
        """An action ``[m]`` in -1..1 for what is seen; without ``explore`` the agent's best one."""
        with torch.no_grad():
            features = self.encoder(observation["image"][None], observation["observation"][None])
            return self.choose(features, explore=explore)[0]

    def remember(self, transition: Transition) -> None:
        """Keep a transition; of its two images the first is there already, but at the start of an episode."""
        seen: tuple[TensorDictBase, TensorDictBase] = (transition.observation, transition.next_observation)
        before, after = ((each["observation"], each["image"]) for each in seen)
        step = transition.action, transition.reward, after
        self.replay.add(before, *step, terminated=transition.terminated, last=transition.last)

    def end_episode(self) -> None:
        """What was remembered last is the last of its episode."""
        self.replay.end_episode()

    def policy_state(self) -> dict[str, Tensor]:
        """The tensors of encoder and actor, copied."""
        return {name: tensor.clone() for name, tensor in self._policy().state_dict().items()}

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
        self._policy().load_state_dict(state)

    def _policy(self) -> nn.ModuleDict:
        return nn.ModuleDict({"encoder": self.encoder, "actor": self.actor})

    def update(self) -> dict[str, float]:
        """All updates of one robot step; returns the mean of each number that `loss_names` names."""
        if len(self.replay) == 0:
            return {}
        found = []
        for _ in range(self._common.updates_per_step):
            self._updates += 1
            found.append(self.learn(self.draw_batch(), actor=self._updates % self._common.actor_delay == 0))
        means = {}
        for place, name in enumerate(self.loss_names):
            values = [numbers[place] for numbers in found if len(numbers) > place]
            if values:
                means[name] = float(torch.stack(values).mean())
        return means

    def draw_batch(self) -> SightBatch:
        """A batch out of the replay buffer, its images moved at random as the settings say."""
        rows, shift_px = self.replay.draw(self._common.batch_size), self._common.shift_px
        with torch.no_grad():
            next_features = self.encoder(shifted(rows.next_image, shift_px), rows.next_observation)
        features = self.encoder(shifted(rows.image, shift_px), rows.observation)
        return SightBatch(features, rows.action, rows.reward, next_features, rows.terminated)

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers, the filled part of the replay buffer, and the number of updates."""
        parts = {name: part.state_dict() for name, part in self._parts().items()}
        return {**parts, "encoder": self.encoder.state_dict(), "replay": self.replay.state_dict(), "updates": self._updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`, into an agent that has learned nothing yet.

        Raises:
            CheckpointError: the state belongs to networks of another shape.
        """
        try:
            for name, part in {**self._parts(), "encoder": self.encoder}.items():
                part.load_state_dict(state[name])
            self.replay.load_state_dict(state["replay"])
            self._updates = state["updates"]
        except (KeyError, RuntimeError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise CheckpointError(f"the checkpoint does not fit this agent ({reason}); resume with the settings it had") from None


def step(optimiser: torch.optim.Optimizer, *losses: tuple[Tensor, list[Tensor]]) -> None:
    """One step down each loss for its own parameters only; parameters without a loss stay."""
    gradients = [torch.autograd.grad(loss, parameters) for loss, parameters in losses]
    optimiser.zero_grad()
    for (_, parameters), of_loss in zip(losses, gradients, strict=True):
        for parameter, gradient in zip(parameters, of_loss, strict=True):
            parameter.grad = gradient
    optimiser.step()
