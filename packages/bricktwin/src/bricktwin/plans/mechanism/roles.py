"""Roles of motors: what each motor of a plan moves, as its parts and the floor show."""

import enum

import numpy as np

from bricktwin.plans.geometry import M_PER_LDU, Floats
from bricktwin.plans.mechanism.articulation import Articulation, Drive
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.plan import Placed, Plan

_LEVEL_COSINE = 0.5
"""Least cosine between two directions that count as one: 60 degrees apart."""
_CRANK_M = 0.024
"""Height above the floor, as drawn, up to which a part of a linkage is a foot: that of a crank of
three modules, which lifts it."""
_ROUNDING_M = 0.001


class Role(enum.StrEnum):
    """What a motor moves."""

    WHEEL = "wheel"
    """A wheel that rolls on the floor."""
    STEERING = "steering"
    """What carries a wheel, about an upright axis."""
    LEG = "leg"
    """Something without wheels that reaches the floor when it turns."""
    JOINT = "joint"
    """Something else: an arm, a gripper, a head."""


def roles_of(plan: Plan, articulation: Articulation) -> dict[str, Role]:
    """The role of each motor that moves something, by its port."""
    rolling = {wheel.link for wheel in articulation.wheels}
    drives = articulation.drives
    moved = {drive.port: moved_by(articulation, drive) for drive in drives}
    roles: dict[str, Role] = {}
    for drive in drives:
        is_upright = abs(drive.joint.axis[2]) > _LEVEL_COSINE
        if drive.joint.child in rolling and not is_upright:
            roles[drive.port] = Role.WHEEL
        elif moved[drive.port] & rolling and is_upright:
            roles[drive.port] = Role.STEERING
        else:
            roles[drive.port] = Role.JOINT
    # A robot that rolls does not walk: what reaches the floor beside its wheels is a tool.
    if articulation.wheels or articulation.is_fixed:
        return roles
    all_moved = set().union(*moved.values()) if moved else set()
    at_rest = set(range(len(articulation.bodies))) - all_moved
    floor_m = min(_lowest_m(plan, articulation, body) for body in range(len(articulation.bodies)))
    underside_m = min(_lowest_m(plan, articulation, body) for body in at_rest)
    for drive in drives:
        lowest_m = _lowest_on_its_way_m(plan, articulation, drive)
        feet_m = min(_lowest_m(plan, articulation, body) for body in moved[drive.port])
        is_linked_foot = feet_m < min(floor_m + _CRANK_M, underside_m + _ROUNDING_M)
        if lowest_m < underside_m - _ROUNDING_M or is_linked_foot:
            roles[drive.port] = Role.LEG
    return roles


def moved_by(articulation: Articulation, drive: Drive) -> set[int]:
    """Bodies that a motor moves: the driven one, what it carries, and what rods, gears and loops
    take along."""
    moved = {drive.joint.child}
    for geared in articulation.geared:
        if geared.port == drive.port:
            moved.add(geared.joint.child)
    by_motors = {other.joint.child for other in articulation.drives}
    carried = [(joint.parent, joint.child) for joint in articulation.joints]
    # What is linked goes both ways, unlike what is carried. Whatever is linked to the chassis would
    # else count as moved, and so would the part of another motor that a leg is linked to.
    linked = carried + [(loop.parent, loop.child) for loop in articulation.loops]
    linked += [(rod.near, rod.far) for rod in articulation.rods]
    linked += [(far, near) for near, far in linked]
    linked = [(near, far) for near, far in linked if far != 0 and far not in by_motors]
    grows = True
    while grows:
        reached = {far for near, far in (*carried, *linked) if near in moved}
        grows = not reached <= moved
        moved |= reached
    return moved


def _lowest_m(
    plan: Plan,
    articulation: Articulation,
    body: int,
) -> float:
    """Height of a body's lowest point, as drawn; infinite for a body without parts."""
    heights = [_corners_m(plan.parts[part])[:, 2].min() for part in _parts(articulation, body)]
    return float(min(heights, default=np.inf))


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
        radii_m = np.linalg.norm(offsets_m - along_m[:, None] * axis, axis=1)
        heights_m = point_m[2] + along_m * axis[2] - radii_m * level
        lowest_m = min(lowest_m, float(heights_m.min()))
    return lowest_m


def _parts(articulation: Articulation, body: int) -> tuple[int, ...]:
    return articulation.bodies[body].parts


def _corners_m(placed: Placed) -> Floats:
    """Corners [n, 3] of a part in the twin's axes, m."""
    return np.asarray(placed.to_plan(placed.part.corners) @ TO_TWIN.T * M_PER_LDU)
