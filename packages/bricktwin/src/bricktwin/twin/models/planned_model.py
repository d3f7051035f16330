"""Models from building plans: bodies, joints, gears, rods, shapes that collide, sensors and looks,
from the parts' positions.

All bodies have the plan's axes (x forward, y left, z up) in the plan's configuration. The origin of
the first body, where the robot's pose is measured, is below the middle of the hub, or on the axle
of the driven wheels if there are any; that of a robot that stands on the table is the plan's.
Tyres, casters and feet touch the floor, and the convex hulls of the other bodies.
"""

import math
from pathlib import Path

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import Motor, Robot, Sensor
from bricktwin.plans.drawing.pieces import Piece
from bricktwin.plans.drawing.planned_looks import cables_of, looks_of
from bricktwin.plans.geometry import M_PER_LDU, MM_PER_LDU, Floats, Form
from bricktwin.plans.mechanism.articulation import Articulation, Drive
from bricktwin.plans.mechanism.kinematics import TO_TWIN, Hinge, Wheel, point_m_of
from bricktwin.plans.mechanism.open_gears import turns_with
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed
from bricktwin.plans.planned_robot import PlannedRobot, free_deg, planned_robot, stops_deg
from bricktwin.robots.planned import check_description
from bricktwin.twin.engines.conventions import FOOT
from bricktwin.twin.models import mjcf
from bricktwin.twin.models.balance import standing_shapes
from bricktwin.twin.models.feet import Shape
from bricktwin.twin.models.mounts import add_hub_site, add_sensor_site, mount_sensor
from bricktwin.twin.models.turning import (
    FIRM,
    add_coupling,
    add_gears,
    add_loop,
    add_rod,
    add_spinner,
)
from bricktwin.twin.scene import Scene

_ROTOR_KG = 1e-4
"""Mass of the body between a motor's joint and its backlash: MuJoCo needs a mass for each."""
_ROTOR_KG_M2 = 1e-8
"""Inertia of that body; the rotor's own is the joint's armature."""
_GEAR_KG_M2 = 1e-5
"""Inertia of an open gear. It is more than a gear of LEGO has, as a constraint on less is soft, and
a tenth of a motor's."""
_TRAIN_FRICTION_NM = 0.033
"""Dry friction of a gear train at the motor's side; an estimate: arms hold themselves while their
motors coast."""
_HEAVY_KG = 0.030
"""Mass above which a body has more damping in its backlash."""
_BEYOND_DEG = 15.0
"""Angle beyond a motor's range, at its shaft, up to which end stops are searched for."""
_PLASTIC_FRICTION = 0.8
"""Sliding friction of plastic on a smooth floor; an estimate."""
_GEOMS = {
    Form.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    Form.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Form.BALL: mujoco.mjtGeom.mjGEOM_SPHERE,
}
"""Shapes of feet."""
_SAME_WHEEL_M = 0.008
"""Largest distance of a rim from the tyre around it: a module of LEGO."""
_LEAST_HULL_M = 0.001
"""Least thickness of a convex hull."""
_CORNER_M = 0.002
"""Corners closer than this make no difference in a collision."""
_CARRIED = (DeviceKind.HUB, DeviceKind.SENSOR)


def from_plan(
    path: Path,
    robot: Robot,
    scene: Scene,
) -> mujoco.MjSpec:
    """Model of the robot in its plan, in its scene.

    Raises:
        PlanError: the plan cannot be read, or has an unsupported element.
        DescriptionError: the plan contradicts the description.
        TwinError: the scene does not suit this robot, or the plan has an element that cannot be
            modelled.
    """
    check_description(robot, path)
    planned = planned_robot(path)
    is_placed = scene.wall_distance_mm is not None or scene.heading_deg != (0.0, 0.0)
    if planned.articulation.is_fixed and is_placed:
        raise TwinError(
            f"robot '{robot.name}' stands still and sees no wall; omit wall_distance_mm and "
            "heading_deg"
        )
    spec = mjcf.new_spec(robot.name, scene)
    _Builder(
        spec,
        robot,
        planned,
        holds_ball=scene.ball,
    ).build()
    # All constraints share one body, so searching for independent islands would only cost a tenth
    # of the time.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    if planned.articulation.rods or planned.articulation.loops:
        # Legs interact only through the chassis, which leaves the matrices sparse.
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    return spec


