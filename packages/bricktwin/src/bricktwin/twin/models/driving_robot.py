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
from bricktwin.plans.drawing import pieces
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
"""Mass of a wheel of ``_WHEEL_MM``; other wheels are scaled by area."""
_WHEEL_MM = 56.0
_HUB_X_MM = -16.0
"""Default place of the hub: behind the axle, towards the caster."""
_CLEARANCE_MM = 3.0
"""Least distance of the motors to the floor."""
_UNKNOWN_HUB: tuple[Triple, float] = ((64.0, 40.0, 32.0), 100.0)
"""Size (mm) and mass (g) of a hub that is not in the catalogue."""
_FRAME_MM: Triple = (88.0, 48.0, 8.0)
"""Size of the box that stands for the beams of the frame."""
_DRAWINGS = {"prime": pieces.hub, "spike-medium": pieces.medium_motor}
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

    # What has mass or moves comes first, because MuJoCo numbers joints and actuators in the order
    # of these calls.
    frame.add_masses(chassis)
    x_mm, y_mm, z_mm = frame.hub
    hub_m = (x_mm / 1000, y_mm / 1000, z_mm / 1000)
    add_hub_site(chassis, hub_axes(robot.hub_sides), hub_m)
    for motor, side in frame.driving.items():
        frame.add_wheel(spec, chassis, motor, side)
    for motor in robot.motors:
        if motor not in frame.driving:
            # The description does not say what this motor drives, so it turns without load.
            at_m = (0.0, 0.0, 0.08)
            mjcf.add_rotor(
                spec,
                chassis,
                motor,
                at_m,
                gear=motor.shaft_turns,
            )

    mjcf.add_colours(spec)
    drawn_sensors = [mount_sensor(spec, chassis, sensor, axle_m) for sensor in robot.sensors]
    parts = frame.parts() + drawn_sensors
    mjcf.draw(spec, chassis, parts)
    mjcf.add_light(chassis)
    reach_m = max(0.42, 4.0 * frame.half_track / 1000)
    mjcf.add_camera(
        chassis,
        "chase",
        target=(-0.005, 0.0, 0.01),
        direction=(-0.62, -0.62, 0.55),
        distance_m=reach_m,
    )
    mjcf.add_camera(
        chassis,
        "portrait",
        target=(-0.002, 0.0, 0.008),
        direction=(0.75, -0.52, 0.45),
        distance_m=0.75 * reach_m,
    )
    return spec


