"""Robot's file in a tab: the robot and scene in it, and their body."""

import random
from typing import Any

from brickhub.robot import Robot
from brickhub.seed import derive_seed
from bricktwin.site.tab.js_engine import JsEngine
from bricktwin.site.tab.plain_values import read_plain
from bricktwin.twin.body import NoiseSources, TwinBody
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene


class Draws(random.Random):
    """Generator of random numbers with NumPy's name of the normal ones."""

    def standard_normal(self) -> float:
        """A normally distributed number, of mean 0 and deviation 1."""
        return self.gauss(0.0, 1.0)


def robot_in(file: dict[str, Any]) -> Robot:
    """The robot of a file."""
    robot: Robot = read_plain(file["robot"])
    return robot


def scene_in(file: dict[str, Any]) -> Scene:
    """The scene of a file."""
    scene: Scene = read_plain(file["scene"])
    return scene


def body_in_tab(
    file: dict[str, Any],
    handle: Any,
    physics: Physics | RandomPhysics | None = None,
    seed: int = 0,
) -> TwinBody:
    """Body of a file's robot as of :func:`body_of`, on an ``Engine`` of ``engine.js`` that was made
    of the same file."""
    return body_of(
        file,
        JsEngine(handle),
        physics,
        seed,
    )


def body_of(
    file: dict[str, Any],
    engine: Engine,
    physics: Physics | RandomPhysics | None = None,
    seed: int = 0,
) -> TwinBody:
    """Body of a file's robot in its scene. Raises TwinError if the robot cannot stand at each of
    its starts.

    Args:
        engine: engine of the file's model.
        physics: parameters, or a sampler of them for each reset; ``None`` for the defaults.
        seed: seed of the sensors' noise and of the first start.
    """
    physics = physics or Physics()
    body = TwinBody(
        robot_in(file),
        scene_in(file),
        engine,
        Physics() if isinstance(physics, RandomPhysics) else physics,
        # A seed for each purpose: how often a sensor is read must not move the start.
        NoiseSources(
            readings=Draws(derive_seed(seed, "readings")),
            heading=Draws(derive_seed(seed, "heading")),
        ),
    )
    body.begin(physics, Draws(derive_seed(seed, "start")))
    return body
