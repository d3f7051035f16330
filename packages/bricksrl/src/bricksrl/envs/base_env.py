"""Base class of an environment with resets and steps of its own, over a client program of its own,
as in the BricksRL paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from brickhub.robot import Robot
from bricktwin.twin.scene import OPEN_FLOOR, Scene

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor

    from brickhub.hub.link.own_client import ClientLink


class BaseEnv:
    """Environment of the paper's template (appendix), run by
    :class:`~bricksrl.envs.own_env.OwnEnv`.

    A subclass sets ``action_spec`` ``[1, m]`` and ``observation_spec``, with ``observation_key``
    ``[1, n]``, of what ``_reset`` and ``_step`` take and return in batches of one. The client gets
    and answers floats in network order (``"!f..."``).

    Attributes:
        robot, program: robot, and the path of its client program: see
            :class:`~brickhub.hub.link.own_client.OwnClient`.
        scene: surroundings of a virtual robot.
        max_episode_steps: steps after which an episode is truncated.
        link, state: set by the environment that runs this one: the link, and the client's last
            answer ``[n]``.
    """

    robot: Robot
    program: str
    scene: Scene = OPEN_FLOOR
    max_episode_steps: int = 100
    observation_key: str = "vec_observation"
    action_spec: Any
    observation_spec: Any
    link: Callable[[], ClientLink]
    state: Sequence[float] = ()

    def __init__(
        self,
        action_dim: int,
        state_dim: int,
    ) -> None:
        self.action_dim = action_dim
        self.state_dim = state_dim
        # Scripts read this key for the state in its units, which the observation already has.
        self.original_vec_observation_key = self.observation_key

    def normalize_state(self, state: np.ndarray[Any, Any]) -> Tensor:
        """The state as a tensor, in its units: agents scale it by the bounds of the spec."""
        import torch

        return torch.as_tensor(state).float()

    def send_to_hub(self, action: np.ndarray[Any, Any]) -> None:
        """Send the action ``[m]`` to the client. Raises HubError if the hub is lost."""
        self.link().send(map(float, action))
        self.state = ()

    def read_from_hub(self) -> np.ndarray[Any, Any]:
        """The client's answer ``[1, n]``: to the last action, or at a reset to zeros. Raises
        HubError if none comes in time."""
        self.state = self.state or self.link().receive().values
        return np.array([self.state], np.float32)

    def _reset(
        self,
        tensordict: TensorDictBase | None,
        **kwargs: Any,
    ) -> TensorDictBase:
        raise NotImplementedError

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        raise NotImplementedError