class _Frame:
    """Dimensions in mm, with heights relative to the axle, and what is built of them.

    Attributes:
        driving: the driving motors, and their sides: 1 for the left, -1 for the right.
    """

    def __init__(
        self,
        robot: Robot,
        base: DriveBase,
    ) -> None:
        self.robot = robot
        left = robot.motor(base.left)
        right = robot.motor(base.right)
        self.driving = {left: 1.0, right: -1.0}
        self.axle = base.wheel_diameter_mm / 2
        self.half_track = base.axle_track_mm / 2
        self.motor_size, _ = _motor_case(left.kind)
        hub_case = case_of(DeviceKind.HUB, robot.hub.value)
        self.hub_size, self.hub_g = hub_case or _UNKNOWN_HUB

        _, motor_height, motor_width = self.motor_size
        space = self.half_track - _TYRE_WIDTH_MM / 2
        if self.axle < _CASTER_RADIUS_MM or space < motor_width / 2:
            raise TwinError(
                f"robot '{robot.name}': wheels of {base.wheel_diameter_mm:g} mm, "
                f"{base.axle_track_mm:g} mm apart, leave no room "
                f"for its motors; give wheels of {2 * _CASTER_RADIUS_MM:g} mm or more and a wider "
                "axle track"
            )
        # The motors are at the height of the axle, or higher where small wheels would let them
        # touch the floor.
        half_height = motor_height / 2
        half_width = motor_width / 2
        self.motor_z = max(0.0, half_height + _CLEARANCE_MM - self.axle)
        # Each motor is beside its wheel, without overlapping the other motor.
        self.motor_y = max(half_width, space - 8.0 - half_width)

        # The frame of beams lies on the motors, and the hub on the frame.
        motor_top = self.motor_z + half_height
        self.top = motor_top + 4.0
        hub_x, hub_y = robot.chassis.hub_mm or (_HUB_X_MM, 0.0)
        hub_height = self.hub_size[2]
        hub_z = motor_top + 8.0 + hub_height / 2
        self.hub = (hub_x, hub_y, hub_z)

    def add_masses(self, chassis: mujoco.MjsBody) -> None:
        """Add the masses of hub, motors, frame, ballast and caster."""
        hub_x, _, hub_z = self.hub
        mjcf.add_box(
            chassis,
            self.hub,
            self.hub_size,
            self.hub_g / 1000,
        )
        for motor in self.robot.motors:
            size, mass_g = _motor_case(motor.kind)
            length, height, width = size
            if motor in self.driving:
                # The wheels are at the origin, so the case is moved back to have its shaft there,
                # 12 mm behind its front.
                middle_x = 12.0 - length / 2
                middle_y = self.driving[motor] * self.motor_y
                centre = (middle_x, middle_y, self.motor_z)
            else:
                # Where other motors sit is unknown. They are drawn above the hub, where an arm
                # would be.
                centre = (hub_x, 0.0, hub_z + 30.0)
            mjcf.add_box(
                chassis,
                centre,
                (length, width, height),
                mass_g / 1000,
            )
        frame_kg = _FRAME_KG + self.robot.chassis.ballast_g / 1000
        mjcf.add_box(
            chassis,
            (self.hub[0], 0.0, self.top),
            _FRAME_MM,
            frame_kg,
        )
        x, y = self.robot.chassis.caster_mm
        height_mm = _CASTER_RADIUS_MM - self.axle
        centre_m = (x / 1000, y / 1000, height_mm / 1000)
        mjcf.add_caster(
            chassis,
            "caster",
            centre_m,
            _CASTER_RADIUS_MM / 1000,
            _CASTER_KG,
        )

    def add_wheel(
        self,
        spec: mujoco.MjSpec,
        chassis: mujoco.MjsBody,
        motor: Motor,
        side: float,
    ) -> None:
        """Add a motor's geared output and the wheel on it with backlash; a positive turn of both
        drives forward."""
        hub_m = (0.0, side * self.half_track / 1000, 0.0)
        rotor = mjcf.add_rotor(
            spec,
            chassis,
            motor,
            hub_m,
            gear=motor.shaft_turns,
        )
        wheel = mjcf.add_driven(
            rotor,
            f"wheel_{motor.port}",
            motor.port,
            (0.0, 1.0, 0.0),
        )
        radius_m = self.axle / 1000
        diameter_ratio = 2 * self.axle / _WHEEL_MM
        mjcf.add_tyre(
            wheel,
            f"tyre_{motor.port}",
            size_m=(radius_m, _TYRE_WIDTH_MM / 2000, radius_m),
            mass_kg=_WHEEL_KG * diameter_ratio**2,
        )

        # The axle turns with the rotor and the tyre with the wheel, so that backlash can be seen.
        length = self.half_track - self.motor_y
        axle = pieces.axle(max(length, 16.0))
        axle = axle.at(0, -side * length / 2, 0)
        tyre = pieces.wheel(2 * self.axle)
        mjcf.draw(spec, rotor, [axle])
        mjcf.draw(spec, wheel, [tyre])

    def parts(self) -> list[Piece]:
        """Drawn parts of the chassis."""
        hub = _hub(self.robot.hub, self.hub_size)
        parts = [hub.at(*self.hub)]
        for motor, side in self.driving.items():
            drawn = _motor(motor.kind, self.motor_size, side)
            parts.append(drawn.at(0, side * self.motor_y, self.motor_z))
        for side in (1, -1):
            along = pieces.beam(13, "turquoise").turned(X_AXIS, 90)
            parts.append(along.at(-12, side * 20, self.top))
        for ahead in (20, -52):
            across = pieces.beam(9, "dark_grey").turned(Z_AXIS, 90)
            parts.append(across.at(ahead, 0, self.top))
        # The post is drawn even where the frame is lower than the caster.
        x, y = self.robot.chassis.caster_mm
        height = _CASTER_RADIUS_MM - self.axle
        length = max(self.top - height - 16.0, 8.0)
        ball = pieces.ball_caster(_CASTER_RADIUS_MM)
        post = box(14, 14, length, radius=1.0)
        post = post.at(x, y, self.top - length / 2)
        parts.append(ball.at(x, y, height))
        parts.append(piece(dark_grey=post))
        for sensor in self.robot.sensors:
            mount = mount_of(sensor)
            parts.append(self._holder(mount.at_mm))
        return parts

    def _holder(self, at_mm: Triple) -> Piece:
        """Strut from the frame to a sensor."""
        ahead = at_mm[0] - 12.0
        left = at_mm[1]
        # Mounts are given from the floor, but the heights of the frame from the axle.
        up = at_mm[2] - self.axle
        length = max(abs(ahead) - 20.0, 8.0)
        height = max(abs(self.top - up) - 8.0, 8.0)
        sign = 1.0 if ahead >= 0 else -1.0
        middle = sign * (20.0 + length / 2)
        bar = box(length, 7.6, 7.6, radius=1.0)
        bar = bar.at(middle, left, self.top)
        post = box(7.6, 7.6, height, radius=1.0)
        post = post.at(ahead, left, (self.top + up) / 2)
        return piece(dark_grey=merge([bar, post]))


def _motor_case(kind: MotorKind) -> tuple[Triple, float]:
    """Size (mm) and mass (g) of a motor; one without a part of its own has those of a similar
    one."""
    name = kind.model.like or kind.model.case or kind.value
    case = case_of(DeviceKind.MOTOR, name)
    # A test checks that the catalogue has every kind of motor.
    assert case is not None  # noqa: S101
    return case


def _hub(kind: AnyHub, size: Triple) -> Piece:
    """Hub around the origin."""
    if kind.value in _DRAWINGS:
        return _DRAWINGS[kind.value]()
    length, width, height = size
    lower = box(length, width, height * 0.6, radius=2.0)
    upper = box(
        length - 2,
        width - 2,
        height * 0.4,
        radius=2.0,
    )
    button = cylinder(6.0, 2.0, bevel=0.6)
    return piece(
        dark_grey=lower.at(0, 0, -height * 0.2),
        white=upper.at(0, 0, height * 0.3),
        azure=button.at(length / 4, 0, height / 2),
    )


def _motor(
    kind: MotorKind,
    size: Triple,
    side: float,
) -> Piece:
    """Motor that extends backwards from its shaft, which points to a side; the shaft is the
    origin."""
    draw_motor = _DRAWINGS.get(kind.model.like or kind.value)
    if draw_motor is not None:
        # Our drawings have the shaft on the left side, so the right motor is turned.
        motor = draw_motor()
        return motor if side > 0 else motor.turned(X_AXIS, 180)
    length, height, width = size
    case_length = length - 16
    case = box(case_length, width, height, radius=2.2)
    cap = box(16, width - 1, height - 1, radius=2.2)
    collar = cylinder(10.8, width + 2, bevel=0.6)
    return piece(
        white=case.at(12 - case_length / 2, 0, 0),
        dark_grey=cap.at(12 - length + 8, 0, 0),
        turquoise=collar.along(Y_AXIS),
    )
