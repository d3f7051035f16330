"""Loader of a robot's MuJoCo model: a plan, an MJCF file, a function, or a generated driving robot.

In an MJCF file are bodies, joints and geoms; motors, sensors, floor and wall are added here.
Elements are matched with the robot's description by name:

- a hinge for each motor, positive in the direction in which the motor counts up, after its gears,
- a site for each sensor on the first body, which looks along the site's x axis; a force sensor
  measures contact forces on that body within the site,
- a site ``imu`` at the hub, with its axes: front, left, top; by default at the origin of the first
  body, as ``hub_sides`` says. It is on the first body of a mobile robot, and may be on another one
  of a robot that stands still.

The first body has a free joint if the robot is mobile. Feet of a legged robot are geoms whose names
begin with ``foot_``.
"""

import importlib
import math
from pathlib import Path

import mujoco

from brickhub.errors import TwinError, message_of
from brickhub.robot import Motor, Robot, Sense
from bricktwin.robots.planned import plan_file
from bricktwin.twin.engines.conventions import LOOKS_GROUP, OBSTACLE_GROUP, motor_name, site_name
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.driving_robot import driving_robot
from bricktwin.twin.models.mounts import add_hub_site, add_touch, hub_axes
from bricktwin.twin.models.planned_model import from_plan
from bricktwin.twin.models.scenery import add_objects
from bricktwin.twin.scene import Scene


def from_file(
    path: Path,
    robot: Robot,
    scene: Scene,
) -> mujoco.MjSpec:
    """Model in an MJCF file, with the robot's motors and sensors, in its scene. Raises TwinError if
    the file cannot be read, is no MJCF, or lacks a joint or a site of the description."""
    if not path.is_file():
        raise TwinError(
            f"there is no model {path} of robot '{robot.name}'; give the path of an MJCF file"
        )
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise TwinError(f"{path} is not an MJCF file ({message_of(error)}); correct it") from error
    mjcf.set_options(spec)
    base = spec.worldbody.first_body()
    if base is None:
        raise TwinError(f"{path} has no body; describe the robot's parts as bodies")
    for geom in spec.geoms:
        if geom.group == OBSTACLE_GROUP:
            # Ultrasound detects only the group of obstacles, and must not detect the robot itself.
            geom.group = LOOKS_GROUP
    # Elements of a user's model are found by the names in the description, and get the names by
    # which they are wired.
    hinges = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    for motor in robot.motors:
        joint = _named(
            hinges,
            motor.name,
            "hinge",
            path,
            robot,
        )
        joint.name = motor_name(motor.port)
        mjcf.add_motor(
            spec,
            joint,
            motor.port,
            motor.kind,
            gear=motor.shaft_turns,
        )
    for sensor in robot.sensors:
        site = _named(
            spec.sites,
            sensor.name,
            "site",
            path,
            robot,
        )
        _require_first(site, base, path)
        site.name = site_name(sensor)
        if Sense.FORCE in sensor.kind.model.senses:
            add_touch(spec, sensor)
    hub = spec.site("imu")
    is_mobile = any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in base.joints)
    if hub is None:
        add_hub_site(base, hub_axes(robot.hub_sides))
    elif is_mobile:
        _require_first(hub, base, path)
    try:
        mjcf.add_surroundings(spec, scene)
        mjcf.add_camera(
            base,
            "chase",
            target=(0.0, 0.0, 0.0),
            direction=(-0.62, -0.62, 0.55),
            distance_m=0.5,
        )
    except ValueError as error:
        raise TwinError(
            f"{path}: {message_of(error)}; take it out, as floor, wall and cameras are added to "
            "the robot"
        ) from error
    mjcf.add_light(base)
    return spec


def _require_first(
    site: mujoco.MjsSite,
    base: mujoco.MjsBody,
    path: Path,
) -> None:
    """Raise TwinError unless a site is on the first body."""
    if site.parent.name != base.name:
        raise TwinError(
            f"{path} has the site '{site.name}' on '{site.parent.name}'; put it on the first "
            f"body, '{base.name}'"
        )


def _named(
    elements: list[mujoco.MjsElement],
    name: str,
    kind: str,
    path: Path,
    robot: Robot,
) -> mujoco.MjsElement:
    """The element of this name. Raises TwinError if there is none."""
    for element in elements:
        if element.name == name:
            return element
    known = ", ".join(element.name for element in elements if element.name) or "none"
    raise TwinError(
        f"{path} has no {kind} '{name}' of robot '{robot.name}' (it has: {known}); name one so"
    )


def load_model(
    robot: Robot,
    scene: Scene,
    *,
    alone: bool = True,
) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the description has neither a model nor
    a drive base, or the model cannot be loaded or does not match the robot.

    ``alone``: whether the robot can touch nothing but this scene's obstacles.
    """
    source = robot.model
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
    has_sonar = any(sensor.kind.model.range_mm for sensor in robot.sensors)
    if scene.wall_distance_mm is not None and not has_sonar:
        raise TwinError(
            f"robot '{robot.name}' has no ultrasonic sensor to place it before a wall with; omit "
            "the wall"
        )
    if scene.ball and spec.geom("ball") is None:
        raise TwinError(
            f"robot '{robot.name}' has no gripper that could hold a ball; omit the ball, or mark "
            "what holds it in its plan "
            "(0 !BRICKSRL BALL X Y Z)"
        )
    add_objects(spec, scene)
    for motor in robot.motors:
        _set_end_stops(spec, robot, motor)
    # Explicit pairs are right only where everything that touches is known: in a generated model,
    # with nothing that another thing may push.
    if is_generated and alone and not scene.pushable:
        mjcf.pair_contacts(spec)
    return spec


def _set_end_stops(
    spec: mujoco.MjSpec,
    robot: Robot,
    motor: Motor,
) -> None:
    """Limit the joint of a motor to the end stops of its description. Raises TwinError if it does
    not start between them."""
    if motor.end_stops_deg is None:
        return
    joint = spec.joint(motor_name(motor.port))
    actuator = spec.actuator(motor_name(motor.port))
    # Degrees at the output become radians of the joint; a negative gear swaps the ends.
    gear = float(actuator.gear[0])
    stops = [math.radians(angle * motor.shaft_turns) / gear for angle in motor.end_stops_deg]
    low, high = sorted(stops)
    if not low <= joint.ref <= high:
        start_deg = math.degrees(joint.ref * gear) / motor.shaft_turns
        raise TwinError(
            f"motor '{motor.name}' of robot '{robot.name}' starts at {start_deg:.0f} degrees, "
            "outside "
            "of its end stops "
            f"{motor.end_stops_deg}; correct them, or the angle in its plan"
        )
    joint.limited = True
    joint.range = [low, high]


def _from_function(
    robot: Robot,
    model: str,
    scene: Scene,
) -> mujoco.MjSpec:
    """Model from the function ``module:name``."""
    module, _, name = model.partition(":")
    try:
        build = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise TwinError(
            f"the model '{model}' of robot '{robot.name}' cannot be loaded ({error}); give "
            "'module:function' or FILE.xml"
        ) from error
    spec = build(robot, scene) if callable(build) else build
    if not isinstance(spec, mujoco.MjSpec):
        name = type(spec).__name__
        raise TwinError(
            f"the model '{model}' of robot '{robot.name}' gives {name}; let it be a function that "
            "returns an MjSpec"
        )
    return spec
