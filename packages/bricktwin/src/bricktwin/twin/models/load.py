"""Loader of a robot's MuJoCo model: a plan, an MJCF file, a function, or a generated driving robot."""

from __future__ import annotations

import importlib
from pathlib import Path

import mujoco

from brickhub.errors import TwinError
from brickhub.robot import Robot
from bricktwin.robots.planned import plan_file
from bricktwin.twin.models.driving_robot import driving_robot
from bricktwin.twin.models.mjcf import pair_contacts
from bricktwin.twin.models.mjcf_file import from_file
from bricktwin.twin.models.planned_model import from_plan
from bricktwin.twin.models.scenery import add_objects
from bricktwin.twin.objects import Block
from bricktwin.twin.scene import Scene


def load_model(robot: Robot, scene: Scene, *, alone: bool = True) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the description has neither a model nor a drive base, or the model
    cannot be loaded or does not match the robot.

    ``alone``: whether the robot can touch nothing but this scene's obstacles.
    """
    source = robot.model or robot.plan
    plan = None if source is None else plan_file(source)
    is_generated = plan is not None or source is None
    if plan is not None:
        spec = from_plan(plan, robot, scene)
    elif source is None:
        spec = driving_robot(robot, scene)
    elif source.endswith(".xml"):
        spec = from_file(Path(source), robot, scene)
    else:
        spec = _from_function(robot, source, scene)
    if scene.wall_distance_mm is not None and not any(sensor.kind.model.range_mm for sensor in robot.sensors):
        raise TwinError(f"robot '{robot.name}' has no ultrasonic sensor to place it before a wall with; omit the wall")
    if scene.ball and spec.geom("ball") is None:
        raise TwinError(
            f"robot '{robot.name}' has no gripper that could hold a ball; omit the ball, or mark what holds it in its plan "
            "(0 !BRICKSRL BALL X Y Z)"
        )
    add_objects(spec, scene)
    if is_generated and alone and not any(isinstance(item, Block) and item.mass_g is not None for item in scene.objects):
        pair_contacts(spec)
    return spec


def _from_function(robot: Robot, model: str, scene: Scene) -> mujoco.MjSpec:
    """Model from the function ``module:name``."""
    module, _, name = model.partition(":")
    try:
        build = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise TwinError(
            f"the model '{model}' of robot '{robot.name}' cannot be loaded ({error}); give 'module:function' or FILE.xml"
        ) from error
    spec = build(robot, scene) if callable(build) else build
    if not isinstance(spec, mujoco.MjSpec):
        name = type(spec).__name__
        raise TwinError(f"the model '{model}' of robot '{robot.name}' gives {name}; let it be a function that returns an MjSpec")
    return spec
