"""Mounts of sensors: sites in a sensor's viewing direction, its case, and a force sensor's touch
sensor."""

import functools
import math

import mujoco
import numpy as np

from brickhub.robot import Mount, Sense, Sensor, SensorKind
from brickhub.robot.spec import LOOKS
from bricktwin.plans import catalogue
from bricktwin.plans.drawing import pieces
from bricktwin.plans.drawing.pieces import Piece, piece
from bricktwin.plans.drawing.shapes import X_AXIS, Z_AXIS, box, cylinder, ring
from bricktwin.plans.geometry import MM_PER_LDU, Floats, Triple, triple
from bricktwin.plans.part import DeviceKind
from bricktwin.twin.engines.conventions import SHAPE_GROUP, site_name
from bricktwin.twin.models.mjcf import add_box, quaternion

_BUTTON_MM = 8.0
"""Length of a force sensor's button."""
_BUTTON_KG = 0.002
_AHEAD = Mount((60.0, 0.0, 40.0))
_FACING_FLOOR = Mount((60.0, 0.0, 12.0), "down")
_MOUNTS = {
    SensorKind.COLOR: _FACING_FLOOR,
    SensorKind.COLOR_DISTANCE: _FACING_FLOOR,
    SensorKind.FORCE: Mount((80.0, 0.0, 30.0)),
    SensorKind.EV3_COLOR: _FACING_FLOOR,
    SensorKind.EV3_TOUCH: Mount((80.0, 0.0, 30.0)),
    # A gyroscope's axis is where it looks.
    SensorKind.EV3_GYRO: Mount((-60.0, 0.0, 90.0), "up"),
}
"""Default mount of each kind of sensor; others are in front and look ahead."""
_UNKNOWN_SENSOR: tuple[Triple, float] = ((24.0, 24.0, 24.0), 12.0)
"""Size (mm) and mass (g) of a sensor that is not in the catalogue."""


@functools.cache
def case_of(kind: DeviceKind, name: str) -> tuple[Triple, float] | None:
    """Size of an electric part's case, the longest side first (mm), and its mass (g); ``None`` if
    not in the catalogue."""
    for part in catalogue.parts():
        device = part.device
        if device is None:
            continue
        if device.kind != kind or device.name != name:
            continue
        # An electric part's first solid is its case.
        sides_mm = [2.0 * MM_PER_LDU * half for half in part.solids[0].half]
        longest, middle, shortest = sorted(sides_mm, reverse=True)
        return (longest, middle, shortest), part.mass_g
    return None


def hub_axes(sides: tuple[str, ...]) -> Floats:
    """Rotation matrix [3, 3] from the axes of a hub, whose top and front look to these sides of the
    robot, to the robot's."""
    top_side, front_side = sides
    top = np.array(LOOKS[top_side])
    front = np.array(LOOKS[front_side])
    # Pybricks counts the axes of a hub as x to its front, y to its left and z to its top.
    left = np.cross(top, front)
    return np.column_stack([front, left, top])


def add_hub_site(
    body: mujoco.MjsBody,
    axes: Floats,
    at_m: Triple = (0.0, 0.0, 0.0),
) -> None:
    """Add the site of a hub. ``axes``: rotation matrix [3, 3] from the hub's axes to the body's."""
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, axes.ravel())
    body.add_site(
        name="imu",
        pos=list(at_m),
        quat=turn.tolist(),
        group=SHAPE_GROUP,
    )


def mount_of(sensor: Sensor) -> Mount:
    """Mount of a sensor; by default that of its kind."""
    return sensor.mount or _MOUNTS.get(sensor.kind, _AHEAD)


