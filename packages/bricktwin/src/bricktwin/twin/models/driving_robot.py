"""Driving robot: model generated from the description, for every robot with a drive base and no
model.

Two wheels on an axle, a ball caster, the hub over the motors, sensors at their mounts. Frame of the
chassis: x forward, y left, z up, origin in the middle of the axle. Metres and kilograms; looks in
mm. Sizes and masses of hub, motors and sensors are from the parts catalogue. The drive base drives
forward when both of its motors count up, whatever their orientation.
"""

import mujoco

from brickhub.errors import TwinError
from brickhub.robot import AnyHub, DriveBase, Motor, MotorKind, Robot
from bricktwin.plans.drawing import pieces as drawings
from bricktwin.plans.drawing.pieces import Piece, piece
from bricktwin.plans.drawing.shapes import X_AXIS, Y_AXIS, Z_AXIS, box, cylinder, merge
from bricktwin.plans.geometry import Triple
from bricktwin.plans.part import DeviceKind
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.mounts import add_hub_site, case_of, hub_axes, mount_of, mount_sensor
from bricktwin.twin.scene import Scene

_CASTER_RADIUS_MM = 9.6
_TYRE_WIDTH_MM = 14.0
_FRAME_KG = 0.040
_CASTER_KG = 0.010
_WHEEL_KG = 0.018
_WHEEL_MM = 56.0
"""Mass of a wheel of this diameter; other wheels are scaled by area."""
_HUB_X_MM = -16.0
_CLEARANCE_MM = 3.0
_UNKNOWN_HUB: tuple[Triple, float] = ((64.0, 40.0, 32.0), 100.0)
_DRAWINGS = {"prime": drawings.hub, "spike-medium": drawings.medium_motor}
"""Our drawings of hubs and motors; all others are drawn as their cases."""