class _Builder:
    """Builder of a model."""

    def __init__(
        self,
        spec: mujoco.MjSpec,
        robot: Robot,
        planned: PlannedRobot,
        *,
        holds_ball: bool,
    ) -> None:
        self.spec = spec
        self.robot = robot
        self.planned = planned
        self.holds_ball = holds_ball
        self.articulation: Articulation = planned.articulation
        self.motors = {motor.port: motor for motor in robot.motors}
        self.mounted: dict[str | None, tuple[Placed, int]] = {}
        """Each sensor and its body, by port, and the hub, whose port is ``None``."""
        # The order is reversed, so that of two devices at one port the first one stays.
        for placed in reversed(list(planned.plan.devices(*_CARRIED))):
            body = self.articulation.body_of(placed.index)
            if body is not None:
                self.mounted[placed.port] = (placed, body)
        if None not in self.mounted:
            raise TwinError(
                f"{planned.plan.path} has no hub that is connected to the robot; add one"
            )
        self.hub, self.hub_body = self.mounted[None]
        plug = self.hub.electric.plug
        self.hub_m = point_m_of(self.hub.point(plug))
        driving_ports = {drive.port for drive in self.articulation.drives}
        for port in sorted(self.motors.keys() - driving_ports):
            placed = planned.device(port)
            fault = (
                f"{placed.name} is not connected to the main body; add a pin or an axle, or "
                "remove it"
            )
            # What a part holds that the catalogue lacks, nobody knows, so it may be the reason.
            for unknown in planned.plan.unknown[:1]:
                fault += (
                    f"; or replace {unknown.number} (line {unknown.lines[0]}), which may hold it "
                    "and is not in the catalogue"
                )
            raise TwinError(f"{planned.plan.path}, line {placed.line}: {fault}")
        self.bodies: dict[int, mujoco.MjsBody] = {}
        self.origins: dict[int, Floats] = {0: self._origin()}
        self.turning: dict[int, list[mujoco.MjsJoint]] = {}
        """Joints about one axis that turn each body."""
        self.casters = _casters(planned)
        self.feet = standing_shapes(planned)
        self.tyres = self._tyres()
        self.subtree_kg = self._subtree_kg()
        self.ports = self._ports()
        self.mounted_parts: list[Piece] = []
        """Drawn parts of the first body that are not in the plan."""

    def build(self) -> None:
        """Build everything except the surroundings."""
        # The joints are ordered with parents before their children, as bodies are added.
        self._add_base()
        driven: dict[int, Drive] = {}
        for drive in self.articulation.drives:
            if drive.port in self.motors:
                driven[drive.joint.child] = drive
        for joint in self.articulation.joints:
            if joint.child in driven:
                self._add_drive(driven[joint.child])
            else:
                self._add_passive(joint)
        # Couplings, rods and loops hold between bodies, so all bodies come before them.
        self._couple()
        self._add_open_gears()
        self._add_rods()
        for number, loop in enumerate(self.articulation.loops):
            add_loop(
                self.spec,
                f"loop_{number}",
                self.bodies[loop.parent],
                self.bodies[loop.child],
                self._local(loop.parent, loop.point_m),
            )
        # A fixed robot's joints have ranges within which nothing collides, so it needs no shapes.
        if not self.articulation.is_fixed:
            self._add_shapes()
        mjcf.add_colours(self.spec)
        self._add_sensors()
        if self.holds_ball:
            self._add_ball()
        self._draw()

    def _origin(self) -> Floats:
        """Origin of the first body, in the plan's frame."""
        if self.articulation.is_fixed:
            return np.zeros(3)
        axle_m = [wheel.centre_m for _, wheel in self.planned.rolling]
        if not axle_m:
            below_hub_m = self.hub_m * (1.0, 1.0, 0.0)
            axle_m = [below_hub_m]
        x, _, z = np.mean(axle_m, axis=0)
        return np.round([x, self.hub_m[1], z], 6)

    def _tyres(self) -> list[Wheel]:
        """Wheels that roll on the floor: the largest of those at one position, without casters."""
        casters = {wheel.part for wheel, _, _ in self.casters}
        tyres: list[Wheel] = []
        # The largest wheels come first, so that a rim is found inside the tyre around it.
        by_size = sorted(self.articulation.wheels, key=lambda wheel: -wheel.diameter_mm)
        for wheel in by_size:
            is_inner = any(_is_around(tyre, wheel) for tyre in tyres)
            if not is_inner and wheel.part not in casters:
                tyres.append(wheel)
        return tyres

    def _lowest_m(self) -> float:
        """Height of the robot's lowest point in the plan."""
        lowest_m: list[float] = []
        for wheel in self.tyres:
            radius_m = wheel.diameter_mm / 2000
            lowest_m.append(float(wheel.centre_m[2]) - radius_m)
        lowest_m.extend(foot.lowest_m for foot in self.feet)
        for _, centre_m, radius_m in self.casters:
            lowest_m.append(float(centre_m[2]) - radius_m)
        if self.articulation.is_fixed or not lowest_m:
            # A robot without wheels, feet or casters stands on whatever part is lowest.
            for body in self.articulation.bodies:
                for part in body.parts:
                    placed = self.planned.plan.parts[part]
                    corners_m = _in_twin(placed, placed.part.corners)  # [n, 3]
                    lowest_m.append(float(corners_m[:, 2].min()))
        return min(lowest_m)

    def _subtree_kg(self) -> dict[int, float]:
        """Mass of each body with all its descendants, kg."""
        mass: dict[int, float] = {}
        for number, body in enumerate(self.articulation.bodies):
            mass[number] = body.mass_kg
        # The sum goes from the leaves to the root, so that a child has its whole mass before its
        # parent counts it.
        for joint in reversed(self.articulation.joints):
            mass[joint.parent] += mass[joint.child]
        return mass

    def _ports(self) -> dict[int, str]:
        """Port of the motor that moves each body."""
        ports: dict[int, str] = {}
        for drive in self.articulation.drives:
            ports[drive.joint.child] = drive.port
        for geared in self.articulation.geared:
            ports[geared.joint.child] = geared.port
        # What swings on a driven body is named after its motor too. Sorting reaches the bodies
        # nearest to the motor first.
        for joint in sorted(self.articulation.swings, key=lambda joint: joint.child):
            if joint.parent in ports:
                ports[joint.child] = ports[joint.parent]
        return ports

    def _local(
        self,
        body: int,
        point_m: Floats,
    ) -> tuple[float, float, float]:
        """A position in a body's frame."""
        x, y, z = (point_m - self.origins[body]).tolist()
        return x, y, z

    def _set_inertia(
        self,
        body: mujoco.MjsBody,
        number: int,
    ) -> None:
        """Set mass and inertia of a body."""
        link = self.articulation.bodies[number]
        inertia = link.inertia
        body.explicitinertial = True
        body.mass = link.mass_kg
        body.ipos = self._local(number, link.centre_m)
        # MuJoCo orders an inertia as its diagonal, then xy, xz and yz.
        xx, yy, zz = np.diag(inertia)
        xy = inertia[0, 1]
        xz = inertia[0, 2]
        yz = inertia[1, 2]
        body.fullinertia = [xx, yy, zz, xy, xz, yz]

    def _add_base(self) -> None:
        """Add the root body: free, or fixed to the floor."""
        origin_m = self.origins[0]
        height_m = float(origin_m[2]) - self._lowest_m()
        name = "base" if self.articulation.is_fixed else "chassis"
        body = self.spec.worldbody.add_body(name=name, pos=[0.0, 0.0, height_m])
        if not self.articulation.is_fixed:
            body.add_freejoint(name="root")
        self.bodies[0] = body
        self._set_inertia(body, 0)

    def _add_drive(self, drive: Drive) -> None:
        """Add the bodies that a motor drives: one on the geared shaft and, with backlash, the
        driven one on that."""
        joint = drive.joint
        port = drive.port
        motor = self.motors[port]
        x, y, z = joint.axis.tolist()
        rotor = mjcf.add_rotor(
            self.spec,
            self.bodies[joint.parent],
            motor,
            at_m=self._local(joint.parent, joint.point_m),
            axis=(x, y, z),
            gear=drive.gear,
            train_friction_nm=self._train_friction_nm(drive),
        )
        # The plan's configuration is at the plan's angle, while the joint counts as the motor does.
        start_deg = self._start_deg(motor)
        turned_deg = start_deg - self.planned.device(port).angle_deg
        angle = math.radians(turned_deg) / drive.gear
        rotor.quat = mjcf.quaternion(joint.axis, angle)
        rotor.mass = _ROTOR_KG
        rotor.inertia = [_ROTOR_KG_M2] * 3
        is_heavy = self.subtree_kg[joint.child] > _HEAVY_KG
        shaft = rotor.joints[0]
        shaft.damping[0] = 1e-3 if is_heavy else 0.0
        shaft.ref = math.radians(start_deg) / drive.gear
        shaft.armature += drive.armature
        self._limit(shaft, motor, drive.gear)
        body = mjcf.add_driven(
            rotor,
            f"driven_{port}",
            port,
            (x, y, z),
            is_heavy=is_heavy,
        )
        # The backlash turns what is driven, too.
        self.turning[joint.child] = [shaft, *body.joints]
        self._register(joint, body)

    def _train_friction_nm(self, drive: Drive) -> float:
        """Dry friction of a motor's gear train at its joint; motors on one train share it."""
        if drive.teeth:
            return _TRAIN_FRICTION_NM * abs(drive.gear)
        turned = turns_with(self.articulation.couplings, drive.joint.child)
        others = [other for other in self.articulation.drives if other.joint.child in turned]
        return _TRAIN_FRICTION_NM / (1 + len(others)) if turned else 0.0

    def _add_passive(self, joint: Hinge) -> None:
        """Add a body that turns freely on a pin, an axle or a ball, or that is driven by a motor
        missing in the description."""
        body = self.bodies[joint.parent].add_body(
            name=f"part_{joint.child}",
            pos=self._local(joint.parent, joint.point_m),
        )
        kind = mujoco.mjtJoint.mjJNT_HINGE
        if joint.is_ball:
            kind = mujoco.mjtJoint.mjJNT_BALL
        turn = body.add_joint(
            name=f"turn_{joint.child}",
            type=kind,
            axis=joint.axis.tolist(),
            damping=2e-4,
            armature=1e-6,
        )
        self.turning[joint.child] = [turn]
        self._register(joint, body)

    def _register(
        self,
        joint: Hinge,
        body: mujoco.MjsBody,
    ) -> None:
        self.bodies[joint.child] = body
        self.origins[joint.child] = joint.point_m
        self._set_inertia(body, joint.child)

    def _start_deg(self, motor: Motor) -> float:
        """Angle of a motor's shaft at start: the middle of its range, or as in the plan without a
        range or with linkages."""
        ends = _range_of_shaft(motor)
        # Rods and loops are closed in the plan's configuration only, so a linkage has to start
        # there.
        is_linked = self.articulation.rods or self.articulation.loops
        if ends is None or is_linked:
            return self.planned.device(motor.port).angle_deg
        return sum(ends) / 2

    def _limit(
        self,
        shaft: mujoco.MjsJoint,
        motor: Motor,
        gear: float,
    ) -> None:
        """Set the end stops of a motor: where parts of the robot collide; with a range, at most a
        little beyond it."""
        if motor.end_stops_deg is not None:
            # The loader of models sets stops that the description or the plan gives, so nothing is
            # searched for here.
            return
        ends = _range_of_shaft(motor)
        if ends is None:
            # Only a motor that can turn less than once gets stops.
            stops = stops_deg(self.planned, motor.port)
            if stops is None:
                return
        else:
            lowest = ends[0] - _BEYOND_DEG
            highest = ends[1] + _BEYOND_DEG
            # The free range may be wider than what was asked for, if the plan's position is outside
            # of it.
            low, high = free_deg(
                self.planned,
                motor.port,
                lowest,
                highest,
            )
            stops = (max(low, lowest), min(high, highest))
        shaft.limited = True
        # A negative gear swaps the ends, so they are sorted.
        shaft.range = sorted(math.radians(angle) / gear for angle in stops)

    def _couple(self) -> None:
        """Couple bodies that are geared to a motor's joint."""
        for geared in self.articulation.geared:
            if geared.port not in self.motors:
                continue
            joint = geared.joint
            port = geared.port
            add_coupling(
                self.spec,
                geared,
                f"geared_{joint.child}",
                f"turn_{joint.child}",
                is_loaded=not self.articulation.is_fixed,
            )
            # A geared body follows its motor, so it has to start at the angle that belongs to the
            # motor's.
            drive = next(drive for drive in self.articulation.drives if drive.port == port)
            start_deg = self._start_deg(self.motors[port])
            turned_deg = start_deg - self.planned.device(port).angle_deg
            angle = geared.ratio * math.radians(turned_deg) / drive.gear
            body = self.bodies[joint.child]
            body.quat = mjcf.quaternion(joint.axis, angle)

    def _add_open_gears(self) -> None:
        """Couple the joints of open gears."""
        for number, coupling in enumerate(self.articulation.couplings):
            joints: list[tuple[str, float]] = []
            for body, coefficient in coupling.coefficients:
                joints += [(joint.name, coefficient) for joint in self.turning[body]]
                self._make_firm(self.turning[body][-1])
            add_gears(self.spec, f"gears_{number}", joints)

    def _make_firm(self, joint: mujoco.MjsJoint) -> None:
        """Let a light shaft withstand the torque of a motor."""
        joint.armature = _GEAR_KG_M2
        joint.solimp_limit = FIRM

    def _add_rods(self) -> None:
        """Add all rods, named after the port of a motor at one of their ends."""
        for number, rod in enumerate(self.articulation.rods):
            near_m = self._local(rod.near, rod.near_m)
            far_m = self._local(rod.far, rod.far_m)
            port = self.ports.get(rod.far) or self.ports.get(rod.near)
            body = add_rod(
                self.spec,
                name=port or str(number),
                near=(self.bodies[rod.near], near_m),
                far=(self.bodies[rod.far], far_m),
            )
            # `TurningParts` turns the body into these axes, so its looks are drawn in them.
            axes = _axes_along(rod.far_m - rod.near_m)
            looks = looks_of(
                self.planned.plan,
                rod.parts,
                rod.near_m,
                axes=axes,
            )
            mjcf.draw(self.spec, body, [looks])

    def _add_shapes(self) -> None:
        """Add all collision shapes; tyres and feet are named after the port of their motor."""
        for wheel in self.tyres:
            self._add_tyre(wheel)
        for number, (wheel, centre_m, radius_m) in enumerate(self.casters):
            name = "caster" if number == 0 else f"caster_{number}"
            local_m = self._local(wheel.link, centre_m)
            mjcf.add_caster(
                self.bodies[wheel.link],
                name,
                local_m,
                radius_m,
            )
        for number, foot in enumerate(self.feet):
            self._add_foot(foot, self.ports.get(foot.body, str(number)))
        # What touches the floor has a shape of its own, and a hull around it would touch beside
        # that. The chassis has a hull whatever it rolls on.
        touching = {foot.body for foot in self.feet}
        touching.update(wheel.link for wheel in self.tyres)
        touching.discard(0)
        for number in sorted(self.bodies.keys() - touching):
            self._add_hull(number)

    def _add_foot(self, foot: Shape, label: str) -> None:
        """Add a shape that touches the floor, named after its label."""
        # A robot on wheels has its stance from these, so what else may touch is no foot to stand
        # on.
        kind = "leg_" if self.articulation.wheels else FOOT
        geom = self.bodies[foot.body].add_geom(
            name=self._free_name(f"{kind}{label}"),
            **mjcf.contact_attributes(_PLASTIC_FRICTION),
        )
        if foot.is_level:
            # A cylinder that lies on its side touches a floor at both ends, as a capsule does.
            start_m, end_m = foot.ends_m
            geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE
            geom.fromto = [*self._local(foot.body, start_m), *self._local(foot.body, end_m)]
            geom.size = [float(foot.half_m[0]), 0, 0]
            return
        quaternion = np.empty(4)
        # Columns of the matrix are the shape's axes.
        mujoco.mju_mat2Quat(quaternion, foot.axes.T.ravel().copy())
        geom.type = _GEOMS[foot.form]
        geom.pos = self._local(foot.body, foot.centre_m)
        geom.quat = quaternion
        is_box = foot.form is Form.BOX
        geom.size = foot.half_m if is_box else [float(foot.half_m[0]), float(foot.half_m[2]), 0]

    def _add_tyre(self, wheel: Wheel) -> None:
        """Add the shape of a wheel that rolls on the floor."""
        placed = self.planned.plan.parts[wheel.part]
        low, high = placed.part.bounds
        radius_m = wheel.diameter_mm / 2000
        width_ldu = float(high[2] - low[2])
        half_width_m = width_ldu / 2 * M_PER_LDU
        # Wheels of the parts library turn about their z axis.
        axis = TO_TWIN @ placed.rotation[:, 2]
        quaternion = np.empty(4)
        mujoco.mju_quatZ2Vec(quaternion, axis)
        port = self.ports.get(wheel.link, wheel.part)
        mjcf.add_tyre(
            self.bodies[wheel.link],
            self._free_name(f"tyre_{port}"),
            (radius_m, radius_m, half_width_m),
            at_m=self._local(wheel.link, wheel.centre_m),
            turn=quaternion,
        )

    def _free_name(self, name: str) -> str:
        """The name, or with a number if it is taken."""
        candidate = name
        number = 2
        while self.spec.geom(candidate) is not None:
            candidate = f"{name}_{number}"
            number += 1
        return candidate

    def _add_hull(self, number: int) -> None:
        """Add the convex hull of a body's parts, except wheels, casters and feet. MuJoCo makes it
        from the points."""
        # What the chassis drags has shapes of its own, as feet have.
        apart = {wheel.part for wheel in self.articulation.wheels}
        apart.update(foot.part for foot in self.feet)
        corners_m = []
        for part in self.articulation.bodies[number].parts:
            if part not in apart:
                placed = self.planned.plan.parts[part]
                corners_m.append(_in_twin(placed, placed.part.corners))
        if not corners_m:
            return
        points_m = np.concatenate(corners_m) - self.origins[number]  # [n, 3]
        # MuJoCo does not compile a flat hull.
        if np.ptp(points_m, axis=0).min() < _LEAST_HULL_M:
            return
        # One point for each cell of a grid is kept, because fewer points make contacts faster.
        cells = np.round(points_m / _CORNER_M)
        _, chosen = np.unique(cells, axis=0, return_index=True)
        name = f"hull_{number}"
        self.spec.add_mesh(
            name=name,
            uservert=points_m[chosen].ravel().tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        self.bodies[number].add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            mass=0,
            **mjcf.COLLIDING,
        )

    def _add_sensors(self) -> None:
        """Add the sites of hub and sensors; sensors that are not in the plan are mounted on the
        first body."""
        # The twin's tilt and heading are those of the first body, so the hub must not move against
        # it.
        hub_moves = self.hub_body != 0 and not self.articulation.is_fixed
        if self.robot.needs_imu and hub_moves:
            raise TwinError(
                f"{self.planned.plan.path}: the hub moves against the chassis; fix it there, or "
                "say needs_imu=False"
            )
        axes = TO_TWIN @ self.hub.rotation @ TO_TWIN.T
        at_m = self._local(self.hub_body, self.hub_m)
        add_hub_site(self.bodies[self.hub_body], axes, at_m)
        base = self.bodies[0]
        for sensor in self.robot.sensors:
            placed, number = self.mounted.get(sensor.port, (None, 0))
            if placed is not None:
                self._add_sensor(sensor, placed, number)
                continue
            # A sensor's usual place exists only on a car.
            if sensor.mount is None and self.robot.drive_base is None:
                raise TwinError(
                    f"there is no place for '{sensor.name}' in {self.planned.plan.path}; add it "
                    "there or give a mount"
                )
            part = mount_sensor(
                self.spec,
                base,
                sensor,
                float(base.pos[2]),
            )
            self.mounted_parts.append(part)

    def _add_sensor(
        self,
        sensor: Sensor,
        placed: Placed,
        body: int,
    ) -> None:
        """Add the site of a sensor in the plan, at the end of its case to which it looks."""
        if body != 0:
            raise TwinError(
                f"{self.planned.plan.path}: '{sensor.name}' moves against the chassis; put it "
                "on the chassis"
            )
        looks = np.array(placed.electric.direction)
        low, high = placed.part.bounds
        # A sensor looks out of an end of its case, which is its first solid, so its eye is at that
        # end and in the middle of the other axes.
        middle = np.array(placed.part.solids[0].centre)
        lower_or_middle = np.where(looks < -0.5, low, middle)
        eye = np.where(looks > 0.5, high, lower_or_middle)
        eye_m = point_m_of(placed.point(eye))
        add_sensor_site(
            self.spec,
            self.bodies[0],
            sensor,
            np.array(self._local(0, eye_m)),
            _facing(TO_TWIN @ placed.rotation @ looks),
        )

    def _add_ball(self) -> None:
        """Add the ball at the place that the plan names."""
        for placed in self.planned.plan.parts:
            if placed.ball is not None:
                body = self.articulation.body_of(placed.index) or 0
                centre_ldu = TO_TWIN @ placed.point(placed.ball)
                centre_m = centre_ldu * MM_PER_LDU / 1000
                mjcf.add_ball(self.bodies[body], self._local(body, centre_m))
                return

    def _draw(self) -> None:
        """Draw all parts, and add lights and cameras."""
        plan = self.planned.plan
        # Rods, shafts and gears turn against the bodies that carry them, so they are drawn apart.
        drawn_apart: set[int] = set()
        for follower in self.articulation.followers:
            drawn_apart.update(follower.parts)
        for rod in self.articulation.rods:
            drawn_apart.update(rod.parts)
        for number, body in self.bodies.items():
            parts = tuple(
                part for part in self.articulation.bodies[number].parts if part not in drawn_apart
            )
            looks = looks_of(
                plan,
                parts,
                self.origins[number],
                shafts=self._shafts_of(number),
            )
            cables = cables_of(plan, parts, self.origins[number])
            mounted = self.mounted_parts if number == 0 else []
            mjcf.draw(self.spec, body, [looks, *cables, *mounted])
        for number, follower in enumerate(self.articulation.followers):
            at_m = self._local(follower.body, follower.point_m)
            carrier = self.bodies[follower.body]
            body = add_spinner(carrier, number, follower, at_m)
            looks = looks_of(plan, follower.parts, follower.point_m)
            mjcf.draw(self.spec, body, [looks])
        self._add_cameras()

    def _shafts_of(self, body: int) -> tuple[int, ...]:
        """Motors whose shafts turn with a body, as nothing but an axle is between them."""
        drives = [drive for drive in self.articulation.drives if drive.joint.child == body]
        return tuple(self.planned.device(drive.port).index for drive in drives if not drive.teeth)

    def _add_cameras(self) -> None:
        """Add light and cameras, at distances that show the whole robot."""
        corners = []
        for placed in self.planned.plan.parts:
            bounds = np.stack(placed.part.bounds)
            corners.append(placed.to_plan(bounds))
        extent = np.ptp(np.concatenate(corners), axis=0)  # [3], LDU
        size_m = float(np.linalg.norm(extent)) * MM_PER_LDU / 1000
        first = self.articulation.bodies[0]
        x_m, y_m, z_m = self._local(0, first.centre_m)
        if self.articulation.is_fixed:
            # An arm's moving parts are above its base, so the cameras aim at them.
            parent = self.spec.worldbody
            target = (x_m, y_m, 0.4 * size_m)
        else:
            parent = self.bodies[0]
            target = (x_m, y_m, z_m)
        mjcf.add_light(parent)
        mjcf.add_camera(
            parent,
            "chase",
            target,
            (-0.62, -0.62, 0.55),
            1.6 * size_m,
        )
        mjcf.add_camera(
            parent,
            "portrait",
            target,
            (0.75, -0.55, 0.42),
            1.55 * size_m,
        )
        if self.articulation.is_fixed:
            mjcf.add_webcam(parent)


