"""Base class of an environment with resets and steps of its own, over a client program of its own, as in the BricksRL paper.

It is run by :class:`~bricksrl.envs.own.own_env.OwnEnv`, as a TorchRL environment: ``bricksrl.make("my_env.py:MyEnv")``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from brickhub.robot import Robot
from bricksrl.errors import HubError
from bricktwin.twin.scene import OPEN_FLOOR, Scene

if TYPE_CHECKING:
    import numpy as np
    from tensordict import TensorDictBase
    from torch import Tensor

    from brickhub.hub.link.lockstep import HubLink


class BaseEnv:
    """Environment of the paper's template (appendix, "Task environment template"). A subclass sets ``action_spec`` ``[1, m]`` and
    ``observation_spec``, with ``observation_key`` ``[1, n]``, before it calls ``super().__init__``; bounds are those of what
    ``_reset`` and ``_step`` return, in batches of one.

    Attributes:
        robot, program: robot, and the path of its client program: see :class:`~brickhub.hub.link.own_client.OwnClient`.
        scene: surroundings of a virtual robot.
        max_episode_steps: steps after which an episode is truncated.
        longest_step_ms: longest time of a step; 5 s later the hub is lost.
        observation_key: key of the observation.
        action_dim, state_dim: numbers of floats, in network order (``"!f..."``), that the client gets and answers.
    """

    robot: Robot
    program: str
    scene: Scene = OPEN_FLOOR
    max_episode_steps: int = 100
    longest_step_ms: int = 5000
    observation_key: str = "vec_observation"
    action_spec: Any
    observation_spec: Any
    link: Callable[[], HubLink]

    def __init__(self, action_dim: int, state_dim: int) -> None:
        self.action_dim, self.state_dim = action_dim, state_dim
        self.state: Sequence[float] = ()
        self._is_waiting = False

    @property
    def original_vec_observation_key(self) -> str:
        """Key of the state in its units; the observation has them too."""
        return self.observation_key

    def normalize_state(self, state: np.ndarray[Any, Any]) -> Tensor:
        """The state as a tensor, in its units: agents scale it by the bounds of the spec."""
        import torch

        return torch.as_tensor(state).float()

    def begin(self, state: Sequence[float]) -> None:
        """Start an episode with what was read when the robot was placed."""
        self.state, self._is_waiting = state, False

    def send_to_hub(self, action: np.ndarray[Any, Any]) -> None:
        """Send the action ``[m]`` to the client. Raises HubError if the hub is lost."""
        self.link().send(map(float, action))
        self._is_waiting = True

    def read_from_hub(self) -> np.ndarray[Any, Any]:
        """The client's answer ``[1, n]`` to the last action; without one, as at a reset, the state at the start. Raises HubError
        if none comes in time."""
        import numpy as np

        if self._is_waiting:
            self._is_waiting = False
            self.state = self.link().receive().values
        if not self.state:
            raise HubError("nothing was read yet; reset the environment first")
        return np.array([self.state], np.float32)

    def _reset(self, tensordict: TensorDictBase | None, **kwargs: Any) -> TensorDictBase:
        raise NotImplementedError

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        raise NotImplementedError
