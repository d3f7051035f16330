"""Models from MJCF files: bodies, joints and geoms come from the file; motors, sensors, floor and wall are added here.

Elements are matched with the robot's description by name:

- a hinge for each motor, positive in the direction in which the motor counts up, after its gears,
- a site for each sensor on the first body, which looks along the site's x axis; a force sensor measures contact forces on that
  body within the site,
- a site ``imu`` at the hub, with its axes: front, left, top; by default at the origin of the first body, as ``hub_sides`` says.
  It is on the first body of a mobile robot, and may be on another one of a robot that stands still.

The first body has a free joint if the robot is mobile. Feet of a legged robot are geoms whose names begin with ``foot_``.
"""

from __future__ import annotations

from pathlib import Path

import mujoco

from brickhub.errors import TwinError, message_of
from brickhub.robot import Robot, Sense
from bricktwin.twin.models.mjcf import (
    LOOKS_GROUP,
    OBSTACLE_GROUP,
    add_camera,
    add_light,
    add_motor,
    add_surroundings,
    set_options,
)
from bricktwin.twin.models.mounts import add_hub_site, add_touch, hub_axes, site_name
from bricktwin.twin.scene import Scene

_CHASE_DISTANCE_M = 0.5


def from_file(path: Path, robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model in an MJCF file, with the robot's motors and sensors, in its scene. Raises TwinError if the file cannot be read, is
    no MJCF, or lacks a joint or a site of the description."""
    if not path.is_file():
        raise TwinError(f"there is no model {path} of robot '{robot.name}'; give the path of an MJCF file")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise TwinError(f"{path} is not an MJCF file ({message_of(error)}); correct it") from error
    set_options(spec)
    base = spec.worldbody.first_body()
    if base is None:
        raise TwinError(f"{path} has no body; describe the robot's parts as bodies")
    for geom in spec.geoms:
        if geom.group == OBSTACLE_GROUP:
            geom.group = LOOKS_GROUP  # ultrasound detects this group only, and must not detect the robot itself
    hinges = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    for motor in robot.motors:
        joint = _named(hinges, motor.name, "hinge", path, robot)
        joint.name = f"motor_{motor.port}"
        add_motor(spec, joint, motor.port, motor.kind, gear=motor.shaft_turns)
    for sensor in robot.sensors:
        site = _named(spec.sites, sensor.name, "site", path, robot)
        _require_first(site, base, path)
        site.name = site_name(sensor)
        if Sense.FORCE in sensor.kind.model.senses:
            add_touch(spec, sensor)
    hub = spec.site("imu")
    if hub is None:
        add_hub_site(base, hub_axes(robot.hub_sides))
    elif any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in base.joints):
        _require_first(hub, base, path)
    try:
        add_surroundings(spec, scene)
        add_camera(base, "chase", (0.0, 0.0, 0.0), (-0.62, -0.62, 0.55), _CHASE_DISTANCE_M)
    except ValueError as error:
        raise TwinError(f"{path}: {message_of(error)}; take it out, as floor, wall and cameras are added to the robot") from error
    add_light(base)
    return spec


def _require_first(site: mujoco.MjsSite, base: mujoco.MjsBody, path: Path) -> None:
    if site.parent.name != base.name:
        raise TwinError(f"{path} has the site '{site.name}' on '{site.parent.name}'; put it on the first body, '{base.name}'")


def _named(elements: list[mujoco.MjsElement], name: str, kind: str, path: Path, robot: Robot) -> mujoco.MjsElement:
    for element in elements:
        if element.name == name:
            return element
    known = ", ".join(element.name for element in elements if element.name) or "none"
    raise TwinError(f"{path} has no {kind} '{name}' of robot '{robot.name}' (it has: {known}); name one so")