def _range_of_shaft(motor: Motor) -> tuple[float, float] | None:
    """Lowest and highest angle of a motor's shaft; ``None`` if it is unlimited."""
    if motor.range_deg is None:
        return None
    first, second = sorted(angle * motor.shaft_turns for angle in motor.range_deg)
    return first, second


def _facing(looks: Floats) -> list[float]:
    """Quaternion of the shortest rotation of x to a direction."""
    # Looking backwards, no rotation is the shortest, so half a turn about the vertical is taken.
    if 1.0 + looks[0] < 1e-6:
        return [0.0, 0.0, 0.0, 1.0]
    x, y, z = looks
    turn = np.array([1.0 + x, 0.0, -z, y])
    turn /= np.linalg.norm(turn)
    return [float(value) for value in turn]


def _axes_along(direction: Floats) -> Floats:
    """Axes, as rows [3, 3], of the frame in which MuJoCo's shortest rotation takes z to a
    direction."""
    quaternion = np.empty(4)
    matrix = np.empty(9)
    mujoco.mju_quatZ2Vec(quaternion, direction)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3).T


def _casters(planned: PlannedRobot) -> list[tuple[Wheel, Floats, float]]:
    """Casters, and centre [3] and radius (m) of their balls."""
    casters = []
    for wheel in planned.articulation.wheels:
        placed = planned.plan.parts[wheel.part]
        balls = [solid for solid in placed.part.solids if solid.form is Form.BALL]
        if balls:
            ball = balls[0]
            centres_m = _in_twin(placed, np.array([ball.centre]))
            radius_m = ball.half[0] * M_PER_LDU
            casters.append((wheel, centres_m[0], radius_m))
    return casters


def _is_around(tyre: Wheel, wheel: Wheel) -> bool:
    """Whether a smaller wheel is the rim in a tyre."""
    apart_m = np.linalg.norm(tyre.centre_m - wheel.centre_m)
    return bool(tyre.link == wheel.link and apart_m <= _SAME_WHEEL_M)


def _in_twin(placed: Placed, points: Floats) -> Floats:
    """Points [n, 3] of a part in the twin's axes, m."""
    return np.asarray(placed.to_plan(points) @ TO_TWIN.T * M_PER_LDU)
