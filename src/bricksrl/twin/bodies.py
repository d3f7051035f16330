"""Which body belongs to which robot."""

from __future__ import annotations

import importlib
import os

from bricksrl.errors import RenderingUnavailableError, TwinError
from bricksrl.robots import Robot
from bricksrl.twin.machine import Body
from bricksrl.twin.physics import Physics, RandomPhysics
from bricksrl.twin.scene import OPEN_FLOOR, Scene

_MUJOCO_TWINS = ("two-wheeler", "walker", "robo-arm")


def make_body(robot: Robot, *, scene: Scene | None = None, physics: Physics | RandomPhysics | None = None, seed: int = 0) -> Body:
    """Build the physical half of a virtual robot.

    Args:
        robot: one of the robots that have a twin.
        scene: what stands around it; ``None`` for an open floor.
        physics: its parameters, or how to draw them for each episode; ``None`` for the defaults.
        seed: of the noise of its sensors and of its first start.

    Raises:
        RenderingUnavailableError: ``MUJOCO_GL`` names a library that does not work, so MuJoCo does not load.
        TwinError: the robot has no twin, or it cannot be put into this scene; the bench has neither scene nor physics.
    """
    if robot.name == "bench":
        from bricksrl.twin.bench import BenchBody

        if scene not in (None, OPEN_FLOOR) or physics is not None:
            raise TwinError("the bench stands before no wall and has no physics to set; leave scene and physics away")
        return BenchBody(robot)
    if robot.name in _MUJOCO_TWINS:
        _check_mujoco()
        from bricksrl.twin.mujoco_body import MujocoBody

        return MujocoBody(robot, scene or OPEN_FLOOR, physics or Physics(), seed)
    raise TwinError(f"robot '{robot.name}' has no twin; choose one of bench, {', '.join(_MUJOCO_TWINS)}")


def _check_mujoco() -> None:
    """MuJoCo looks for the library that ``MUJOCO_GL`` names as soon as it is imported."""
    try:
        importlib.import_module("mujoco")
    except Exception as error:
        backend = os.environ.get("MUJOCO_GL")
        if not backend:
            raise
        raise RenderingUnavailableError(
            f"MuJoCo does not load with MUJOCO_GL={backend} ({error}); unset MUJOCO_GL or name a library that is installed"
        ) from error
