"""Goals of past transitions, replaced by others: of a task whose agent observes what its reward is
computed from."""

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.task import Task
from bricksrl.envs.transforms import changes_nothing, layout_of


@dataclass(frozen=True)
class GoalRelabelling:
    """Replacement of goals in shares of a batch: by goals reached later (``hindsight``), by drawn
    ones (``new_goals``)."""

    task: Task
    layout: ObservationLayout
    hindsight: float
    new_goals: float

    def draw(self, *batch: int, device: torch.device) -> Tensor:
        """Uniformly random goals ``[*batch, g]``."""
        ends = (self.layout.low, self.layout.high)
        low, high = (
            torch.tensor([end[goal] for goal, _ in self.layout.goals], device=device)
            for end in ends
        )
        return low + torch.rand(*batch, len(low), device=device) * (high - low)

    def relabel(self, rows: TensorDictBase, goals: Tensor) -> None:
        """Write goals ``[*batch, g]`` into rows ``[n, *batch]`` and update their rewards and
        ends."""
        goal_index = [goal for goal, _ in self.layout.goals]
        after = rows["next"]
        for observation in (rows["observation"], after["observation"]):
            observation[..., goal_index] = goals
        after["reward"].copy_(
            self.task.reward(rows["observation"], rows["action"], after["observation"])
        )
        after["terminated"].copy_(self.task.terminated(after["observation"]))


def relabelling(env: EnvBase, hindsight: float, new_goals: float) -> GoalRelabelling | None:
    """Relabelling of shares of a batch; ``None`` if there is none, if not all goals can be reached,
    and behind transforms of observation or reward, which the task's functions know nothing of."""
    task = interface_of(env).task
    layout = layout_of(env)
    if task is None or not hindsight + new_goals or not layout.goals or not changes_nothing(env):
        return None
    is_whole = len(layout.goals) == sum(name.endswith("_goal") for name in layout.names)
    return GoalRelabelling(task, layout, hindsight, new_goals) if is_whole else None
