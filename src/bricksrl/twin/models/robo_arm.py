"""The RoboArm: a turntable that carries hub, motors, lower arm, forearm and a gripper of two mirrored fingers.

A joint's coordinate in MuJoCo is the absolute angle of its motor's shaft, which the hub reads, divided by the gear ratio; so it
is not 0 at the start. Frames: x forward, y left, z up; the z axis of an arm lies along it. Metres and kilograms; looks in mm.
There are no collisions: nothing collides within the ranges of the joints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco

from bricksrl.errors import TwinError
from bricksrl.robots import Motor, Robot
from bricksrl.twin.models import lego
from bricksrl.twin.models.meshes import X_AXIS, Y_AXIS, Z_AXIS, Part, draw
from bricksrl.twin.models.mjcf import (
    LOOKS,
    SHAPE_GROUP,
    Triple,
    add_box,
    add_camera,
    add_driven,
    add_light,
    add_rotor,
    add_surroundings,
    new_spec,
)
from bricksrl.twin.scene import Scene

WEBCAM_HEIGHT_M = 0.68
"""Height of the webcam, above the turntable's axis and looking down."""
BALL_RADIUS_M = 0.024

_TURNTABLE_Z, _SHOULDER_Z, _LOWER_ARM, _WRIST, _BALL_Z = 0.036, 0.068, 0.112, 0.096, 0.136
_FINGER_Y = 0.028
_LEAN_DEG, _ELBOW_DEG = 18.0, 100.0
"""Forward tilt of the lower arm at the start, and of the forearm relative to it."""
_HUB = (-0.075, 0.0, 0.054)


@dataclass(frozen=True)
class _Joint:
    """Joint of a motor.

    Attributes:
        gear: turns of the shaft per turn of the joint; negative for opposite directions.
        start_deg: absolute angle of the shaft when the hub is switched on.
        stops_deg: angles of the shaft at the end stops; ``None`` for an unlimited joint.
        friction_nm: friction of axles, pins and gear teeth at the joint. Estimates: the arm holds itself while its motors coast.
    """

    gear: float
    start_deg: float
    stops_deg: tuple[float, float] | None
    friction_nm: float


_JOINTS = {
    "rotation": _Joint(3.0, 0.0, None, 0.020),
    "low": _Joint(3.0, 40.0, (0.0, 80.0), 0.100),
    "high": _Joint(-2.0, -70.0, (-165.0, 25.0), 0.045),
    "grab": _Joint(2.0, -95.0, (-158.0, -35.0), 0.005),
}


