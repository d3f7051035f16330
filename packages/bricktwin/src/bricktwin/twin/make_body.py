"""Factory of virtual robots' bodies: the robot's MuJoCo model or a generated driving robot, else
the bench."""

import importlib
import logging
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from brickhub.errors import TwinError
from brickhub.hub.link.profiles import usual_link
from brickhub.robot import Robot
from brickhub.robot.spec import with_end_stops
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body, Rng
from bricktwin.twin.physics import DRAWN_CABLES, Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene


class BenchTwin(BenchBody):
    """Bench body with the physics of a twin: battery, motor friction, link. Raises TwinError if the
    scene lacks the readings of a sensor, or names one that the robot does not have.

    Args:
        scene: scene with ``readings``.
        physics: the parameters, or a sampler of them for each episode; ``None`` for the firmware's
            own motor simulation at 7.2 V.

    Attributes:
        physics: the present parameters.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        physics: Physics | RandomPhysics | None,
    ) -> None:
        super().__init__(robot, scene.readings, scene.end_stops)
        self.physics = Physics()
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        # Without physics, the body keeps the firmware's own simulation of motors.
        if isinstance(physics, Physics):
            self._apply(physics)
        elif physics is not None:
            self._apply(self.physics)

    def _apply(self, physics: Physics) -> None:
        self.physics = physics
        self.battery_mv = round(physics.battery_v * 1000)
        self.motor_friction_scale = physics.motor_friction_scale
        self.link = physics.link

    def reset(self, rng: Rng) -> None:
        """Draw random physics, if any. On a bench there is nothing to place."""
        if self._random_physics is not None:
            self._apply(self._random_physics.sample(rng))


_log = logging.getLogger(__name__)


def make_body(
    robot: Robot,
    *,
    scene: Scene | None = None,
    physics: Physics | RandomPhysics | None = None,
    seed: int = 0,
    end_stops: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> Body:
    """Build the body of a virtual robot. Raises TwinError if the robot cannot be placed in this
    scene, or a sensor has no readings.

    Args:
        robot: any robot. Without a MuJoCo model, its body is generated from its drive base, or is a
            bench, where its motors turn without load, if it has no drive base or if the scene
            defines readings.
        scene: surroundings of the robot; ``None`` for an open floor.
        physics: parameters, or a sampler of them for each episode; ``None`` for the defaults.
        seed: seed of the sensors' noise and of the first start.
        end_stops: lowest and highest angle of a motor (deg at the output, by its name), in place of
            those of the scene and of the description.
    """
    robot.check_complete()
    scene = scene or OPEN_FLOOR
    # All end stops are put into the robot, so that from here on nobody has to ask who gave them.
    robot = with_end_stops(robot, {**scene.end_stops, **end_stops})
    scene = replace(scene, end_stops={})
    if isinstance(physics, RandomPhysics) and not robot.hub.model.has_bluetooth:
        physics = replace(physics, links=DRAWN_CABLES)
    if not lies_on_bench(robot, scene):
        if scene.readings:
            raise TwinError(
                f"the MuJoCo model of '{robot.name}' has sensors of its own; omit the scene's "
                "readings, or the model "
                "(model=None), and it lies on the bench"
            )
        # This comes late, because a robot on the bench needs no MuJoCo.
        check_mujoco()
        from bricktwin.twin.mujoco_body import MujocoBody

        return MujocoBody(
            robot,
            scene,
            physics or Physics().with_link(usual_link(robot.hub.model)),
            seed,
        )

    if scene.wall_distance_mm is not None or scene.ball or scene.objects:
        raise TwinError(
            f"robot '{robot.name}' lies on the bench, without wall, ball or other objects; "
            "describe a drive base or a model and "
            "no readings, or give Scene(readings=...) only"
        )
    return BenchTwin(robot, scene, physics)


def lies_on_bench(robot: Robot, scene: Scene) -> bool:
    """Whether `make_body` gives a robot no body that can be seen, only a bench."""
    if robot.model is not None:
        return False
    return robot.drive_base is None or bool(scene.readings)


ASKED_GL = "BRICKTWIN_MUJOCO_GL"
"""Variable that keeps the value of ``MUJOCO_GL`` that does not work, for this process and its
children."""


def check_mujoco() -> None:
    """Import MuJoCo, which loads the library of ``MUJOCO_GL`` at once; if that fails, import it
    without rendering."""
    try:
        importlib.import_module("mujoco")
    except Exception as error:
        backend = os.environ.get("MUJOCO_GL", "")
        if not backend or backend == "disable":
            raise
        _log.warning(
            "MUJOCO_GL=%s does not work (%s); everything but pictures and videos does",
            backend,
            error,
        )
        os.environ["MUJOCO_GL"] = "disable"
        # The variable is changed above, so a renderer that fails could not name what the user asked
        # for without this copy.
        os.environ[ASKED_GL] = backend
        for name in list(sys.modules):
            # Compiled modules stay, because they can be loaded only once.
            is_compiled = "._" in name
            if name == "mujoco" or (name.startswith("mujoco.") and not is_compiled):
                del sys.modules[name]
        importlib.import_module("mujoco")
