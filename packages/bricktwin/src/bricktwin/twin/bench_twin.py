"""Twin of a robot without a MuJoCo model: unloaded motors, and sensors with readings defined by the scene."""

from __future__ import annotations

from brickhub.robot import Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Rng
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene


class BenchTwin(BenchBody):
    """Bench body with the physics of a twin: battery, motor friction, link. Raises TwinError if the scene lacks the readings of a
    sensor, or names one that the robot does not have.

    Args:
        scene: scene with ``readings`` and ``end_stops``.
        physics: the parameters, or a sampler of them for each episode; ``None`` for the firmware's own motor simulation at
            7.2 V.

    Attributes:
        physics: the present parameters.
    """

    def __init__(self, robot: Robot, scene: Scene, physics: Physics | RandomPhysics | None) -> None:
        super().__init__(robot, scene.readings, scene.end_stops)
        self.physics = Physics()
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        if physics is not None:
            self._apply(physics if isinstance(physics, Physics) else self.physics)

    def _apply(self, physics: Physics) -> None:
        self.physics = physics
        self.battery_mv = round(physics.battery_v * 1000)
        self.motor_friction_scale = physics.motor_friction_scale
        self.link_interval_ms = physics.link_interval_ms

    def reset(self, rng: Rng) -> None:
        """Draw random physics, if any; there is nothing to place."""
        if self._random_physics is not None:
            self._apply(self._random_physics.sample(rng))
