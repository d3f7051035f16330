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

    def draw(
        self,
        *batch: int,
        device: torch.device,
    ) -> Tensor:
        """Uniformly random goals ``[*batch, g]``."""
        goals = [goal for goal, _ in self.layout.goals]
        low = torch.tensor([self.layout.low[goal] for goal in goals], device=device)
        high = torch.tensor([self.layout.high[goal] for goal in goals], device=device)
        shares = torch.rand(*batch, len(goals), device=device)
        return low + shares * (high - low)

    def relabel(
        self,
        rows: TensorDictBase,
        goals: Tensor,
    ) -> None:
        """Write goals ``[*batch, g]`` into rows ``[n, *batch]`` and update their rewards and
        ends."""
        goal_index = [goal for goal, _ in self.layout.goals]
        after = rows["next"]
        before_observed = rows["observation"]
        after_observed = after["observation"]
        for observation in (before_observed, after_observed):
            observation[..., goal_index] = goals
        # Motion does not depend on the goal, so the same steps with another goal are a valid
        # experience, whose reward and end can be computed again.
        reward = self.task.reward(before_observed, rows["action"], after_observed)
        after["reward"].copy_(reward)
        after["terminated"].copy_(self.task.terminated(after_observed))


def relabelling(
    env: EnvBase,
    hindsight: float,
    new_goals: float,
) -> GoalRelabelling | None:
    """Relabelling of shares of a batch; ``None`` if there is none, if not all goals can be reached,
    and behind transforms of observation or reward, which the task's functions know nothing of."""
    task = interface_of(env).task
    layout = layout_of(env)
    if task is None or not layout.goals:
        return None
    is_wanted = hindsight + new_goals > 0
    if not is_wanted or not changes_nothing(env):
        return None
    # `layout.goals` has those whose current value is observed too: one that is not can never be
    # said to have been reached
    goal_names = [name for name in layout.names if name.endswith("_goal")]
    if len(layout.goals) != len(goal_names):
        return None
    return GoalRelabelling(
        task,
        layout,
        hindsight,
        new_goals,
    )
