"""Models from building plans: bodies, joints, gears, rods, wheels, feet, sensors and looks, derived from the parts' positions.

All bodies have the plan's axes (x forward, y left, z up) in the plan's configuration. The origin of the first body, where the
robot's pose is measured, is below the middle of the hub, or on the axle of the driven wheels if there are any; that of a robot
that stands on the table is the plan's.
"""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import Motor, Robot
from bricktwin.plans.geometry import MM_PER_LDU, Floats
from bricktwin.plans.mechanism.articulation import Articulation, Drive, Joint
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.planned_robot import PlannedRobot, free_deg, planned_robot
from bricktwin.robots.planned import check_description
from bricktwin.twin.models import lego
from bricktwin.twin.models.mjcf import (
    add_ball,
    add_camera,
    add_driven,
    add_light,
    add_rotor,
    add_surroundings,
    add_webcam,
    new_spec,
)
from bricktwin.twin.models.mounts import add_hub_site, add_sensor_site, mount_sensor
from bricktwin.twin.models.planned_looks import cables_of, draw_spinners, looks_of
from bricktwin.twin.models.planned_shapes import add_shapes, lowest_m
from bricktwin.twin.models.turning import add_rod
from bricktwin.twin.scene import Scene

_HINGE, _BALL = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL
_ROTOR_KG, _ROTOR_KG_M2 = 1e-4, 1e-8
"""Mass and inertia of the body between a motor's joint and its backlash; the rotor's inertia is the joint's armature."""
_TRAIN_FRICTION_NM = 0.033
"""Dry friction of a gear train at the motor's side; an estimate: arms hold themselves while their motors coast."""
_HEAVY_KG = 0.030
"""Mass above which a body has more damping in its backlash."""
_BEYOND_DEG = 15.0
"""Angle beyond a motor's range, at its shaft, up to which end stops are searched for."""


def from_plan(path: Path, robot: Robot, scene: Scene) -> mujoco.MjSpec:
    """Model of the robot in its plan, in its scene.

    Raises:
        PlanError: the plan cannot be read, or has an unsupported element.
        DescriptionError: the plan contradicts the description.
        TwinError: the scene does not suit this robot, or the plan has an element that cannot be modelled.
    """
    check_description(robot, path)
    planned = planned_robot(path)
    if planned.articulation.is_fixed and (scene.wall_distance_mm is not None or scene.heading_deg != (0.0, 0.0)):
        raise TwinError(f"robot '{robot.name}' stands still and sees no wall; omit wall_distance_mm and heading_deg")
    spec = new_spec(robot.name)
    add_surroundings(spec, scene)
    _Builder(spec, robot, planned, holds_ball=scene.ball).build()
    # All constraints share one body: searching for independent islands would take a tenth of the time in vain.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    if planned.articulation.rods or planned.articulation.loops:
        # Legs interact through the chassis only: the matrices are sparse.
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    return spec


