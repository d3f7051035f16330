"""Factory of the bodies of virtual robots: a MuJoCo model, its own or that of a driving robot, else the bench."""

from __future__ import annotations

import importlib
import logging
import os
import sys

from bricksrl.errors import TwinError
from bricksrl.robots import Robot
from bricksrl.twin.physics import Physics, RandomPhysics
from bricksrl.twin.scene import OPEN_FLOOR, Scene
from bricksrl.virtual_hub.body import Body

_log = logging.getLogger(__name__)


def make_body(robot: Robot, *, scene: Scene | None = None, physics: Physics | RandomPhysics | None = None, seed: int = 0) -> Body:
    """Build the physical half of a virtual robot.

    Args:
        robot: any; one without a MuJoCo model of its own drives if it has a drive base, from whose numbers it gets a body, and
            else lies on the bench, where its motors turn without load. There it lies too if its scene says what it reads.
        scene: what stands around it; ``None`` for an open floor.
        physics: its parameters, or how to draw them for each episode; ``None`` for the defaults.
        seed: of the noise of its sensors and of its first start.

    Raises:
        TwinError: the robot cannot be put into this scene, or has a sensor of which nothing says what it reads.
    """
    scene = scene or OPEN_FLOOR
    is_told = bool(scene.readings or scene.end_stops)
    is_modelled = robot.model is not None or robot.plan is not None
    if is_modelled or (robot.drive_base is not None and not is_told):
        if is_told:
            raise TwinError(
                f"the MuJoCo model of '{robot.name}' has sensors of its own; leave the scene's readings and end stops away, or "
                "the model (model=None), and it lies on the bench"
            )
        check_mujoco()
        from bricksrl.twin.mujoco_body import MujocoBody

        return MujocoBody(robot, scene, physics or Physics(), seed)
    from bricksrl.twin.bench_twin import BenchTwin

    if scene.wall_distance_mm is not None or scene.ball or scene.objects:
        raise TwinError(
            f"robot '{robot.name}' lies on the bench, without wall, ball or other objects; describe a drive base or a model and "
            "no readings, or give Scene(readings=...) only"
        )
    return BenchTwin(robot, scene, physics)


def check_mujoco() -> None:
    """Import MuJoCo, which looks for the library that ``MUJOCO_GL`` names at once; without it where that does not work."""
    try:
        importlib.import_module("mujoco")
    except Exception as error:
        backend = os.environ.get("MUJOCO_GL", "")
        if not backend or backend == "disable":
            raise
        _log.warning("MUJOCO_GL=%s does not work (%s); everything but pictures and videos does", backend, error)
        os.environ["MUJOCO_GL"] = "disable"
        for name in [name for name in sys.modules if name == "mujoco" or (name.startswith("mujoco.") and "._" not in name)]:
            del sys.modules[name]  # the compiled ones stay: they are loaded once
        importlib.import_module("mujoco")
