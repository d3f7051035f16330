"""Goals as Gymnasium's environments of robots have them, for hindsight experience replay of other libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from bricksrl.envs.gymnasium.environment import Array, GymnasiumEnv
from bricksrl.envs.specs import ObservationLayout
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class GoalObservation(gymnasium.ObservationWrapper[dict[str, Array], Array, Any], RecordConstructorArgs):
    """An environment whose observation vector has entries ``X_goal`` and ``X_angle``, split as in Gymnasium-Robotics.

    The observation is a dict: "observation", all entries that are no goals; "desired_goal", the goals ``[g]``; "achieved_goal",
    the entries ``[g]`` that are to reach them. `compute_reward` says what a step would have paid with another goal.

    ``GoalObservation(gymnasium.make("bricksrl/RoboArmSim-v0", sparse=True))``

    Args:
        env: one of ours, from ``gymnasium.make``, whose reward and end depend on goals and reached entries alone.

    Raises:
        DescriptionError: the environment has no goals, or is not ours.
    """

    def __init__(self, env: gymnasium.Env[Array, Array]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        ours, space = env.unwrapped, env.observation_space
        pairs = ObservationLayout.of(ours.env).goals if isinstance(ours, GymnasiumEnv) else ()
        if not isinstance(ours, GymnasiumEnv) or not isinstance(space, Box) or not pairs:
            raise DescriptionError(f"{env} has no goals in a vector of ours; take one that has, such as bricksrl/RoboArm-v0")
        self._size = space.shape[0]
        self._goals, self._reached = ([pair[k] for pair in pairs] for k in (0, 1))
        self._others = [index for index in range(self._size) if index not in self._goals]
        parts = {"observation": self._others, "achieved_goal": self._reached, "desired_goal": self._goals}
        split: gymnasium.Space[Any] = Dict({name: Box(space.low[part], space.high[part]) for name, part in parts.items()})
        self.observation_space = split

    def observation(self, observation: Array) -> dict[str, Array]:
        """Parts of an observation vector."""
        return {
            "observation": observation[self._others],
            "achieved_goal": observation[self._reached],
            "desired_goal": observation[self._goals],
        }

    def compute_reward(self, achieved_goal: Array, desired_goal: Array, info: Any) -> Any:
        """Reward of a step that reached ``achieved_goal [*batch, g]``: a number, or an array ``[*batch]``."""
        state = self._state(achieved_goal, desired_goal)
        action = torch.zeros(*state.shape[:-1], len(self._task.interface.commands))
        return _plain(self._task.reward(state, action, state))

    def compute_terminated(self, achieved_goal: Array, desired_goal: Array, info: Any) -> Any:
        """Whether such a step ends the episode: a bool, or an array ``[*batch]``."""
        return _plain(self._task.terminated(self._state(achieved_goal, desired_goal)))

    def compute_truncated(self, achieved_goal: Array, desired_goal: Array, info: Any) -> bool:
        """False: only time truncates an episode."""
        return False

    @property
    def _task(self) -> Task:
        ours: Any = self.unwrapped
        task: Task = ours.env.task
        return task

    def _state(self, achieved_goal: Array, desired_goal: Array) -> torch.Tensor:
        achieved, desired = (torch.as_tensor(np.asarray(goal, np.float32)) for goal in (achieved_goal, desired_goal))
        state = torch.zeros(*achieved.shape[:-1], self._size)
        state[..., self._reached], state[..., self._goals] = achieved, desired
        return state


def _plain(values: torch.Tensor) -> Any:
    """Values ``[*batch, 1]`` as a number, or an array ``[*batch]``."""
    array: NDArray[Any] = values.squeeze(-1).numpy()
    return array if array.ndim else array.item()
