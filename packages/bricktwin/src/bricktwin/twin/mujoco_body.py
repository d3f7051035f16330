"""Body simulated by MuJoCo's Python build."""

import functools
from pathlib import Path

import mujoco
import numpy as np

from brickhub.robot import Robot
from bricktwin.plans import ldraw_library
from bricktwin.twin.body import NoiseSources, TwinBody
from bricktwin.twin.engines.conventions import site_name
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.kept_models import model_stamps, robot_model
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene


@functools.lru_cache(maxsize=8)
def _compiled(
    robot: Robot,
    scene: Scene,
    _looks: Path | None,
    _stamps: tuple[tuple[str, int, int], ...],
) -> mujoco.MjModel:
    """Compiled model, cached because a new body is made often and a copy takes a tenth of the time.
    An engine copies it. The stamps are of its files, as somebody may go on drawing meanwhile."""
    return robot_model(robot, scene)


class MujocoBody(TwinBody):
    """Robot in MuJoCo; implements :class:`brickhub.virtual.body.Body`. Raises TwinError if there is
    no model of this robot, or it cannot be placed in this scene.

    Args:
        robot: description of the robot.
        scene: surroundings of the robot.
        physics: parameters, or a sampler of them for each reset.
        seed: seed of the sensors' noise and of the first start.

    Attributes:
        model, data: MuJoCo's model and data, e.g. for a renderer.
    """

    engine: MujocoEngine

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        physics: Physics | RandomPhysics,
        seed: int,
    ) -> None:
        # A seed for each purpose: how often a sensor is read must not move the start.
        noise_seed, start_seed, heading_seed = np.random.SeedSequence(seed).spawn(3)
        super().__init__(
            robot,
            scene,
            MujocoEngine(_compiled(robot, scene, ldraw_library.folder(), model_stamps(robot))),
            Physics() if isinstance(physics, RandomPhysics) else physics,
            NoiseSources(np.random.default_rng(noise_seed), np.random.default_rng(heading_seed)),
        )
        self.begin(physics, np.random.default_rng(start_seed))

    @property
    def model(self) -> mujoco.MjModel:
        return self.engine.model

    @property
    def data(self) -> mujoco.MjData:
        return self.engine.data

    def sensor_place_mm(self, name: str) -> tuple[float, float, float]:
        """Where a sensor's eye is now, in the world: ahead of its origin, to the left of it, and
        above the floor. Raises DescriptionError if the robot has no sensor of that name."""
        site = self.model.site(site_name(self.robot.sensor(name))).id
        x_m, y_m, z_m = (float(value) for value in self.data.site_xpos[site])
        return 1000 * x_m, 1000 * y_m, 1000 * z_m

    def update_visuals(self) -> None:
        """Update the drawn geometry, cameras and lights to the joint positions, for renderers;
        physics steps do not."""
        super().update_visuals()
        mujoco.mj_camlight(self.model, self.data)