def build(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the description is not that of a RoboArm, or the scene has a wall or
    turns the robot."""
    if {motor.name for motor in robot.motors} != set(_JOINTS):
        raise TwinError(f"robot '{robot.name}' is not a RoboArm: it needs the motors {', '.join(_JOINTS)}")
    if scene.wall_distance_mm is not None or scene.heading_deg != (0.0, 0.0):
        raise TwinError(f"robot '{robot.name}' stands still and sees no wall; omit wall_distance_mm and heading_deg")
    spec = new_spec(robot.name)
    add_surroundings(spec, scene)
    lego.add_colours(spec)
    world = spec.worldbody
    draw(spec, world, _base_parts())
    turret = _add_joint(spec, world, robot.motor("rotation"), "turret", (0.0, 0.0, _TURNTABLE_Z), (0.0, 0.0, 1.0))
    _add_turret(spec, turret)
    low = _add_joint(spec, turret, robot.motor("low"), "low", (0.0, 0.0, _SHOULDER_Z), (0.0, 1.0, 0.0), _LEAN_DEG)
    add_box(low, (0.0, 0.0, 0.056), (0.004, 0.024, 0.060), 0.040, collides=False)
    add_box(low, (-0.008, 0.0, 0.056), (0.012, 0.016, 0.036), 0.060, collides=False)
    draw(spec, low, _lower_arm_parts())
    high = _add_joint(spec, low, robot.motor("high"), "high", (0.0, 0.0, _LOWER_ARM), (0.0, 1.0, 0.0), _ELBOW_DEG)
    add_box(high, (0.0, 0.0, 0.040), (0.004, 0.030, 0.056), 0.030, collides=False)
    add_box(high, (-0.010, 0.0, 0.036), (0.012, 0.016, 0.036), 0.060, collides=False)
    draw(spec, high, _forearm_parts())
    if scene.ball:
        _add_ball(high)
    _add_gripper(spec, high, robot.motor("grab"))
    add_light(world)
    _add_cameras(world)
    return spec


def _add_joint(
    spec: mujoco.MjSpec, parent: mujoco.MjsBody, motor: Motor, name: str, position: Triple, axis: Triple, tilt_deg: float = 0.0
) -> mujoco.MjsBody:
    """Add a body on a driven joint, with backlash, tilted forward by an angle at the start."""
    joint, half = _JOINTS[motor.name], math.radians(tilt_deg) / 2
    rotor = add_rotor(spec, parent, motor, position, axis, joint.gear, joint.friction_nm)
    rotor.quat = [math.cos(half), 0.0, math.sin(half), 0.0]
    hinge = rotor.joints[0]
    hinge.damping[0], hinge.ref = 1e-3, math.radians(joint.start_deg / joint.gear)
    if joint.stops_deg is not None:
        hinge.limited = True
        hinge.range = sorted(math.radians(angle / joint.gear) for angle in joint.stops_deg)
    return add_driven(rotor, name, motor.port, axis, is_heavy=True)


def _add_turret(spec: mujoco.MjSpec, turret: mujoco.MjsBody) -> None:
    """Add hub and battery, two motors and frame; 0.46 kg."""
    add_box(turret, _HUB, (0.044, 0.028, 0.016), 0.230, collides=False)
    add_box(turret, (-0.017, 0.0, 0.027), (0.012, 0.016, 0.036), 0.060, collides=False)
    add_box(turret, (-0.064, 0.0, 0.022), (0.036, 0.012, 0.016), 0.060, collides=False)
    add_box(turret, (-0.010, 0.0, 0.004), (0.050, 0.030, 0.004), 0.070, collides=False)
    add_box(turret, (0.0, 0.0, 0.040), (0.004, 0.030, 0.034), 0.040, collides=False)
    turret.add_site(name="imu", pos=list(_HUB), group=SHAPE_GROUP)
    motor = lego.medium_motor()
    parts = [
        lego.hub().at(*(1000 * value for value in _HUB)),
        motor.turned(Y_AXIS, -90).at(-17, 0, 51),
        motor.turned(X_AXIS, -90).at(-40, 0, 22),
        lego.gear(20, "light_grey").turned(X_AXIS, 90).at(-40, 0, 1),
        lego.gear(12, "light_grey").at(-17, 36, 51),
        lego.axle(24).at(-17, 28, 51),
    ]
    for side in (1, -1):
        parts.append(lego.beam(9, "white").turned(Y_AXIS, 90).turned(Z_AXIS, 90).at(0, side * 28, 40))
        parts.append(lego.beam(13, "turquoise").turned(X_AXIS, 90).at(-36, side * 28, 8))
        parts.append(lego.beam(7, "turquoise").turned(X_AXIS, 90).turned(Y_AXIS, 45).at(-20, side * 28, 26))
    parts += [lego.beam(7, "dark_grey").turned(Z_AXIS, 90).at(x, 0, 4) for x in (12, -84)]
    parts.append(lego.cable([(-75, -28, 59), (-75, -62, 62), (-110, -60, 26), (-98, -10, 22)]))
    parts.append(lego.cable([(-49, -28, 59), (-48, -58, 64), (-24, -46, 8), (-17, -12, 4)]))
    draw(spec, turret, parts)


def _add_gripper(spec: mujoco.MjSpec, high: mujoco.MjsBody, motor: Motor) -> None:
    """Add two fingers: the motor opens the right one, and the left one mirrors it."""
    right = _add_joint(spec, high, motor, "finger_right", (0.0, -_FINGER_Y, _WRIST), (1.0, 0.0, 0.0))
    left = high.add_body(name="finger_left", pos=[0.0, _FINGER_Y, _WRIST])
    left.add_joint(name="mirrored", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[-1.0, 0.0, 0.0], damping=1e-3, armature=1e-5)
    mirror = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
    mirror.name, mirror.name1, mirror.name2 = "mirror", "mirrored", f"motor_{motor.port}"
    mirror.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]
    for finger in (right, left):
        add_box(finger, (0.0, 0.0, 0.024), (0.012, 0.004, 0.028), 0.009, collides=False)
        parts = [lego.beam(7, "turquoise").turned(Y_AXIS, 90).at(x, 0, 24) for x in (-8, 8)]
        draw(spec, finger, [*parts, lego.beam(3, "black").turned(X_AXIS, 90).at(0, 0, 48), lego.pin("yellow").turned(X_AXIS, 90)])


def _add_ball(high: mujoco.MjsBody) -> None:
    high.add_geom(
        name="ball",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=[0.0, 0.0, _BALL_Z],
        size=[BALL_RADIUS_M, 0, 0],
        mass=0.006,
        material="red",
        **LOOKS,
    )


def _add_cameras(world: mujoco.MjsBody) -> None:
    """Add the cameras. The webcam's image has the robot's front at the bottom and its left on the right."""
    world.add_camera(name="webcam", pos=[0.0, 0.0, WEBCAM_HEIGHT_M], xyaxes=[0, 1, 0, -1, 0, 0], fovy=45)
    add_camera(world, "chase", (0.02, 0.0, 0.10), (0.80, -0.75, 0.42), 0.60)
    add_camera(world, "portrait", (0.022, 0.0, 0.108), (0.55, -0.85, 0.30), 0.54)


def _base_parts() -> list[Part]:
    parts = [lego.turntable().at(0, 0, 28)]
    for side in (1, -1):
        parts.append(lego.beam(15, "turquoise").at(0, side * 52, 12))
        parts.append(lego.beam(15, "turquoise").at(0, side * 44, 12))
        parts.append(lego.beam(15, "dark_grey").turned(Z_AXIS, 90).at(side * 48, 0, 4))
        parts.append(lego.beam(13, "white").turned(Z_AXIS, 90).at(side * 20, 0, 19.8))
    return parts


def _lower_arm_parts() -> list[Part]:
    parts = [
        lego.medium_motor().turned(Y_AXIS, -90).at(-8, 0, 83),
        lego.gear(36, "dark_grey").at(0, 36, 0),
        lego.gear(20, "light_grey").at(-8, 36, 83),
        lego.axle(76).at(0, 0, 0),
        lego.axle(24).at(-8, 28, 83),
    ]
    return parts + [lego.beam(15, "white").turned(Y_AXIS, 90).at(0, y, 56) for y in (20, -20)]


def _forearm_parts() -> list[Part]:
    parts = [
        lego.medium_motor().turned(Y_AXIS, -90).at(-10, 0, 72),
        lego.gear(40, "dark_grey").at(0, 36, 0),
        lego.axle(76).at(0, 0, 0),
    ]
    parts += [lego.beam(9, "dark_grey").turned(Z_AXIS, 90).turned(Y_AXIS, 90).at(x, 0, 88) for x in (8, -8)]
    parts += [lego.gear(20, "light_grey").at(0, y, 96) for y in (17, -17)]
    return parts + [lego.beam(13, "black").turned(Y_AXIS, 90).at(0, y, 48) for y in (28, -28)]
