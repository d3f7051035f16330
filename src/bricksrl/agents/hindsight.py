"""Other goals for what was done: a step towards one goal teaches as much about any other.

A task's reward and its end are pure functions of the observation, and a goal moves nothing: so a goal in the memory can be
exchanged for another, and the step is then as if it had been made for that one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from bricksrl.agents.layout import ObservationLayout

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

HORIZON = 4
"""A goal in hindsight is what was reached up to so many steps later."""


class GoalExchange:
    """Exchanges goals in observations of a task that has some."""

    def __init__(self, layout: ObservationLayout, task: Task) -> None:
        self._task = task
        self._goal, self._reached = (torch.tensor([pair[i] for pair in layout.goals]) for i in range(2))
        low, high = torch.tensor(layout.low), torch.tensor(layout.high)
        self._low, self._span = low[self._goal], (high - low)[self._goal]

    def reached(self, observation: Tensor) -> Tensor:
        """The goals ``[*batch, g]`` that observations ``[*batch, n]`` have reached."""
        return observation[..., self._reached]

    def drawn(self, *batch: int) -> Tensor:
        """Uniformly random goals ``[*batch, g]``."""
        return self._low + torch.rand(*batch, len(self._low)) * self._span

    def exchange(self, observation: Tensor, action: Tensor, next_observation: Tensor, goals: Tensor) -> tuple[Tensor, Tensor]:
        """Write ``goals`` ``[*batch, g]`` into both observations; returns reward and ``terminated``, both ``[*batch]``."""
        observation[..., self._goal] = goals
        next_observation[..., self._goal] = goals
        reward = self._task.reward(observation, action, next_observation)
        return reward.squeeze(-1), self._task.terminated(next_observation).squeeze(-1)
