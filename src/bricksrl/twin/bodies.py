"""Which body belongs to which robot."""

from __future__ import annotations

import importlib
import os

from bricksrl.errors import RenderingUnavailableError, TwinError
from bricksrl.robots import PoweredUpSensor, Robot
from bricksrl.twin.machine import Body
from bricksrl.twin.physics import Physics, RandomPhysics
from bricksrl.twin.scene import OPEN_FLOOR, Scene

_MUJOCO_TWINS = ("two-wheeler", "walker", "robo-arm")


def make_body(robot: Robot, *, scene: Scene | None = None, physics: Physics | RandomPhysics | None = None, seed: int = 0) -> Body:
    """Build the physical half of a virtual robot.

    Args:
        robot: any; one without a MuJoCo model of its own lies on the bench, its motors turn without load.
        scene: what stands around it; ``None`` for an open floor.
        physics: its parameters, or how to draw them for each episode; ``None`` for the defaults.
        seed: of the noise of its sensors and of its first start.

    Raises:
        RenderingUnavailableError: ``MUJOCO_GL`` names a library that does not work, so MuJoCo does not load.
        TwinError: the robot cannot be put into this scene, or has a sensor of which nothing says what it reads.
    """
    scene = scene or OPEN_FLOOR
    if robot.name in _MUJOCO_TWINS:
        if scene.readings or any(isinstance(sensor, PoweredUpSensor) for sensor in robot.sensors):
            raise TwinError(
                f"the MuJoCo model of '{robot.name}' has its own sensors only; give a robot with others another name, "
                "and it gets a twin on the bench"
            )
        check_mujoco()
        from bricksrl.twin.mujoco_body import MujocoBody

        return MujocoBody(robot, scene, physics or Physics(), seed)
    from bricksrl.twin.bench import BenchBody

    if scene.wall_distance_mm is not None or scene.ball:
        raise TwinError(
            f"robot '{robot.name}' has no MuJoCo model and lies on the bench, without wall or ball; give Scene(readings=...)"
        )
    return BenchBody(robot, scene, physics)


def check_mujoco() -> None:
    """Import MuJoCo, which looks for the library that ``MUJOCO_GL`` names at once. TorchRL imports it too.

    Raises:
        RenderingUnavailableError: that library does not work.
    """
    try:
        importlib.import_module("mujoco")
    except Exception as error:
        backend = os.environ.get("MUJOCO_GL")
        if not backend:
            raise
        raise RenderingUnavailableError(
            f"MuJoCo does not load with MUJOCO_GL={backend} ({error}); unset MUJOCO_GL or name a library that is installed"
        ) from error