class _Builder:
    """Builder of a model."""

    def __init__(self, spec: mujoco.MjSpec, robot: Robot, planned: PlannedRobot, *, holds_ball: bool) -> None:
        self.spec, self.robot, self.planned, self.holds_ball = spec, robot, planned, holds_ball
        self.articulation: Articulation = planned.articulation
        self.motors = {motor.port: motor for motor in robot.motors}
        self.mounted = {device.port: device for device in reversed(self.articulation.mounted)}
        """The hub, whose port is ``None``, and the sensors."""
        if None not in self.mounted:
            raise TwinError(f"{planned.plan.path} has no hub that is connected to the robot; add one")
        self.hub = self.mounted[None]
        for port in sorted(self.motors.keys() - {drive.port for drive in self.articulation.drives}):
            placed = planned.device(port)
            fault = f"{placed.name} is not connected to the main body; add a pin or an axle, or remove it"
            raise TwinError(f"{planned.plan.path}, line {placed.line}: {fault}")
        self.bodies: dict[int, mujoco.MjsBody] = {}
        self.origins: dict[int, Floats] = {0: self._origin()}
        self.subtree_kg = self._subtree_kg()
        self.ports = self._ports()
        self.mounted_parts: list[lego.Piece] = []
        """Drawn parts of the first body that are not in the plan."""

    def build(self) -> None:
        """Build everything except the surroundings."""
        self._add_base()
        driven = {drive.joint.child: drive for drive in self.articulation.drives if drive.port in self.motors}
        for joint in self.articulation.joints:
            if joint.child in driven:
                self._add_drive(driven[joint.child])
            else:
                self._add_passive(joint)
        self._couple()
        for number, rod in enumerate(self.articulation.rods):
            near = (self.bodies[rod.near], self._local(rod.near, rod.near_m))
            far = (self.bodies[rod.far], self._local(rod.far, rod.far_m))
            name = self.ports.get(rod.far) or self.ports.get(rod.near) or str(number)
            body = add_rod(self.spec, name, near, far)
            axes = _axes_along(rod.far_m - rod.near_m)
            lego.draw(self.spec, body, [looks_of(self.planned.plan, rod.parts, rod.near_m, axes=axes)])
        self._close_loops()
        add_shapes(self.spec, self.planned, self.bodies, self.origins, self.ports)
        lego.add_colours(self.spec)
        self._add_sensors()
        if self.holds_ball:
            self._add_ball()
        self._draw()

    def _origin(self) -> Floats:
        """Origin of the first body, in the plan's frame."""
        if self.articulation.is_fixed:
            return np.zeros(3)
        axle_m = [wheel.centre_m for _, wheel in self.planned.rolling] or [self.hub.point_m * (1.0, 1.0, 0.0)]
        x, _, z = np.mean(axle_m, axis=0)
        return np.round([x, self.hub.point_m[1], z], 6)

    def _subtree_kg(self) -> dict[int, float]:
        """Mass of each body with all its descendants, kg."""
        mass = {number: body.mass_kg for number, body in enumerate(self.articulation.bodies)}
        for joint in reversed(self.articulation.joints):
            mass[joint.parent] += mass[joint.child]
        return mass

    def _ports(self) -> dict[int, str]:
        """Port of the motor that moves each body."""
        ports = {drive.joint.child: drive.port for drive in self.articulation.drives}
        ports |= {geared.joint.child: geared.port for geared in self.articulation.geared}
        for joint in sorted(self.articulation.swings, key=lambda joint: joint.child):
            if joint.parent in ports:
                ports[joint.child] = ports[joint.parent]
        return ports

    def _local(self, body: int, point_m: Floats) -> tuple[float, float, float]:
        """A position in a body's frame."""
        x, y, z = (point_m - self.origins[body]).tolist()
        return x, y, z

    def _set_inertia(self, body: mujoco.MjsBody, number: int) -> None:
        """Set mass and inertia of a body."""
        link = self.articulation.bodies[number]
        xx, yy, zz = np.diag(link.inertia)
        body.explicitinertial, body.mass = True, link.mass_kg
        body.ipos = self._local(number, link.centre_m)
        body.fullinertia = [xx, yy, zz, link.inertia[0, 1], link.inertia[0, 2], link.inertia[1, 2]]

    def _add_base(self) -> None:
        """Add the root body: free, or fixed to the floor."""
        height = float(self.origins[0][2]) - lowest_m(self.planned)
        body = self.spec.worldbody.add_body(name="base" if self.articulation.is_fixed else "chassis", pos=[0.0, 0.0, height])
        if not self.articulation.is_fixed:
            body.add_freejoint(name="root")
        self.bodies[0] = body
        self._set_inertia(body, 0)

    def _add_drive(self, drive: Drive) -> None:
        """Add what a motor drives: a body on the geared shaft and, with backlash, the driven body on it."""
        joint, port = drive.joint, drive.port
        motor, start = self.motors[port], self._start_deg(self.motors[port])
        angle = math.radians(start - self.planned.device(port).angle_deg) / drive.gear
        friction = _TRAIN_FRICTION_NM * abs(drive.gear) if drive.teeth else 0.0
        x, y, z = joint.axis.tolist()
        at_m = self._local(joint.parent, joint.point_m)
        rotor = add_rotor(self.spec, self.bodies[joint.parent], motor, at_m, (x, y, z), drive.gear, friction)
        rotor.quat, rotor.mass, rotor.inertia = _quaternion(joint.axis, angle), _ROTOR_KG, [_ROTOR_KG_M2] * 3
        is_heavy = self.subtree_kg[joint.child] > _HEAVY_KG
        shaft = rotor.joints[0]
        shaft.damping[0], shaft.ref = 1e-3 if is_heavy else 0.0, math.radians(start) / drive.gear
        shaft.armature += drive.armature
        self._limit(shaft, motor, drive.gear)
        body = add_driven(rotor, f"driven_{port}", port, (x, y, z), is_heavy=is_heavy)
        self._register(joint, body)

    def _add_passive(self, joint: Joint) -> None:
        """Add a body that turns freely on a pin, an axle or a ball, or that is driven by a motor missing in the description."""
        body = self.bodies[joint.parent].add_body(name=f"part_{joint.child}", pos=self._local(joint.parent, joint.point_m))
        kind = _BALL if joint.is_ball else _HINGE
        body.add_joint(name=f"turn_{joint.child}", type=kind, axis=joint.axis.tolist(), damping=2e-4, armature=1e-6)
        self._register(joint, body)

    def _register(self, joint: Joint, body: mujoco.MjsBody) -> None:
        self.bodies[joint.child], self.origins[joint.child] = body, joint.point_m
        self._set_inertia(body, joint.child)

    def _start_deg(self, motor: Motor) -> float:
        """Angle of a motor's shaft at start: the middle of its range, or as in the plan without a range or with linkages."""
        ends = _range_of_shaft(motor)
        if ends is None or self.articulation.rods or self.articulation.loops:
            return self.planned.device(motor.port).angle_deg
        return sum(ends) / 2

    def _limit(self, shaft: mujoco.MjsJoint, motor: Motor, gear: float) -> None:
        """Set the end stops of a motor with a range: where parts of the robot collide, or a little beyond the range."""
        ends = _range_of_shaft(motor)
        if ends is not None:
            shaft.limited = True
            lowest, highest = ends[0] - _BEYOND_DEG, ends[1] + _BEYOND_DEG
            low, high = free_deg(self.planned, motor.port, lowest, highest)  # wider if the plan's position is outside
            shaft.range = sorted(math.radians(angle) / gear for angle in (max(low, lowest), min(high, highest)))

    def _couple(self) -> None:
        """Couple bodies that are geared to a motor's joint."""
        for geared in self.articulation.geared:
            if geared.port not in self.motors:
                continue
            joint, port = geared.joint, geared.port
            equal = self.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
            equal.name, equal.name1, equal.name2 = f"geared_{joint.child}", f"turn_{joint.child}", f"motor_{port}"
            equal.data[:5] = [0.0, geared.ratio, 0.0, 0.0, 0.0]
            # Its start angle relative to the plan follows from the motor's.
            drive = next(drive for drive in self.articulation.drives if drive.port == port)
            start = self._start_deg(self.motors[port]) - self.planned.device(port).angle_deg
            self.bodies[joint.child].quat = _quaternion(joint.axis, geared.ratio * math.radians(start) / drive.gear)

    def _close_loops(self) -> None:
        """Close kinematic loops: connect bodies at pins that are not tree joints."""
        for number, loop in enumerate(self.articulation.loops):
            equal = self.spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
            equal.name, equal.name1, equal.name2 = f"loop_{number}", self.bodies[loop.parent].name, self.bodies[loop.child].name
            equal.data[:3] = self._local(loop.parent, loop.point_m)
            equal.solref = [2 * self.spec.option.timestep, 1.0]

    def _add_sensors(self) -> None:
        """Add the sites of hub and sensors; sensors that are not in the plan are mounted on the first body."""
        hub = self.hub
        if self.robot.needs_imu and hub.link != 0 and not self.articulation.is_fixed:
            raise TwinError(f"{self.planned.plan.path}: the hub moves against the chassis; fix it there, or say needs_imu=False")
        axes = TO_TWIN @ self.planned.plan.parts[hub.part].rotation @ TO_TWIN.T
        add_hub_site(self.bodies[hub.link], axes, self._local(hub.link, hub.point_m))
        base = self.bodies[0]
        for sensor in self.robot.sensors:
            device = self.mounted.get(sensor.port)
            if device is None and sensor.mount is None and self.robot.drive_base is None:
                raise TwinError(
                    f"there is no place for '{sensor.name}' in {self.planned.plan.path}; add it there or give a mount"
                )
            if device is None:
                self.mounted_parts.append(mount_sensor(self.spec, base, sensor, float(base.pos[2])))
                continue
            if device.link != 0:
                raise TwinError(f"{self.planned.plan.path}: '{device.name}' moves against the chassis; put it on the chassis")
            add_sensor_site(self.spec, base, sensor, np.array(self._local(0, device.point_m)), _facing(device.looks))

    def _add_ball(self) -> None:
        """Add the ball at the place that the plan names."""
        holder = next((placed for placed in self.planned.plan.parts if placed.ball is not None), None)
        if holder is None or holder.ball is None:
            return
        number = next(number for number, body in enumerate(self.articulation.bodies) if holder.index in body.parts)
        centre_m = TO_TWIN @ holder.to_plan(np.array([holder.ball]))[0] * MM_PER_LDU / 1000
        add_ball(self.bodies[number], self._local(number, centre_m))

    def _draw(self) -> None:
        plan = self.planned.plan
        drawn_apart = {part for follower in self.articulation.followers for part in follower.parts}
        drawn_apart |= {part for rod in self.articulation.rods for part in rod.parts}
        for number, body in self.bodies.items():
            parts = tuple(part for part in self.articulation.bodies[number].parts if part not in drawn_apart)
            ports = [drive.port for drive in self.articulation.drives if drive.joint.child == number and not drive.teeth]
            shafts = tuple(self.planned.device(port).index for port in ports)
            cables = cables_of(plan, parts, self.origins[number])
            mounted = self.mounted_parts if number == 0 else []
            lego.draw(self.spec, body, [looks_of(plan, parts, self.origins[number], shafts=shafts), *cables, *mounted])
        draw_spinners(self.spec, self.planned, self.bodies, self.origins)
        corners = np.concatenate([np.stack(placed.part.bounds) @ placed.rotation.T + placed.position for placed in plan.parts])
        size_m = float(np.linalg.norm(np.ptp(corners, axis=0))) * MM_PER_LDU / 1000
        base = self.bodies[0]
        middle = tuple((self.articulation.bodies[0].centre_m - self.origins[0]).tolist())
        parent = self.spec.worldbody if self.articulation.is_fixed else base
        target = (middle[0], middle[1], 0.4 * size_m) if self.articulation.is_fixed else middle
        add_light(parent)
        add_camera(parent, "chase", target, (-0.62, -0.62, 0.55), 1.6 * size_m)
        add_camera(parent, "portrait", target, (0.75, -0.55, 0.42), 1.55 * size_m)
        if self.articulation.is_fixed:
            add_webcam(parent)


def _range_of_shaft(motor: Motor) -> tuple[float, float] | None:
    """Lowest and highest angle of a motor's shaft; ``None`` if it is unlimited."""
    if motor.range_deg is None:
        return None
    first, second = sorted(angle * motor.shaft_turns for angle in motor.range_deg)
    return first, second


def _quaternion(axis: Floats, angle: float) -> list[float]:
    """Quaternion of a rotation about an axis."""
    return [math.cos(angle / 2), *(math.sin(angle / 2) * axis).tolist()]


def _facing(looks: Floats) -> list[float]:
    """Quaternion of the shortest rotation of x to a direction."""
    quaternion = np.array([1.0 + looks[0], 0.0, -looks[2], looks[1]])
    if quaternion[0] < 1e-6:
        return [0.0, 0.0, 0.0, 1.0]
    return [float(value) for value in quaternion / np.linalg.norm(quaternion)]


def _axes_along(direction: Floats) -> Floats:
    """Axes, as rows [3, 3], of the frame in which MuJoCo's shortest rotation takes z to a direction."""
    quaternion, matrix = np.empty(4), np.empty(9)
    mujoco.mju_quatZ2Vec(quaternion, direction)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3).T
