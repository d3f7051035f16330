"""Robot of a plan: the mechanism that is derived from its parts, the wheels that motors drive, and
end stops."""

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.bodies import Bodies, find_bodies
from bricktwin.plans.building import Occupancy
from bricktwin.plans.connections import connections, meshes
from bricktwin.plans.facing import turned_ahead
from bricktwin.plans.geometry import M_PER_LDU, Floats, rotation
from bricktwin.plans.ldraw_text import sources_of, unread
from bricktwin.plans.mechanism.articulation import Articulation, Drive, articulation
from bricktwin.plans.mechanism.kinematics import TO_TWIN, Train, Wheel, mechanism, trains
from bricktwin.plans.mechanism.open_gears import open_gears, turns_with
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan, read_plan
from bricktwin.plans.wiring import wired


@dataclass(frozen=True, eq=False)
class PlannedRobot:
    """A plan, its gear trains and its articulation.

    Attributes:
        is_wired: whether the plan says the ports of its motors and sensors itself.
        geared_together: pairs of ports whose motors turn only together, as on one gear.
    """

    plan: Plan
    trains: tuple[Train, ...]
    articulation: Articulation
    is_wired: bool = True
    geared_together: tuple[tuple[str, str], ...] = ()

    def device(self, port: str) -> Placed:
        """The motor or sensor on a port of the plan."""
        devices = self.plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR)
        return next(placed for placed in devices if placed.port == port)

    @property
    def rolling(self) -> list[tuple[Drive, Wheel]]:
        """The motors that drive wheels, with the leftmost of each motor's wheels."""
        rolling = []
        for drive in self.articulation.drives:
            driven = {
                drive.joint.child,
                *turns_with(self.articulation.couplings, drive.joint.child),
            }
            wheels = [wheel for wheel in self.articulation.wheels if wheel.link in driven]
            if wheels:
                leftmost = max(wheels, key=lambda wheel: float(wheel.centre_m[1]))
                rolling.append((drive, leftmost))
        return rolling


def planned_robot(path: Path) -> PlannedRobot:
    """The robot of a plan file. Raises PlanError if the file is no plan, a motor has no port, or
    something has no twin."""
    try:
        return _planned(path, tuple(sources_of(path)))
    except OSError as error:
        raise unread(path, error) from None


@functools.lru_cache(maxsize=16)
def _planned(path: Path, _sources: tuple[bytes, ...]) -> PlannedRobot:
    # The sources are part of the key, because a file may change while a program runs.
    return planned_as_drawn(read_plan(path))


def planned_as_drawn(plan: Plan) -> PlannedRobot:
    """The robot of a plan that may say no ports, which are then given in the order of building.
    Raises PlanError as `planned`."""
    with_ports = wired(plan)
    # Who writes ports has read how our plans are drawn; all others may face anywhere.
    is_wired = with_ports is plan
    return replace(planned(plan if is_wired else turned_ahead(with_ports)), is_wired=is_wired)


def planned(plan: Plan) -> PlannedRobot:
    """The robot of a plan. Raises PlanError if a motor has no port, two devices share one, or
    something has no twin."""
    for fault in plan.faults:
        raise PlanError(f"{plan.path}, line {fault.line}: {fault.text}")
    if not plan.parts:
        raise PlanError(
            f"{plan.path} has no part that the catalogue knows; run `bricktwin plan check` on it"
        )
    ports: set[str] = set()
    for placed in plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR):
        if placed.port is None:
            raise PlanError(
                f"{plan.path}, line {placed.line}: {placed.name} has no port; write 0 !BRICKSRL "
                "PORT and its letter before it"
            )
        if placed.port in ports:
            raise PlanError(
                f"{plan.path}, line {placed.line}: port {placed.port} is used twice; give each "
                "device its own"
            )
        ports.add(placed.port)
    bodies = find_bodies(plan.parts, connections(plan.parts), meshes(plan.parts))
    robot_mechanism = mechanism(plan, bodies)
    opened = open_gears(robot_mechanism)
    gear_trains = trains(robot_mechanism, plan.path, opened.links)
    return PlannedRobot(
        plan,
        gear_trains,
        articulation(robot_mechanism, gear_trains, opened),
        geared_together=tuple(_geared_together(plan, bodies)),
    )


_SMALL = 1e-3
"""Rates of motors are of order one; what is that much smaller is a rounding error of drawing."""


def _geared_together(plan: Plan, bodies: Bodies) -> Iterator[tuple[str, str]]:
    """Pairs of ports whose motors turn at one ratio in whatever way the robot moves."""
    motions = bodies.motions()
    rates: dict[str, Floats] = {}
    for joint in bodies.joints:
        if joint.motor is not None:
            rates[plan.parts[joint.motor].port or ""] = joint.rates(motions)
    for (port, own), (other_port, other) in itertools.combinations(rates.items(), 2):
        sizes = np.linalg.norm(own), np.linalg.norm(other)
        if min(sizes) < _SMALL:
            continue
        # Parallel vectors have a cosine of 1 or -1.
        cosine = float(own @ other) / (sizes[0] * sizes[1])
        if 1.0 - abs(cosine) < _SMALL:
            yield port, other_port


