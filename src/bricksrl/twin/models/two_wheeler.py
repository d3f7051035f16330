"""Model of the 2Wheeler: hub over two motors, ultrasonic sensor in front, ball caster behind.

Frame of the chassis: x forward, y left, z up, origin in the middle of the axle. Metres and kilograms; looks in mm.
"""

from __future__ import annotations

import mujoco

from bricksrl.errors import TwinError
from bricksrl.robots import Motor, PoweredUpSensor, Robot, UltrasonicSensor
from bricksrl.twin.models import lego
from bricksrl.twin.models.meshes import X_AXIS, Y_AXIS, Z_AXIS, Part, draw
from bricksrl.twin.models.mjcf import (
    SHAPE_GROUP,
    add_box,
    add_camera,
    add_caster,
    add_driven,
    add_light,
    add_rotor,
    add_surroundings,
    add_tyre,
    new_spec,
)
from bricksrl.twin.models.mounts import mount_sensor
from bricksrl.twin.scene import Scene

_HUB = (-0.016, 0.0, 0.036)
_EYES = (0.058, 0.0, 0.024)
_CASTER = (-0.056, 0.0, -0.0184)
_CASTER_RADIUS = 0.0096
_MOTOR_Y = 0.028
_TYRE_HALF_WIDTH = 0.007


def build(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the description is not that of a 2Wheeler."""
    base = robot.drive_base
    sensors = [sensor for sensor in robot.sensors if isinstance(sensor, UltrasonicSensor)]
    if base is None or len(sensors) != 1:
        raise TwinError(f"robot '{robot.name}' is not a 2Wheeler: it needs a drive base and one ultrasonic sensor")
    spec = new_spec(robot.name)
    radius, half_track = base.wheel_diameter_mm / 2000, base.axle_track_mm / 2000
    add_surroundings(spec, scene)
    chassis = spec.worldbody.add_body(name="chassis", pos=[0.0, 0.0, radius])
    chassis.add_freejoint(name="root")
    _add_masses(chassis)
    chassis.add_site(name="imu", pos=list(_HUB), group=SHAPE_GROUP)
    chassis.add_site(name=f"ultrasonic_{sensors[0].port}", pos=list(_EYES), group=SHAPE_GROUP)
    further = [mount_sensor(spec, chassis, sensor, radius) for sensor in robot.sensors if isinstance(sensor, PoweredUpSensor)]
    _add_wheel(spec, chassis, robot.motor(base.left), half_track, radius)
    _add_wheel(spec, chassis, robot.motor(base.right), -half_track, radius)
    lego.add_colours(spec)
    draw(spec, chassis, [*_chassis_parts(), *further])
    add_light(chassis)
    add_camera(chassis, "chase", (-0.005, 0.0, 0.01), (-0.62, -0.62, 0.55), 0.42)
    add_camera(chassis, "portrait", (-0.002, 0.0, 0.008), (0.75, -0.52, 0.45), 0.30)
    return spec


def _add_masses(chassis: mujoco.MjsBody) -> None:
    """Add estimated masses, 0.47 kg with the wheels: hub and battery, motors, sensor, frame, caster."""
    add_box(chassis, _HUB, (0.044, 0.028, 0.016), 0.230)
    for side in (1, -1):
        add_box(chassis, (-0.024, side * _MOTOR_Y, 0.0), (0.036, 0.016, 0.012), 0.060)
    add_box(chassis, (0.046, 0.0, 0.024), (0.012, 0.028, 0.012), 0.030)
    add_box(chassis, (-0.020, 0.0, 0.016), (0.044, 0.024, 0.004), 0.040)
    add_caster(chassis, _CASTER, _CASTER_RADIUS, 0.010)


def _add_wheel(spec: mujoco.MjSpec, chassis: mujoco.MjsBody, motor: Motor, y: float, radius: float) -> None:
    """Add a motor's rotor and the wheel on it with backlash.

    A motor's shaft points outwards, and clockwise is seen from there: the axis of a positive turn points inwards.
    """
    side = 1.0 if y > 0 else -1.0
    axis = (0.0, -side, 0.0)
    rotor = add_rotor(spec, chassis, motor, (0.0, y, 0.0), axis)
    wheel = add_driven(rotor, f"wheel_{motor.port}", motor.port, axis)
    add_tyre(wheel, motor.port, radius, _TYRE_HALF_WIDTH, 0.018)
    draw(spec, rotor, [lego.motor_output().at(0, side * (44.0 - abs(y) * 1000), 0), lego.axle(26).at(0, -side * 9, 0)])
    draw(spec, wheel, [lego.wheel(radius * 2000)])


def _chassis_parts() -> list[Part]:
    motor = lego.medium_motor()
    parts = [
        lego.hub().at(-16, 0, 36),
        motor.at(0, 28, 0),
        motor.turned(X_AXIS, 180).at(0, -28, 0),
        lego.ultrasonic_sensor().at(46, 0, 24),
        lego.ball_caster(9.6).at(-56, 0, -18.4),
    ]
    for side in (1, -1):
        parts.append(lego.beam(13, "turquoise").turned(X_AXIS, 90).at(-12, side * 20, 16))
        parts += [lego.pin("blue").turned(X_AXIS, 90).at(x, side * 24, 16) for x in (-60, 20)]
        parts.append(lego.beam(3, "dark_grey").turned(Y_AXIS, 90).at(-60, side * 8, 8))
    for x in (20, -52):
        parts.append(lego.beam(9, "dark_grey").turned(Z_AXIS, 90).at(x, 0, 16))
    parts.append(lego.cable([(-42, 28, 41), (-42, 62, 44), (-80, 46, 6), (-61, 28, 2)]))
    parts.append(lego.cable([(10, 28, 41), (12, 52, 44), (44, 46, 44), (44, 20, 35)]))
    parts.append(lego.cable([(-42, -28, 41), (-42, -62, 44), (-80, -46, 6), (-61, -28, 2)]))
    return parts