def mount_sensor(
    spec: mujoco.MjSpec,
    chassis: mujoco.MjsBody,
    sensor: Sensor,
    axle_m: float,
) -> Piece:
    """Add a sensor's site, mass and button to a chassis with its origin at ``axle_m`` height;
    returns the drawn part (mm)."""
    mount = mount_of(sensor)
    ahead, left, up = mount.at_mm
    # A mount is given from the floor, but everything else here from the origin of the chassis.
    above_axle = up - axle_m * 1000.0
    eye = np.array([ahead, left, above_axle])
    gaze = np.array(LOOKS[mount.looks])
    case = case_of(DeviceKind.SENSOR, sensor.kind.value)
    size, mass_g = case or _UNKNOWN_SENSOR
    axis, angle_deg = _turn_to(gaze)
    turn = quaternion(axis, math.radians(angle_deg))
    add_sensor_site(
        spec,
        chassis,
        sensor,
        eye / 1000,
        turn,
    )

    if Sense.FORCE in sensor.kind.model.senses:
        # What touches the button must not touch the case as well, because no sensor measures the
        # contacts of the case.
        button_middle = eye - gaze * _BUTTON_MM / 2
        button_size = (_BUTTON_MM, 16.0, 16.0)
        half_length = max(size) / 2
        case_middle = eye - gaze * (half_length + _BUTTON_MM)
        case_kg = mass_g / 1000 - _BUTTON_KG
        add_box(
            chassis,
            button_middle,
            button_size,
            _BUTTON_KG,
            turn=turn,
        )
        add_box(
            chassis,
            case_middle,
            size,
            case_kg,
            turn=turn,
            collides=False,
        )
        drawing = _force_sensor(size)
        return drawing.turned(axis, angle_deg).at(*eye.tolist())

    # Other sensors look out of one of their large sides, so the shortest side lies along the gaze.
    depth = min(size)
    middle = eye - gaze * depth / 2
    is_sonar = sensor.kind.model.range_mm is not None
    add_box(
        chassis,
        middle,
        (depth, size[0], size[1]),
        mass_g / 1000,
        turn=turn,
        collides=is_sonar,
    )
    drawing = pieces.ultrasonic_sensor().at(-13.0, 0, 0) if is_sonar else _small_sensor(size)
    return drawing.turned(axis, angle_deg).at(*eye.tolist())


def add_sensor_site(
    spec: mujoco.MjSpec,
    chassis: mujoco.MjsBody,
    sensor: Sensor,
    at_m: Floats,
    turn: list[float],
) -> None:
    """Add a sensor's site, whose x axis is the viewing direction; that of a force sensor measures
    the contacts near it."""
    pose = {"name": site_name(sensor), "pos": at_m.tolist(), "quat": turn}
    if Sense.FORCE in sensor.kind.model.senses:
        # MuJoCo's touch sensor adds up the contacts within its site, so the site is a box around
        # the button alone.
        chassis.add_site(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.012] * 3,
            group=5,
            **pose,
        )
        add_touch(spec, sensor)
    else:
        chassis.add_site(group=SHAPE_GROUP, **pose)


def add_touch(spec: mujoco.MjSpec, sensor: Sensor) -> None:
    """Add a touch sensor of the contact forces (N) within a sensor's site."""
    spec.add_sensor(
        name=f"force_{sensor.port}",
        type=mujoco.mjtSensor.mjSENS_TOUCH,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=site_name(sensor),
    )


def _turn_to(gaze: Floats) -> tuple[Triple, float]:
    """Axis and angle in degrees of a rotation of x to a direction along an axis."""
    axis = np.cross(X_AXIS, gaze)
    if axis.any():
        return triple(axis), 90.0
    # For a gaze along x the cross product is zero: there is no turn ahead, and half a turn about
    # the vertical behind.
    return Z_AXIS, 90.0 - 90.0 * gaze[0]


def _small_sensor(size: Triple) -> Piece:
    """Sensor with one round eye, facing x; its eye is the origin."""
    width, height, depth = size
    case = box(depth - 2, width, height, radius=2.0)
    eye = cylinder(8.8, 1.6, bevel=0.4).along(X_AXIS)
    rim = ring(8.6, 6.2, 2.0).along(X_AXIS)
    return piece(
        white=case.at(-depth / 2 - 1, 0, 0),
        black=eye.at(-1.4, 0, 0),
        azure=rim.at(-0.8, 0, 0),
    )


def _force_sensor(size: Triple) -> Piece:
    """Force sensor facing x, with its button at the end; the button's front is the origin."""
    length, width, height = size
    middle = -_BUTTON_MM - length / 2
    case = box(length, width, height, radius=2.0)
    button = cylinder(8.0, _BUTTON_MM, bevel=1.0).along(X_AXIS)
    stripe = box(
        length * 0.4,
        width + 0.4,
        6,
        radius=0.8,
    )
    return piece(
        white=case.at(middle, 0, 0),
        black=button.at(-_BUTTON_MM / 2, 0, 0),
        light_grey=stripe.at(middle, 0, 3),
    )
