"""Model of the Walker: four legs on cranks under a flat hub, ultrasonic sensor in front.

A leg is a beam. A crank turns one of its holes and a rocker guides its upper end, so that its foot moves in a loop:
backward on the ground, forward through the air. Frame of the chassis: x forward, y left, z up, cranks 20 mm below the
origin. Metres and kilograms; looks in mm. At an angle of 0 a crank points down and its foot is lowest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco

from bricksrl.errors import TwinError
from bricksrl.robots import Motor, Robot, UltrasonicSensor
from bricksrl.twin.models import lego
from bricksrl.twin.models.meshes import X_AXIS, Y_AXIS, Z_AXIS, Part, draw
from bricksrl.twin.models.mjcf import (
    COLLIDING,
    SHAPE_GROUP,
    add_box,
    add_camera,
    add_driven,
    add_light,
    add_rotor,
    add_surroundings,
    new_spec,
    pair_contacts,
    supporting,
)
from bricksrl.twin.models.rods import add_rod
from bricksrl.twin.scene import Scene

_HUB = (0.0, 0.0, 0.016)
_EYES = (0.098, 0.0, 0.016)
_AXIS_X, _AXIS_Z, _LEG_Y = 0.064, -0.020, 0.060
_MOTOR_Y = 0.036
_CRANK, _THIGH, _SHANK, _ROCKER = 0.008, 0.040, 0.056, 0.032
"""Lengths of crank (axis to pin), thigh (pin to upper end), shank (pin to foot) and rocker (between its pins)."""
_ROCKER_AT = (-0.032, 0.040)
"""Position of the rocker's pin on the chassis relative to the crank's axis: x (negative is inwards) and z."""
_FOOT_RADIUS, _FOOT_HALF_WIDTH, _FOOT_OUT = 0.0038, 0.016, 0.004
_HINGE = mujoco.mjtJoint.mjJNT_HINGE


@dataclass(frozen=True)
class _Corner:
    """Position of a leg: ``side`` 1 left, -1 right; ``end`` 1 front, -1 back."""

    side: int
    end: int


_CORNERS = {
    "left_front": _Corner(1, 1),
    "right_front": _Corner(-1, 1),
    "left_back": _Corner(1, -1),
    "right_back": _Corner(-1, -1),
}


def build(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the description is not that of a Walker."""
    sensors = [sensor for sensor in robot.sensors if isinstance(sensor, UltrasonicSensor)]
    if {motor.name for motor in robot.motors} != set(_CORNERS) or len(sensors) != 1:
        raise TwinError(f"robot '{robot.name}' is not a Walker: it needs the motors {', '.join(_CORNERS)}, one ultrasonic sensor")
    spec = new_spec(robot.name)
    # All constraints share the chassis: searching for independent islands would take a tenth of the time in vain.
    # (The pyramidal cone would save another tenth, but bounding and pacing are a quarter slower with it.)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    # Legs interact through the chassis only: the matrices are sparse.
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    add_surroundings(spec, scene)
    chassis = spec.worldbody.add_body(name="chassis", pos=[0.0, 0.0, _CRANK + _SHANK + _FOOT_RADIUS - _AXIS_Z])
    chassis.add_freejoint(name="root")
    _add_masses(chassis)
    chassis.add_site(name="imu", pos=list(_HUB), group=SHAPE_GROUP)
    chassis.add_site(name=f"ultrasonic_{sensors[0].port}", pos=list(_EYES), group=SHAPE_GROUP)
    for motor in robot.motors:
        _add_leg(spec, chassis, motor, _CORNERS[motor.name])
    lego.add_colours(spec)
    _draw_chassis(spec, chassis)
    pair_contacts(spec)
    add_light(chassis)
    add_camera(chassis, "chase", (0.0, 0.0, -0.02), (-0.45, -0.80, 0.50), 0.52)
    add_camera(chassis, "portrait", (0.004, 0.0, -0.018), (0.72, -0.62, 0.36), 0.42)
    return spec


def _add_masses(chassis: mujoco.MjsBody) -> None:
    """Add estimated masses, 0.68 kg with the legs: hub and battery, motors, sensor, frame."""
    add_box(chassis, _HUB, (0.044, 0.028, 0.016), 0.230)
    add_box(chassis, (0.0, 0.0, -0.004), (0.060, 0.044, 0.004), 0.060)
    add_box(chassis, (0.086, 0.0, 0.016), (0.012, 0.028, 0.012), 0.030)
    for corner in _CORNERS.values():
        add_box(chassis, (corner.end * 0.040, corner.side * _MOTOR_Y, _AXIS_Z), (0.036, 0.016, 0.012), 0.060)


