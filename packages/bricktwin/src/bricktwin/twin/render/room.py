"""Room for videos: walls, a line and a label at each metre, a camera, and a ghost of the robot at its goal.

All of it is drawn as decoration, without effect on the physics.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.sensed_pose import sensed_qpos

_BACK_M, _HEIGHT_M, _SKIRTING_M = 1.3, 1.6, 0.07
"""Wall behind the robot: distance to the left of its start, height, and height of its skirting board."""
_LINE = (0.45, 0.50, 0.58, 1.0)
_WALL, _BOARD = (0.90, 0.90, 0.87, 1.0), (0.97, 0.97, 0.96, 1.0)
_GHOST = (0.10, 0.62, 0.25, 0.30)
_LAG = 0.06
"""Share of the distance to the robot by which the camera's target moves per image."""


class Room:
    """Decoration and camera of a film of a robot.

    Args:
        body: the robot.
        goal_deg: goal angles of its motors, by name; ``None`` for a robot without such a goal.

    Attributes:
        camera: camera for a renderer; :meth:`follow` aims it.
    """

    def __init__(self, body: MujocoBody, goal_deg: dict[str, float] | None = None) -> None:
        self._body = body
        self.camera = mujoco.MjvCamera()
        self.camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._moves = body.model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        self.camera.distance = 0.62 if self._moves else 0.72
        self.camera.azimuth, self.camera.elevation = 62.0, -21.0  # from behind, so that no wall ahead hides the robot
        self._target = np.array(self._robot())
        self.camera.lookat[:] = self._target
        self._ghost = MujocoBody(body.robot, body.scene, Physics(), 0) if goal_deg else None
        self._option = mujoco.MjvOption()
        self.aim_for(goal_deg or {})

    def aim_for(self, goal_deg: dict[str, float]) -> None:
        """Set the goal that the ghost shows."""
        if self._ghost is not None:
            self._ghost.data.qpos[:] = sensed_qpos(self._ghost, goal_deg, (0.0, 0.0))
            self._ghost.update_visuals()

    def follow(self) -> None:
        """Move the camera's target towards the robot, smoothly."""
        self._target += _LAG * (np.array(self._robot()) - self._target)
        self.camera.lookat[:] = self._target

    def _robot(self) -> tuple[float, float, float]:
        if not self._moves:
            return 0.04, 0.0, 0.13
        x, y = self._body.data.qpos[:2]
        return float(x), float(y), 0.07

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Add walls, metre lines and ghost to a scene."""
        middle = round(float(self._target[0]))
        _box(scene, (middle, _BACK_M + 0.01, _HEIGHT_M / 2), (6.0, 0.01, _HEIGHT_M / 2), _WALL)
        _box(scene, (middle, _BACK_M - 0.008, _SKIRTING_M / 2), (6.0, 0.008, _SKIRTING_M / 2), _BOARD)
        for metre in range(middle - 3, middle + 4):
            _box(scene, (metre, _BACK_M / 2 - 1.0, 0.0), (0.003, _BACK_M / 2 + 1.0, 0.0004), _LINE)
        for metre in range(-2, 2):
            _box(scene, (middle, metre, 0.0), (6.0, 0.003, 0.0004), _LINE)
        if self._ghost is not None:
            self._add_ghost(scene, self._ghost)

    def _add_ghost(self, scene: mujoco.MjvScene, ghost: MujocoBody) -> None:
        first = scene.ngeom
        category = mujoco.mjtCatBit.mjCAT_DYNAMIC
        mujoco.mjv_addGeoms(ghost.model, ghost.data, self._option, mujoco.MjvPerturb(), category, scene)
        for number in range(first, scene.ngeom):
            scene.geoms[number].rgba[:] = _GHOST
            scene.geoms[number].matid = -1

    def metre_marks(self, width: int, height: int) -> list[tuple[int, int, str]]:
        """Labels of the metre lines in an image of that size in px: column, row, text."""
        marks = []
        for metre in range(round(float(self._target[0])) - 2, round(float(self._target[0])) + 3):
            pixel = self._project(np.array([metre, -0.28, 0.0]), width, height)
            if pixel is not None and 0 < pixel[0] < width and 0 < pixel[1] < height:
                marks.append((*pixel, f"{metre} m"))
        return marks

    def _project(self, point: NDArray[np.float64], width: int, height: int) -> tuple[int, int] | None:
        azimuth, elevation = math.radians(self.camera.azimuth), math.radians(self.camera.elevation)
        forward = np.array(
            [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)]
        )
        right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
        up = np.cross(right, forward)
        offset = point - (np.array(self.camera.lookat) - self.camera.distance * forward)
        depth = float(offset @ forward)
        if depth < 0.05:
            return None
        focal_px = height / 2 / math.tan(math.radians(float(self._body.model.vis.global_.fovy)) / 2)
        x, y = float(offset @ right), float(offset @ up)
        return round(width / 2 + focal_px * x / depth), round(height / 2 - focal_px * y / depth)


def _box(
    scene: mujoco.MjvScene, position: tuple[float, float, float], half: tuple[float, float, float], rgba: tuple[float, ...]
) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, mujoco.mjtGeom.mjGEOM_BOX, np.array(half), np.array(position), np.eye(3).ravel(), np.array(rgba, np.float32)
    )
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.segid = -1
    scene.ngeom += 1
