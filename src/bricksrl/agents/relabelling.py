"""Goal relabelling: goals in the memory are replaced, for a step towards one goal teaches as much about any other.

A task's reward and its end are pure functions of the observation, and a goal moves nothing: with another goal a step is as if it
had been made for that one (hindsight, Andrychowicz et al., 2017).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor

from bricksrl.agents.encoder import ObservationLayout
from bricksrl.envs.task import Task


@dataclass(frozen=True)
class GoalRelabelling:
    """Other goals for what was done.

    Attributes:
        hindsight: share of each batch whose goals become what was reached some steps later.
        new_goals: share of each batch that gets goals drawn uniformly from their range.
    """

    task: Task
    layout: ObservationLayout
    hindsight: float
    new_goals: float

    def relabel_batch(self, rows: TensorDictBase, at: Tensor, size: int, observed_later: Callable[[Tensor], Tensor]) -> None:
        """Relabel the shares of rows ``[n, batch]``, which may be several batches of ``size`` in a row.

        Args:
            at: places ``[batch]`` of the rows in the memory.
            observed_later: places ``[*some]`` to observations ``[*some, o]`` that followed them.
        """
        count = len(at) // size
        in_hindsight = round(size * self.hindsight)
        end = in_hindsight + round(size * self.new_goals)
        if not end:
            return
        goals = [self.draw(count, end - in_hindsight, device=at.device)]
        if in_hindsight:
            reached = [reached for _, reached in self.layout.goals]
            goals.insert(0, observed_later(at.view(count, size)[:, :in_hindsight])[..., reached])
        self.relabel(rows.view(len(rows), count, size)[:, :, :end], torch.cat(goals, 1))

    def draw(self, *batch: int, device: torch.device) -> Tensor:
        """Uniformly random goals ``[*batch, g]``."""
        ends = (self.layout.low, self.layout.high)
        low, high = (torch.tensor([end[goal] for goal, _ in self.layout.goals], device=device) for end in ends)
        return low + torch.rand(*batch, len(low), device=device) * (high - low)

    def relabel(self, rows: TensorDictBase, goals: Tensor) -> None:
        """Write goals ``[*batch, g]`` into rows ``[n, *batch]``, and the rewards and ends that follow from them."""
        places = [goal for goal, _ in self.layout.goals]
        after = rows["next"]
        for observation in (rows["observation"], after["observation"]):
            observation[..., places] = goals
        after["reward"].copy_(self.task.reward(rows["observation"], rows["action"], after["observation"]))
        after["terminated"].copy_(self.task.terminated(after["observation"]))
