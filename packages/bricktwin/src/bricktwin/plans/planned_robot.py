"""Robots derived from plans, cached per file."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from brickhub.errors import PlanError
from bricktwin.plans.bodies import Bodies, find_bodies
from bricktwin.plans.chains import chain_meshes
from bricktwin.plans.connections import connections, meshes
from bricktwin.plans.geometry import Floats
from bricktwin.plans.mechanism.articulation import Articulation, articulation
from bricktwin.plans.mechanism.kinematics import Mechanism, mechanism
from bricktwin.plans.mechanism.trains import Train, trains
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Placed, Plan, read_plan


@dataclass(frozen=True, eq=False)
class Rolling:
    """A motor that drives a wheel: diameter and middle [3] of the wheel, and whether clockwise rolls forwards."""

    port: str
    diameter_mm: float
    centre_m: Floats
    is_clockwise_forward: bool


@dataclass(frozen=True, eq=False)
class PlannedRobot:
    """A plan and its derived mechanism."""

    plan: Plan
    bodies: Bodies
    mechanism: Mechanism
    trains: tuple[Train, ...]
    articulation: Articulation

    def device(self, port: str) -> Placed:
        """The motor or sensor on a port of the plan."""
        return next(placed for placed in self.plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR) if placed.port == port)

    @property
    def rolling(self) -> tuple[Rolling, ...]:
        """The motors that drive wheels; of several wheels of one motor, the leftmost counts."""
        rolling = []
        for drive in self.articulation.drives:
            wheels = [wheel for wheel in self.articulation.wheels if wheel.link == drive.joint.child]
            if wheels:
                wheel = max(wheels, key=lambda wheel: float(wheel.centre_m[1]))
                # Turning about +y, to the left, rolls forwards.
                forward = float(drive.joint.axis[1]) * drive.gear > 0
                rolling.append(Rolling(drive.port, wheel.diameter_mm, wheel.centre_m, forward))
        return tuple(rolling)


def planned_robot(path: Path) -> PlannedRobot:
    """The robot of a plan file. Raises PlanError if the file is no plan, a motor has no port, or something has no twin."""
    try:
        state = path.stat()
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror or error}; name an LDraw file (.ldr, .mpd or .io)") from None
    return _planned(path, path.resolve(), (state.st_mtime_ns, state.st_ctime_ns), state.st_size)


@functools.lru_cache(maxsize=16)
def _planned(path: Path, _resolved: Path, _changed_ns: tuple[int, int], _size: int) -> PlannedRobot:
    return planned(read_plan(path))


def planned(plan: Plan) -> PlannedRobot:
    """The robot of a plan. Raises PlanError if a motor has no port, two devices share one, or something has no twin."""
    if not plan.parts:
        raise PlanError(f"{plan.path} has no part that the catalogue knows; run `bricktwin plan check` on it")
    ports: set[str] = set()
    for placed in plan.devices(DeviceKind.MOTOR, DeviceKind.SENSOR):
        if placed.port is None:
            raise PlanError(
                f"{plan.path}, line {placed.line}: {placed.name} has no port; write 0 !BRICKSRL PORT and its letter before it"
            )
        if placed.port in ports:
            raise PlanError(f"{plan.path}, line {placed.line}: port {placed.port} is used twice; give each device its own")
        ports.add(placed.port)
    bodies = find_bodies(plan.parts, connections(plan.parts), [*meshes(plan.parts), *chain_meshes(plan.parts)])
    robot_mechanism = mechanism(plan, bodies)
    gear_trains = trains(robot_mechanism, plan.path)
    return PlannedRobot(plan, bodies, robot_mechanism, gear_trains, articulation(robot_mechanism, gear_trains))
