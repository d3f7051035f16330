"""Hand at the page: it pulls a body of a virtual robot's world towards a point, for as long as it
is held."""

import time
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from bricksrl.page.server import is_finite
from bricktwin.twin.mujoco_body import MujocoBody

TIMEOUT_S = 1.0
"""Time without a message of the page, which repeats a pull, after which the hand lets go, as the
tab may be closed."""
_RATE_S = 15.0
"""Frequency of the spring by which it pulls, 1/s, with critical damping for the mass of what is
pulled: 4 cm move a robot, whose tyres have a friction of 1."""
_MOST_WEIGHTS = 2.0
"""Largest force, as a multiple of the weight of what is pulled."""
_STEP_M = 0.002
"""Largest step of what has no mass, in each of the hub's control loops of 5 ms: it pushes a robot
and does not jump over it."""


class Hand:
    """Hand of one user; set by the page's threads, felt in the thread that steps the robot."""

    def __init__(self) -> None:
        self._pull: tuple[int, float, float, float] | None = None
        self._held = -1
        self._grip_m: NDArray[np.float64] | None = None

    def pull(self, value: Any) -> None:
        """Pull a body, by its number in the drawn scene, towards x and y (m); other values let
        go."""
        is_pull = (
            isinstance(value, list)
            and len(value) == 3
            and isinstance(value[0], int)
            and all(map(is_finite, value))
        )
        self._pull = (
            (value[0], float(value[1]), float(value[2]), time.monotonic()) if is_pull else None
        )

    def act(self, body: MujocoBody, numbers: list[int]) -> None:
        """Apply the force to the twin, given the model's number of each drawn body."""
        pull = self._pull
        data = body.data
        if self._held >= 0:
            data.xfrc_applied[self._held] = 0.0
            self._held = -1
        if (
            pull is None
            or not 0 <= pull[0] < len(numbers)
            or time.monotonic() - pull[3] > TIMEOUT_S
        ):
            self._pull = self._grip_m = None
            return
        number = numbers[pull[0]]
        model = body.model
        # what has no mass, such as a wall, comes at once
        if (mocap := int(model.body_mocapid[number])) >= 0:
            if self._grip_m is None:
                self._grip_m = np.array(pull[1:3]) - data.mocap_pos[mocap, :2]
            way = np.array(pull[1:3]) - self._grip_m - data.mocap_pos[mocap, :2]
            data.mocap_pos[mocap, :2] += way * min(
                1.0, _STEP_M / max(float(np.linalg.norm(way)), 1e-9)
            )
            return
        root = int(model.body_rootid[number])
        # a part of what stands on a fixed base
        root = self._held = root if model.body_weldid[root] else number
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, root, velocity, 0)
        way = np.array(pull[1:3]) - data.subtree_com[root, :2]
        mass_kg = float(model.body_subtreemass[root])
        force_n = mass_kg * (_RATE_S**2 * way - 2.0 * _RATE_S * velocity[3:5])
        most_n = _MOST_WEIGHTS * mass_kg * 9.81
        data.xfrc_applied[root, :2] = force_n * min(
            1.0, most_n / max(float(np.linalg.norm(force_n)), 1e-9)
        )
