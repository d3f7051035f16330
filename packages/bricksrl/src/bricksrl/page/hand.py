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
        self._pull = None
        if not isinstance(value, list) or len(value) != 3 or not all(map(is_finite, value)):
            return
        number, x_m, y_m = value
        if isinstance(number, int):
            self._pull = (number, float(x_m), float(y_m), time.monotonic())

    def act(
        self,
        body: MujocoBody,
        numbers: list[int],
    ) -> None:
        """Apply the force to the twin, given the model's number of each drawn body."""
        pull = self._pull
        data = body.data
        # MuJoCo keeps a force until it is set to 0.
        if self._held >= 0:
            data.xfrc_applied[self._held] = 0.0
            self._held = -1
        if pull is None:
            self._grip_m = None
            return
        drawn, x_m, y_m, pulled_s = pull
        if not 0 <= drawn < len(numbers) or time.monotonic() - pulled_s > TIMEOUT_S:
            self._pull = self._grip_m = None
            return
        number = numbers[drawn]
        target_m = np.array((x_m, y_m))
        model = body.model
        mocap = int(model.body_mocapid[number])
        if mocap >= 0:
            # What has no mass, such as a wall, comes by itself. It is held where it was gripped.
            place_m = data.mocap_pos[mocap, :2]
            if self._grip_m is None:
                self._grip_m = target_m - place_m
            way_m = target_m - self._grip_m - place_m
            place_m += way_m * _share(_STEP_M, way_m)
            return
        root = int(model.body_rootid[number])
        # A robot is pulled as a whole; of what stands on a fixed base, the part that is gripped.
        root = self._held = root if model.body_weldid[root] else number
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(
            model,
            data,
            mujoco.mjtObj.mjOBJ_BODY,
            root,
            velocity,
            0,
        )
        way_m = target_m - data.subtree_com[root, :2]
        mass_kg = float(model.body_subtreemass[root])
        # A critically damped spring: m (w^2 x - 2 w v).
        acceleration = _RATE_S**2 * way_m - 2.0 * _RATE_S * velocity[3:5]
        force_n = mass_kg * acceleration
        most_n = _MOST_WEIGHTS * mass_kg * 9.81
        data.xfrc_applied[root, :2] = force_n * _share(most_n, force_n)


def _share(longest: float, vector: NDArray[np.float64]) -> float:
    """Factor, at most 1, that makes a vector no longer than that."""
    return min(1.0, longest / max(float(np.linalg.norm(vector)), 1e-9))
