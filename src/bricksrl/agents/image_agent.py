"""What the agents share that learn from images: remembering, drawing batches, the order of updates.

What they are given as an observation is a TensorDict of ``observation`` ``[n]`` and ``image``, uint8 ``[side, side, 3]``.
"""

from __future__ import annotations

from abc import abstractmethod

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from bricksrl.agents.agent import Transition
from bricksrl.agents.image_networks import SightEncoder, shifted
from bricksrl.agents.image_presets import ImageSettings
from bricksrl.agents.image_replay import ImageReplay
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import Learner
from bricksrl.agents.off_policy import Batch


class ImageAgent(Learner):
    """A learner from images, for one robot. Networks are made from torch's global generator.

    One encoder serves critics and actor; only the critics' loss moves it, and their targets see through it as it is.
    """

    sees_images = True
    replay: ImageReplay

    def __init__(self, layout: ObservationLayout, side_px: int, action_size: int, settings: ImageSettings) -> None:
        self._common = settings
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = SightEncoder(layout, side_px, settings)
        self.replay = ImageReplay(settings.replay_size, side_px, len(layout), action_size)

    @abstractmethod
    def choose(self, features: Tensor, *, explore: bool) -> Tensor:
        """Actions ``[batch, m]`` for features ``[batch, f]``."""

    @abstractmethod
    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update of encoder and critics, and with ``actor`` of the actor; returns the numbers that `loss_names` names."""

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

    def _policy(self) -> nn.Module:
        return nn.ModuleDict({"encoder": self.encoder, "actor": self.actor})

    def update(self) -> dict[str, float]:
        """All updates of one robot step; returns the mean of each number that `loss_names` names."""
        if len(self.replay) == 0:
            return {}
        found = []
        for _ in range(self._common.updates_per_step):
            self._updates += 1
            found.append(self.learn(self.draw_batch(), actor=self._updates % self._common.actor_delay == 0))
        return self._means(found)

    def draw_batch(self) -> Batch:
        """A batch out of the replay buffer, its images moved at random as the settings say.

        The features carry the encoder's gradient, those of the next step none.
        """
        rows, shift_px = self.replay.draw(self._common.batch_size), self._common.shift_px
        with torch.no_grad():
            next_features = self.encoder(shifted(rows.next_image, shift_px), rows.next_observation)
        features = self.encoder(shifted(rows.image, shift_px), rows.observation)
        return Batch(features, rows.action, rows.reward, next_features, rows.terminated)