def _add_leg(spec: mujoco.MjSpec, chassis: mujoco.MjsBody, motor: Motor, corner: _Corner) -> None:
    """Add rotor, crank with backlash, leg, and the rocker from the chassis to the leg's upper end.

    The motors' shafts point to the middle of the robot, and clockwise is seen from there; an axle through each motor
    drives its crank on the outside.
    """
    port, axis = motor.port, (0.0, float(corner.side), 0.0)
    rotor = add_rotor(spec, chassis, motor, (corner.end * _AXIS_X, corner.side * _LEG_Y, _AXIS_Z), axis)
    crank = add_driven(rotor, f"crank_{port}", port, axis)
    crank.explicitinertial, crank.mass, crank.inertia = True, 0.004, [2e-7, 2e-7, 2e-7]
    leg = crank.add_body(name=f"leg_{port}", pos=[0.0, 0.0, -_CRANK], quat=_about_y(corner.end * _leg_tilt()))
    leg.add_joint(name=f"knee_{port}", type=_HINGE, axis=axis, damping=2e-4)
    bone, foot_y = mujoco.mjtGeom.mjGEOM_CAPSULE, corner.side * _FOOT_OUT
    leg.add_geom(
        type=bone,
        fromto=[0, 0, _THIGH, 0, 0, -_SHANK],
        size=[0.004, 0, 0],
        mass=0.012,
        **{**COLLIDING, "contype": 0},
    )
    leg.add_geom(
        name=f"foot_{port}",
        type=bone,
        fromto=[0, foot_y - _FOOT_HALF_WIDTH, -_SHANK, 0, foot_y + _FOOT_HALF_WIDTH, -_SHANK],
        size=[_FOOT_RADIUS, 0, 0],
        **supporting(0.8, 0.010),
    )
    at = (corner.end * (_AXIS_X + _ROCKER_AT[0]), corner.side * _LEG_Y, _AXIS_Z + _ROCKER_AT[1])
    rocker = add_rod(spec, port, (chassis, at), (leg, (0.0, 0.0, _THIGH)), mass_kg=0.004)
    _draw_leg(spec, crank, leg, rocker, corner)


def _leg_tilt() -> float:
    """Rotation (rad, about y) of a front leg at which its upper end has the rocker's length from the rocker's pin."""
    # Intersection of two circles, around the crank's pin at a crank angle of 0 and around the rocker's.
    x, z = _ROCKER_AT[0], _ROCKER_AT[1] + _CRANK
    distance = math.hypot(x, z)
    along = (distance**2 + _THIGH**2 - _ROCKER**2) / (2 * distance)
    aside = math.sqrt(_THIGH**2 - along**2)
    return math.atan2(x * along + z * aside, z * along - x * aside)


def _about_y(angle: float) -> list[float]:
    return [math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]


def _draw_chassis(spec: mujoco.MjSpec, chassis: mujoco.MjsBody) -> None:
    motor = lego.medium_motor()
    parts: list[Part] = [lego.hub().at(0, 0, 16), lego.ultrasonic_sensor().at(86, 0, 16)]
    for corner in _CORNERS.values():
        # A motor lies along x with its shaft towards the middle.
        facing = motor.turned(Z_AXIS, 0 if corner.end > 0 else 180)
        if corner.side * corner.end > 0:
            facing = facing.turned(X_AXIS, 180)
        parts.append(facing.at(corner.end * 64, corner.side * 36, -20))
        parts.append(lego.axle(24).at(corner.end * 32, corner.side * 50, 20))
    parts += [lego.beam(11, "turquoise").turned(X_AXIS, 90).at(0, y, 20) for y in (44, -44)]
    parts += [lego.beam(11, "dark_grey").turned(Z_AXIS, 90).at(x, 0, -4) for x in (56, 0, -56)]
    parts += [lego.beam(7, "dark_grey").turned(X_AXIS, 90).at(56, y, 10) for y in (12, -12)]
    for side in (1, -1):
        parts.append(lego.cable([(0, side * 28, 21), (0, side * 64, 34), (14, side * 66, -2), (6, side * 46, -16)]))
        parts.append(lego.cable([(-26, side * 28, 21), (-28, side * 64, 34), (-18, side * 66, -2), (-8, side * 46, -16)]))
    parts.append(lego.cable([(26, -28, 21), (30, -58, 30), (62, -50, 34), (76, -20, 20)]))
    draw(spec, chassis, parts)


def _draw_leg(spec: mujoco.MjSpec, crank: mujoco.MjsBody, leg: mujoco.MjsBody, rocker: mujoco.MjsBody, corner: _Corner) -> None:
    side = corner.side
    draw(spec, crank, [lego.motor_output().at(0, -side * 6, 0), lego.pin("blue").turned(X_AXIS, 90).at(0, side * 4, -8)])
    draw(
        spec,
        leg,
        [
            lego.beam(13, "white").turned(Y_AXIS, 90).turned(Z_AXIS, 90).at(0, 0, -8),
            lego.beam(5, "black").turned(Z_AXIS, 90).at(0, side * 4, -56),
            lego.pin("blue").turned(X_AXIS, 90).at(0, side * 4, 40),
        ],
    )
    draw(spec, rocker, [lego.beam(5, "dark_grey").turned(Y_AXIS, 90).turned(Z_AXIS, 90).at(0, -side * 8, 16)])
