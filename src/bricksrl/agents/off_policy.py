"""What all agents share that learn from single steps in a replay buffer: drawing batches, the order of updates."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from bricksrl.agents.hindsight import HORIZON, GoalExchange
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.replay import ReplayRing
from bricksrl.agents.settings import LearnerSettings
from bricksrl.agents.student import Student

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


@dataclass(frozen=True)
class Batch:
    """Transitions: ``features``, ``next_features`` ``[batch, f]``, ``action`` ``[batch, m]``, the others ``[batch]``."""

    features: Tensor
    action: Tensor
    reward: Tensor
    next_features: Tensor
    terminated: Tensor
    """Bool."""


class OffPolicyAgent(Student):
    """A learner from a replay buffer, for one robot. Networks are made from torch's global generator.

    Args:
        task: where it has goals, the agent learns from other goals too, as its settings say.
    """

    def __init__(self, layout: ObservationLayout, action_size: int, settings: LearnerSettings, task: Task | None) -> None:
        super().__init__(layout, action_size, settings)
        self._goals = GoalExchange(layout, task) if task is not None and layout.goals else None

    @abstractmethod
    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update of the critics, and with ``actor`` of the actor; returns the numbers that `loss_names` names."""

    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update with each batch under one actor, which learns in the last one only."""
        return [self.learn(batch, actor=actor and batch is batches[-1]) for batch in batches]

    def make_updates(self, count: int) -> list[tuple[Tensor, ...]]:
        """``count`` updates of the critics; in every n-th of all that were ever made the actor learns too."""
        batches = self.draw_batches(count)
        found = []
        while batches:
            turns = self._common.actor_delay - self._updates % self._common.actor_delay  # until the actor learns
            some, batches = batches[:turns], batches[turns:]
            self._updates += len(some)
            found += self.learn_in_turn(some, actor=len(some) == turns)
        return found

    def draw_batches(self, count: int) -> list[Batch]:
        """``count`` batches out of the replay buffer and the dataset, some of their goals exchanged."""
        size, sources = self._common.batch_size, self._sources()
        sizes = [size] if len(sources) == 1 else [size - size // 2, size // 2]
        drawn = [self._draw(ring, count, share) for ring, share in zip(sources, sizes, strict=True)]
        together = drawn[0] if len(drawn) == 1 else [torch.cat(parts, 1) for parts in zip(*drawn, strict=True)]
        observation, action, reward, next_observation, terminated = together
        features, next_features = self.encoder(observation), self.encoder(next_observation)
        return [Batch(*rows) for rows in zip(features, action, reward, next_features, terminated, strict=True)]

    def _draw(self, ring: ReplayRing, count: int, size: int) -> list[Tensor]:
        """Observations, actions, rewards, next observations and ends, each ``[count, size, ...]``."""
        places = ring.draw(count * size).view(count, size)
        observation, action, next_observation, outcome = ring.rows(places).split(self._widths, -1)
        reward, terminated = outcome[..., 0], outcome[..., 1] > 0
        if self._goals is not None:
            share = round(size * self._common.hindsight)
            end = share + round(size * self._common.new_goals)
            if end:
                later = ring.rows(ring.later(places[:, :share], HORIZON)).split(self._widths, -1)[2]
                goals = torch.cat((self._goals.reached(later), self._goals.drawn(count, end - share)), 1)
                reward[:, :end], terminated[:, :end] = self._goals.exchange(
                    observation[:, :end], action[:, :end], next_observation[:, :end], goals
                )
        return [observation, action, reward, next_observation, terminated]