# The search moves the driven part by these steps (degrees): coarse ones, and fine ones just before
# it meets something.
_STEP_DEG = 5.0
_FINE_DEG = 0.5
_LEAST_WAY_DEG = 5.0
"""Least way between two stops, degrees of the driven part. Less is no way at all."""


@functools.lru_cache(maxsize=64)
def free_deg(
    planned: PlannedRobot,
    port: str,
    low: float,
    high: float,
) -> tuple[float, float]:
    """Collision-free range of a motor's angle within ``low`` and ``high``, degrees; other motors as
    in the plan.

    Angles are readings of the rotation sensor; the range includes the plan's angle.
    """
    drive = next(drive for drive in planned.articulation.drives if drive.port == port)
    start = planned.device(port).angle_deg
    sweep = _Sweep(planned, drive)
    # The gear converts angles, because the driven part is moved here but the motor's angle is
    # limited.
    reached_low = start + sweep.reach((low - start) / drive.gear) * drive.gear
    reached_high = start + sweep.reach((high - start) / drive.gear) * drive.gear
    return min(start, reached_low), max(start, reached_high)


@functools.lru_cache(maxsize=64)
def stops_deg(planned: PlannedRobot, port: str) -> tuple[float, float] | None:
    """Angles of a motor (degrees of its rotation sensor) at which the driven parts meet others.
    ``None`` if it can turn all around, and where the angles are unknown: wheels give way, and in a
    linkage other parts move too."""
    articulation = planned.articulation
    drive = next(drive for drive in articulation.drives if drive.port == port)
    carried = carried_by(articulation, drive)
    has_wheels = any(wheel.link in carried for wheel in articulation.wheels)
    is_coupled = bool(turns_with(articulation.couplings, drive.joint.child))
    if articulation.rods or articulation.loops or has_wheels or is_coupled:
        return None
    start = planned.device(port).angle_deg
    turn = 360.0 * abs(drive.gear)
    low, high = free_deg(
        planned,
        port,
        start - turn,
        start + turn,
    )
    is_all_around = low <= start - turn or high >= start + turn
    # A part that can hardly move has been drawn with too little room; the real one has more.
    is_locked = high - low < _LEAST_WAY_DEG * abs(drive.gear)
    return None if is_all_around or is_locked else (low, high)


def carried_by(articulation: Articulation, drive: Drive) -> set[int]:
    """Bodies that a motor moves: the driven one, and all that it carries."""
    carried = {drive.joint.child}
    for joint in articulation.joints:
        if joint.parent in carried:
            carried.add(joint.child)
    return carried


class _Sweep:
    """Collision test of the parts that a motor moves."""

    def __init__(
        self,
        planned: PlannedRobot,
        drive: Drive,
    ) -> None:
        articulation = planned.articulation
        motor = planned.device(drive.port)
        sites = tuple(site for site in motor.part.sites if not site.turns)
        # The disc on the motor's shaft turns with the driven parts, so the case goes without it.
        case = replace(motor, part=replace(motor.part, turning=(), sites=sites))
        self._parts = tuple(case if part is motor else part for part in planned.plan.parts)
        self._axis = TO_TWIN.T @ drive.joint.axis
        self._point = TO_TWIN.T @ drive.joint.point_m / M_PER_LDU
        carried = carried_by(articulation, drive)
        self._moved = {part for body in carried for part in articulation.bodies[body].parts}
        self._others = np.ones(len(self._parts), dtype=bool)
        self._others[list(self._moved)] = False
        # Geared parts and rods move too, which this sweep does not follow, so they are not tested.
        for geared in articulation.geared:
            if geared.port == drive.port:
                self._others[list(articulation.bodies[geared.joint.child].parts)] = False
        for rod in articulation.rods:
            self._others[list(rod.parts)] = False
        self._is_clear_at_start = self._is_clear(0.0)

    def reach(self, travel_deg: float) -> float:
        """Collision-free part of a travel, degrees of the driven part."""
        if not self._is_clear_at_start:
            return 0.0
        sign = math.copysign(1.0, travel_deg)
        free = 0.0
        while free < abs(travel_deg):
            blocked = min(free + _STEP_DEG, abs(travel_deg))
            if self._is_clear(sign * blocked):
                free = blocked
                continue
            # Bisection narrows the gap between the last free step and the blocked one.
            while blocked - free > _FINE_DEG:
                middle = (free + blocked) / 2
                if self._is_clear(sign * middle):
                    free = middle
                else:
                    blocked = middle
            return sign * free
        return travel_deg

    def _is_clear(self, angle_deg: float) -> bool:
        """Whether the moved parts meet nothing when the driven part is turned by an angle."""
        turn = rotation(self._axis, math.radians(angle_deg))
        parts = list(self._parts)
        for index in self._moved:
            placed = parts[index]
            position = turn @ (placed.position - self._point) + self._point
            parts[index] = replace(placed, rotation=turn @ placed.rotation, position=position)
        # Parts know their bounds and samples, so only those of the moved ones are computed anew.
        return Occupancy(parts).is_free(self._moved, self._others, np.zeros(3))