def driving_robot(robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of the robot in its scene. Raises TwinError if the robot has no drive base, or its
    wheels are too small or too close together for its motors."""
    if robot.drive_base is None:
        raise TwinError(
            f"robot '{robot.name}' has neither a MuJoCo model nor a drive base; give Robot(..., "
            "model=...)"
        )
    frame = _Frame(robot, robot.drive_base)
    spec = mjcf.new_spec(robot.name, scene)
    axle_m = frame.axle / 1000
    chassis = spec.worldbody.add_body(name="chassis", pos=[0.0, 0.0, axle_m])
    chassis.add_freejoint(name="root")
    frame.add_masses(chassis)
    x, y, z = frame.hub
    add_hub_site(chassis, hub_axes(robot.hub_sides), (x / 1000, y / 1000, z / 1000))
    for motor, side in frame.driving.items():
        frame.add_wheel(spec, chassis, motor, side)
    for motor in robot.motors:
        if motor not in frame.driving:
            # without load
            mjcf.add_rotor(spec, chassis, motor, (0.0, 0.0, 0.08), gear=motor.shaft_turns)
    mjcf.add_colours(spec)
    sensors = [mount_sensor(spec, chassis, sensor, axle_m) for sensor in robot.sensors]
    mjcf.draw(spec, chassis, [*frame.parts(), *sensors])
    mjcf.add_light(chassis)
    reach_m = max(0.42, 4.0 * frame.half_track / 1000)
    mjcf.add_camera(chassis, "chase", (-0.005, 0.0, 0.01), (-0.62, -0.62, 0.55), reach_m)
    mjcf.add_camera(chassis, "portrait", (-0.002, 0.0, 0.008), (0.75, -0.52, 0.45), 0.75 * reach_m)
    return spec


class _Frame:
    """Dimensions in mm, with heights relative to the axle, and what is built of them.

    Attributes:
        driving: the driving motors, and their sides: 1 for the left, -1 for the right.
    """

    def __init__(self, robot: Robot, base: DriveBase) -> None:
        self.robot = robot
        self.driving = {robot.motor(base.left): 1.0, robot.motor(base.right): -1.0}
        self.axle = base.wheel_diameter_mm / 2
        self.half_track = base.axle_track_mm / 2
        self.motor_size, _ = _motor_case(robot.motor(base.left).kind)
        self.hub_size, self.hub_g = case_of(DeviceKind.HUB, robot.hub.value) or _UNKNOWN_HUB
        _, motor_height, motor_width = self.motor_size
        space = self.half_track - _TYRE_WIDTH_MM / 2
        if self.axle < _CASTER_RADIUS_MM or space < motor_width / 2:
            raise TwinError(
                f"robot '{robot.name}': wheels of {base.wheel_diameter_mm:g} mm, "
                f"{base.axle_track_mm:g} mm apart, leave no room "
                f"for its motors; give wheels of {2 * _CASTER_RADIUS_MM:g} mm or more and a wider "
                "axle track"
            )
        self.motor_z = max(0.0, motor_height / 2 + _CLEARANCE_MM - self.axle)
        # Beside its wheel, without overlapping the other motor.
        self.motor_y = max(motor_width / 2, space - 8.0 - motor_width / 2)
        self.top = self.motor_z + motor_height / 2 + 4.0
        hub_x, hub_y = robot.chassis.hub_mm or (_HUB_X_MM, 0.0)
        self.hub = (hub_x, hub_y, self.motor_z + motor_height / 2 + 8.0 + self.hub_size[2] / 2)

    def add_masses(self, chassis: mujoco.MjsBody) -> None:
        """Add the masses of hub, motors, frame, ballast and caster."""
        mjcf.add_box(chassis, self.hub, self.hub_size, self.hub_g / 1000)
        for motor in self.robot.motors:
            size, mass_g = _motor_case(motor.kind)
            centre = (self.hub[0], 0.0, self.hub[2] + 30.0)
            if motor in self.driving:
                centre = (12.0 - size[0] / 2, self.driving[motor] * self.motor_y, self.motor_z)
            mjcf.add_box(chassis, centre, (size[0], size[2], size[1]), mass_g / 1000)
        frame_kg = _FRAME_KG + self.robot.chassis.ballast_g / 1000
        mjcf.add_box(chassis, (self.hub[0], 0.0, self.top), (88.0, 48.0, 8.0), frame_kg)
        x, y = self.robot.chassis.caster_mm
        centre = (x / 1000, y / 1000, (_CASTER_RADIUS_MM - self.axle) / 1000)
        mjcf.add_caster(chassis, "caster", centre, _CASTER_RADIUS_MM / 1000, _CASTER_KG)

    def add_wheel(
        self, spec: mujoco.MjSpec, chassis: mujoco.MjsBody, motor: Motor, side: float
    ) -> None:
        """Add a motor's geared output and the wheel on it with backlash; a positive turn of both
        drives forward."""
        rotor = mjcf.add_rotor(
            spec, chassis, motor, (0.0, side * self.half_track / 1000, 0.0), gear=motor.shaft_turns
        )
        mass_kg = _WHEEL_KG * (2 * self.axle / _WHEEL_MM) ** 2
        wheel = mjcf.add_driven(rotor, f"wheel_{motor.port}", motor.port, (0.0, 1.0, 0.0))
        mjcf.add_tyre(
            wheel,
            f"tyre_{motor.port}",
            (self.axle / 1000, _TYRE_WIDTH_MM / 2000, self.axle / 1000),
            mass_kg,
        )
        length = self.half_track - self.motor_y
        mjcf.draw(spec, rotor, [drawings.axle(max(length, 16.0)).at(0, -side * length / 2, 0)])
        mjcf.draw(spec, wheel, [drawings.wheel(2 * self.axle)])

    def parts(self) -> list[Piece]:
        """Drawn parts of the chassis."""
        x, y = self.robot.chassis.caster_mm
        parts = [_hub(self.robot.hub, self.hub_size).at(*self.hub)]
        for motor, side in self.driving.items():
            parts.append(
                _motor(motor.kind, self.motor_size, side).at(0, side * self.motor_y, self.motor_z)
            )
        parts += [
            drawings.beam(13, "turquoise").turned(X_AXIS, 90).at(-12, side * 20, self.top)
            for side in (1, -1)
        ]
        parts += [
            drawings.beam(9, "dark_grey").turned(Z_AXIS, 90).at(ahead, 0, self.top)
            for ahead in (20, -52)
        ]
        height = _CASTER_RADIUS_MM - self.axle
        post = max(self.top - height - 16.0, 8.0)
        parts.append(drawings.ball_caster(_CASTER_RADIUS_MM).at(x, y, height))
        parts.append(piece(dark_grey=box(14, 14, post, radius=1.0).at(x, y, self.top - post / 2)))
        return parts + [self._holder(mount_of(sensor).at_mm) for sensor in self.robot.sensors]

    def _holder(self, at_mm: Triple) -> Piece:
        """Strut from the frame to a sensor."""
        ahead = at_mm[0] - 12.0
        left = at_mm[1]
        up = at_mm[2] - self.axle
        length = max(abs(ahead) - 20.0, 8.0)
        height = max(abs(self.top - up) - 8.0, 8.0)
        sign = 1.0 if ahead >= 0 else -1.0
        bar = box(length, 7.6, 7.6, radius=1.0).at(sign * (20.0 + length / 2), left, self.top)
        post = box(7.6, 7.6, height, radius=1.0).at(ahead, left, (self.top + up) / 2)
        return piece(dark_grey=merge([bar, post]))


def _motor_case(kind: MotorKind) -> tuple[Triple, float]:
    case = case_of(DeviceKind.MOTOR, kind.model.like or kind.model.case or kind.value)
    # - the catalogue has every kind of motor, which a test checks
    assert case is not None  # noqa: S101
    return case


def _hub(kind: AnyHub, size: Triple) -> Piece:
    if kind.value in _DRAWINGS:
        return _DRAWINGS[kind.value]()
    length, width, height = size
    lower = box(length, width, height * 0.6, radius=2.0).at(0, 0, -height * 0.2)
    upper = box(length - 2, width - 2, height * 0.4, radius=2.0).at(0, 0, height * 0.3)
    button = cylinder(6.0, 2.0, bevel=0.6).at(length / 4, 0, height / 2)
    return piece(dark_grey=lower, white=upper, azure=button)


def _motor(kind: MotorKind, size: Triple, side: float) -> Piece:
    """Motor that extends backwards from its shaft, which points to a side; the shaft is the
    origin."""
    draw_motor = _DRAWINGS.get(kind.model.like or kind.value)
    if draw_motor is not None:
        return draw_motor() if side > 0 else draw_motor().turned(X_AXIS, 180)
    length, height, width = size
    case = box(length - 16, width, height, radius=2.2).at(12 - (length - 16) / 2, 0, 0)
    cap = box(16, width - 1, height - 1, radius=2.2).at(12 - length + 8, 0, 0)
    collar = cylinder(10.8, width + 2, bevel=0.6).along(Y_AXIS)
    return piece(white=case, dark_grey=cap, turquoise=collar)
