"""What all agents share that learn from observations in a replay buffer: remembering, drawing batches, the order of updates."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from bricksrl.agents.agent import Transition, Transitions
from bricksrl.agents.hindsight import HORIZON, GoalExchange
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import Learner
from bricksrl.agents.networks import ObservationEncoder
from bricksrl.agents.replay import ReplayRing
from bricksrl.agents.settings import LearnerSettings
from bricksrl.errors import DataError

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


class OffPolicyAgent(Learner):
    """A learner from a replay buffer, for one robot. Networks are made from torch's global generator.

    Args:
        task: where it has goals, the agent learns from other goals too, as its settings say.
    """

    replay: ReplayRing

    def __init__(self, layout: ObservationLayout, action_size: int, settings: LearnerSettings, task: Task | None) -> None:
        self._common = settings
        self._action_size = action_size
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = ObservationEncoder(layout, settings.angles, settings.goals)
        self._goals = GoalExchange(layout, task) if task is not None and layout.goals else None
        n = len(layout)
        self._widths = [n, action_size, n, 2]
        self.replay = ReplayRing(settings.replay_size, sum(self._widths))
        self._data: ReplayRing | None = None

    @abstractmethod
    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """An action ``[m]`` in -1..1 for an observation ``[n]``; without ``explore`` the agent's best one."""

    @abstractmethod
    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update of the critics, and with ``actor`` of the actor; returns the numbers that `loss_names` names."""

    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update with each batch under one actor, which learns in the last one only."""
        return [self.learn(batch, actor=actor and batch is batches[-1]) for batch in batches]

    def remember(self, transition: Transition) -> None:
        """Keep a transition, in physical units."""
        outcome = torch.tensor((transition.reward, float(transition.terminated)))
        parts = (transition.observation, transition.action, transition.next_observation, outcome)
        self.replay.add(parts, last=transition.last)

    def study(self, data: Transitions) -> None:
        """Learn from a dataset too: half of each batch is drawn from it, the whole as long as there is nothing of one's own.

        That is the symmetric sampling of RLPD (Ball et al. 2023). The dataset is no part of `state_dict`.

        Raises:
            DataError: there is nothing in it, or its observations or actions are those of another environment.
        """
        shapes = [list(part.shape[1:]) for part in (data.observation, data.action, data.next_observation)]
        if len(data) == 0 or shapes != [[width] for width in self._widths[:3]]:
            wanted = f"{self._widths[0]} numbers observed and {self._action_size} given"
            raise DataError(f"{len(data)} steps of {shapes[0]} numbers observed and {shapes[1]} given; the agent needs {wanted}")
        outcome = torch.stack((data.reward, data.terminated.float()), -1)
        self._data = ReplayRing(len(data), sum(self._widths))
        self._data.fill(torch.cat((data.observation, data.action, data.next_observation, outcome), -1), data.last)

    def update(self, count: int | None = None) -> dict[str, float]:
        """All updates of one robot step, or ``count``; returns the mean of each number that `loss_names` names."""
        if not self._sources():
            return {}
        batches = self.draw_batches(count or self._common.updates_per_step)
        found = []
        while batches:
            turns = self._common.actor_delay - self._updates % self._common.actor_delay  # until the actor learns
            some, batches = batches[:turns], batches[turns:]
            self._updates += len(some)
            found += self.learn_in_turn(some, actor=len(some) == turns)
        return self._means(found)

    def _sources(self) -> list[ReplayRing]:
        return [ring for ring in (self.replay, self._data) if ring is not None and len(ring)]

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
