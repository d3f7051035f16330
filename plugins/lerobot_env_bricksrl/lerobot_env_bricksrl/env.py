"""An environment as LeRobot's rollouts take it."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Dict
from gymnasium.wrappers import RescaleAction

from bricksrl.envs.registry import is_simulation
from bricksrl.interfaces.gymnasium import GymnasiumEnv


class BricksEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment of BricksRL with LeRobot's names, in the units of the robots of
    ``lerobot_robot_bricksrl``.

    Actions are commands in their units. The observation has ``agent_pos``, float32 ``[n]`` in the
    task's units, and ``pixels``, one uint8 image ``[height, width, 3]`` for each camera. ``info``
    says ``is_success`` in each step, False where the task does not know it.

    Args:
        env_id: of BricksRL, or a task of your own.
        hub: as in :func:`bricksrl.make`; a kinematic simulation has none.
        render_mode: ``None`` or ``"rgb_array"``.
    """

    def __init__(self, env_id: str, hub: str = "virtual", render_mode: str | None = None) -> None:
        ours = GymnasiumEnv(env_id, render_mode, **({} if is_simulation(env_id) else {"hub": hub}))
        task = ours.env.task
        ranges = np.array(
            [(command.low, command.high) for command in task.interface.commands], np.float32
        )
        super().__init__(RescaleAction(ours, ranges[:, 0], ranges[:, 1]))
        self.task, self.task_description = task.id, task.doc.splitlines()[0]
        self._max_episode_steps = ours.max_episode_steps
        self._cameras = list(task.images)
        self.observation_space = self._named(ours.observation_space, Dict)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed)
        return self._named(observation), info | {"is_success": False}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._named(observation), reward, terminated, truncated, {"is_success": False} | info

    def _named(self, parts: Any, kind: Any = dict) -> Any:
        """Parts of an observation, or their spaces, by LeRobot's names."""
        if not self._cameras:
            return kind({"agent_pos": parts})
        return kind(
            {
                "agent_pos": parts["observation"],
                "pixels": kind({key: parts[key] for key in self._cameras}),
            }
        )
