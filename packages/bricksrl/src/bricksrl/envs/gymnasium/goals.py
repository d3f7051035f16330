"""Goals as Gymnasium's environments of robots have them, for hindsight experience replay of other libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray
from torchrl.envs import EnvBase

from bricksrl.envs.gymnasium.environment import Array
from bricksrl.envs.specs import ObservationLayout
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


class _Goals:
    """Goals in the observation vector of an environment of ours, which ``_find_goals`` looks for, and rewards of other goals."""

    unwrapped: Any
    _size: int
    _parts: dict[str, list[int]]
    """Indices of the entries of each part of an observation."""

    def _find_goals(self, env: Any, ours: Any, vector: gymnasium.Space[Any]) -> None:
        pairs = ObservationLayout.of(ours).goals if isinstance(ours, EnvBase) else ()
        if not isinstance(vector, Box) or not pairs:
            raise DescriptionError(f"{env} has no goals in a vector of ours; take one that has, such as bricksrl/RoboArm-v0")
        self._size = vector.shape[-1]
        goals, reached = ([pair[k] for pair in pairs] for k in (0, 1))
        others = [index for index in range(self._size) if index not in goals]
        self._parts = {"observation": others, "achieved_goal": reached, "desired_goal": goals}

    def _split_space(self, vector: Any) -> gymnasium.Space[Any]:
        return Dict({name: Box(vector.low[..., part], vector.high[..., part]) for name, part in self._parts.items()})

    def _split(self, observation: Array) -> dict[str, Array]:
        return {name: observation[..., part] for name, part in self._parts.items()}

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
        task: Task = self.unwrapped.env.task
        return task

    def _state(self, achieved_goal: Array, desired_goal: Array) -> torch.Tensor:
        achieved, desired = (torch.as_tensor(np.asarray(goal, np.float32)) for goal in (achieved_goal, desired_goal))
        state = torch.zeros(*achieved.shape[:-1], self._size)
        state[..., self._parts["achieved_goal"]], state[..., self._parts["desired_goal"]] = achieved, desired
        return state


class GoalObservation(_Goals, gymnasium.ObservationWrapper[dict[str, Array], Array, Any], RecordConstructorArgs):
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
        self._find_goals(env, getattr(env.unwrapped, "env", None), env.observation_space)
        self.observation_space = self._split_space(env.observation_space)

    def observation(self, observation: Array) -> dict[str, Array]:
        """Parts of an observation vector."""
        return self._split(observation)


class VectorGoalObservation(_Goals, VectorWrapper):
    """Copies of a simulation as one batch with goals, each as of `GoalObservation`.

    ``VectorGoalObservation(gymnasium.make_vec("bricksrl/RoboArmSim-v0", 64, sparse=True))``

    Args:
        envs: one of ours, from ``gymnasium.make_vec``, in any autoreset mode; final observations are split too.

    Raises:
        DescriptionError: the environment has no goals, or is not ours.
    """

    def __init__(self, envs: VectorEnv[Array, Array, Any]) -> None:
        super().__init__(envs)
        self._find_goals(envs, getattr(envs.unwrapped, "env", None), envs.single_observation_space)
        self.single_observation_space = self._split_space(envs.single_observation_space)
        self.observation_space = self._split_space(envs.observation_space)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Array], dict[str, Any]]:
        """Start an episode of all copies, or of those in ``options["reset_mask"]``."""
        observations, info = self.env.reset(seed=seed, options=options)
        return self._split(observations), info

    def step(self, actions: Array) -> tuple[dict[str, Array], Any, Any, Any, dict[str, Any]]:
        """Take one step in all copies."""
        observations, *outcome, info = self.env.step(actions)
        if "final_obs" in info:
            for copy in info["_final_obs"].nonzero()[0]:
                info["final_obs"][copy] = self._split(info["final_obs"][copy])
        reward, terminated, truncated = outcome
        return self._split(observations), reward, terminated, truncated, info


def _plain(values: torch.Tensor) -> Any:
    """Values ``[*batch, 1]`` as a number, or an array ``[*batch]``."""
    array: NDArray[Any] = values.squeeze(-1).numpy()
    return array if array.ndim else array.item()
