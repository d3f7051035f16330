"""What all agents share that learn from a replay buffer: remembering, drawing batches, the order of updates, and their state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from bricksrl.agents.agent import Transition, Transitions
from bricksrl.agents.hindsight import HORIZON, GoalExchange
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import ObservationEncoder
from bricksrl.agents.replay import ReplayRing
from bricksrl.agents.settings import LearnerSettings
from bricksrl.errors import CheckpointError, DataError

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


class OffPolicyAgent(ABC):
    """A learner from a replay buffer, for one robot. Networks are made from torch's global generator.

    Args:
        task: where it has goals, the agent learns from other goals too, as its settings say.
    """

    actor: nn.Module
    loss_names: tuple[str, ...]
    """Names of what `learn` returns."""

    def __init__(self, layout: ObservationLayout, action_size: int, settings: LearnerSettings, task: Task | None) -> None:
        self._common = settings
        self._action_size = action_size
        self.prefill_episodes = settings.prefill_episodes
        self.encoder = ObservationEncoder(layout, settings.angles, settings.goals)
        self._goals = GoalExchange(layout, task) if task is not None and layout.goals else None
        n = len(layout)
        self._widths = [n, action_size, n, 2]
        self._replay = ReplayRing(settings.replay_size, sum(self._widths))
        self._data: ReplayRing | None = None
        self._updates = 0

    @abstractmethod
    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """An action ``[m]`` in -1..1 for an observation ``[n]``; without ``explore`` the agent's best one."""

    @abstractmethod
    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update of the critics, and with ``actor`` of the actor; returns the numbers that `loss_names` names."""

    def learn_in_turn(self, batches: Sequence[Batch], *, actor: bool) -> list[tuple[Tensor, ...]]:
        """An update with each batch under one actor, which learns in the last one only."""
        return [self.learn(batch, actor=actor and batch is batches[-1]) for batch in batches]

    @abstractmethod
    def _parts(self) -> dict[str, Any]:
        """Networks and optimisers by name: all that learning changes. Each has a ``state_dict`` and can load it."""

    def remember(self, transition: Transition) -> None:
        """Keep a transition, in physical units."""
        outcome = torch.tensor((transition.reward, float(transition.terminated)))
        parts = (transition.observation, transition.action, transition.next_observation, outcome)
        self._replay.add(parts, last=transition.last)

    def end_episode(self) -> None:
        """What was remembered last is the last of its episode."""
        self._replay.end_episode()

    def policy_state(self) -> dict[str, Tensor]:
        """The actor's tensors, copied."""
        return {name: tensor.clone() for name, tensor in self.actor.state_dict().items()}

    def load_policy_state(self, state: dict[str, Tensor]) -> None:
        """Act as the agent whose `policy_state` this is."""
        self.actor.load_state_dict(state)

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
        means = {}
        for place, name in enumerate(self.loss_names):
            values = [numbers[place] for numbers in found if len(numbers) > place]
            if values:
                means[name] = float(torch.stack(values).mean())
        return means

    def _sources(self) -> list[ReplayRing]:
        return [ring for ring in (self._replay, self._data) if ring is not None and len(ring)]

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

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimisers, the filled part of the replay buffer, and the number of updates."""
        parts = {name: part.state_dict() for name, part in self._parts().items()}
        return {**parts, "replay": self._replay.state_dict(), "updates": self._updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`, into an agent that has learned nothing yet.

        Raises:
            CheckpointError: the state belongs to networks of another shape.
        """
        try:
            for name, part in self._parts().items():
                part.load_state_dict(state[name])
            self._replay.load_state_dict(state["replay"])
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
