"""Roles of motors: what each motor of a plan moves, as its parts and the floor show."""

import numpy as np

from bricktwin.plans.geometry import M_PER_LDU, Floats
from bricktwin.plans.mechanism.articulation import Articulation, Drive
from bricktwin.plans.mechanism.kinematics import TO_TWIN, Hinge
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.mechanism.open_gears import turns_with
from bricktwin.plans.plan import Placed, Plan

_LEVEL_COSINE = 0.5
"""Least cosine between two directions that count as one: 60 degrees apart."""
_CRANK_M = 0.024
"""Height above the floor, as drawn, up to which a part of a linkage is a foot: that of a crank of
three modules, which lifts it."""
_ROUNDING_M = 0.001


def roles_of(plan: Plan, articulation: Articulation) -> dict[str, Role]:
    """The role of each motor that moves something, by its port."""
    roles: dict[str, Role] = {}
    for drive in articulation.drives:
        roles[drive.port] = _role_beside_wheels(articulation, drive)
    # A robot that rolls does not walk: what reaches the floor beside its wheels is a tool.
    if articulation.wheels or articulation.is_fixed:
        return roles
    underside_m = _underside_m(plan, articulation)
    stopped = {placed.port for placed in plan.parts if placed.stops_deg is not None}
    legs: list[Drive] = []
    for drive in articulation.drives:
        # What has end stops turns back before it has made a step.
        if drive.port not in stopped and _is_leg(plan, articulation, drive, underside_m):
            legs.append(drive)
    if _is_boom(plan, articulation, legs, underside_m):
        return roles
    for drive in legs:
        roles[drive.port] = Role.LEG
    return roles


def _is_boom(
    plan: Plan,
    articulation: Articulation,
    legs: list[Drive],
    underside_m: float,
) -> bool:
    """Whether what could be a leg is the boom of a crane that stands on its hub: the only one, and
    drawn above the floor."""
    if len(legs) != 1:
        return False
    bodies = moved_by(articulation, legs[0])
    lowest_m = min(_lowest_m(plan, articulation, body) for body in bodies)
    return lowest_m > underside_m + _ROUNDING_M


def _role_beside_wheels(articulation: Articulation, drive: Drive) -> Role:
    """What a motor moves of a robot that rolls."""
    rolling = {wheel.link for wheel in articulation.wheels}
    driven = {drive.joint.child, *turns_with(articulation.couplings, drive.joint.child)}
    turned = [joint for joint in articulation.joints if joint.child in driven]
    if any(joint.child in rolling and not _is_upright(joint) for joint in turned):
        return Role.WHEEL
    carries_wheels = bool(moved_by(articulation, drive) & rolling)
    if carries_wheels and any(_is_upright(joint) for joint in turned):
        return Role.STEERING
    return Role.JOINT


def _is_upright(joint: Hinge) -> bool:
    return bool(abs(joint.axis[2]) > _LEVEL_COSINE)


def _underside_m(plan: Plan, articulation: Articulation) -> float:
    """Height of the lowest point of what no motor moves, as drawn."""
    moved: set[int] = set()
    for drive in articulation.drives:
        moved |= moved_by(articulation, drive)
    lowest_m = np.inf
    for body in range(len(articulation.bodies)):
        if body not in moved:
            lowest_m = min(lowest_m, _lowest_m(plan, articulation, body))
    return lowest_m


def _is_leg(
    plan: Plan,
    articulation: Articulation,
    drive: Drive,
    underside_m: float,
) -> bool:
    """Whether what a motor turns comes below everything that stays where it is."""
    if _lowest_on_its_way_m(plan, articulation, drive) < underside_m - _ROUNDING_M:
        return True
    # The feet of a linkage do not turn about the motor's axis: where they are drawn has to do.
    floor_m = lowest_point_m(plan, articulation)
    feet_m = np.inf
    for body in moved_by(articulation, drive):
        feet_m = min(feet_m, _lowest_m(plan, articulation, body))
    return feet_m < floor_m + _CRANK_M and feet_m < underside_m + _ROUNDING_M


def lowest_point_m(plan: Plan, articulation: Articulation) -> float:
    """Height of the robot's lowest point, as drawn."""
    bodies = range(len(articulation.bodies))
    return min(_lowest_m(plan, articulation, body) for body in bodies)


def moved_by(articulation: Articulation, drive: Drive) -> set[int]:
    """Bodies that a motor moves: the driven one, what it carries, and what rods, gears and loops
    take along."""
    moved = {drive.joint.child, *turns_with(articulation.couplings, drive.joint.child)}
    for geared in articulation.geared:
        if geared.port == drive.port:
            moved.add(geared.joint.child)
    ways = _ways(articulation)
    grows = True
    while grows:
        reached = {far for near, far in ways if near in moved}
        grows = not reached <= moved
        moved |= reached
    return moved


def _ways(articulation: Articulation) -> list[tuple[int, int]]:
    """Pairs of bodies of which the first takes the second along when it moves."""
    carried = [(joint.parent, joint.child) for joint in articulation.joints]
    linked = [(loop.parent, loop.child) for loop in articulation.loops]
    linked += [(rod.near, rod.far) for rod in articulation.rods]
    # What is linked goes both ways, and what hangs on a leg takes along the leg.
    both_ways = [*carried, *linked, *((far, near) for near, far in (*carried, *linked))]
    by_motors = {drive.joint.child for drive in articulation.drives}
    ways = list(carried)
    for near, far in both_ways:
        # Whatever is linked to the chassis would else count as moved, and so would the part of
        # another motor that a leg is linked to.
        if far != 0 and far not in by_motors:
            ways.append((near, far))
    return ways


def _lowest_m(
    plan: Plan,
    articulation: Articulation,
    body: int,
) -> float:
    """Height of a body's lowest point, as drawn; infinite for a body without parts."""
    lowest_m = np.inf
    for part in _parts(articulation, body):
        heights_m = _corners_m(plan.parts[part])[:, 2]
        lowest_m = min(lowest_m, float(heights_m.min()))
    return lowest_m


def _lowest_on_its_way_m(
    plan: Plan,
    articulation: Articulation,
    drive: Drive,
) -> float:
    """Height of the lowest point that the driven body reaches when it turns all around."""
    axis = drive.joint.axis
    point_m = drive.joint.point_m
    # Turned about an axis, a point is lowest straight below it, as far as the axis is level.
    level = float(np.hypot(axis[0], axis[1]))
    lowest_m = np.inf
    for part in _parts(articulation, drive.joint.child):
        offsets_m = _corners_m(plan.parts[part]) - point_m  # [n, 3]
        along_m = offsets_m @ axis  # [n]
        across_m = offsets_m - along_m[:, None] * axis  # [n, 3]
        radii_m = np.linalg.norm(across_m, axis=1)  # [n]
        heights_m = point_m[2] + along_m * axis[2] - radii_m * level  # [n]
        lowest_m = min(lowest_m, float(heights_m.min()))
    return lowest_m


def _parts(articulation: Articulation, body: int) -> tuple[int, ...]:
    return articulation.bodies[body].parts


def _corners_m(placed: Placed) -> Floats:
    """Corners [n, 3] of a part in the twin's axes, m."""
    return np.asarray(placed.to_plan(placed.part.corners) @ TO_TWIN.T * M_PER_LDU)
