"""Mechanism of a plan: links with mass and inertia, hinges, gear ratios, wheels, sensors. Plain data.

Metres, kilograms, radians; x forward, y left, z up (plan: z forward, y down). The origin is the plan's.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.bodies import MAX_BODIES, Bodies, BodyJoint
from bricktwin.plans.geometry import M_PER_LDU, Floats, lines_coincide
from bricktwin.plans.part import DeviceKind, GearForm, Part
from bricktwin.plans.plan import Placed, Plan

TO_TWIN = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from a plan's frame to the twin's."""
_SPACING = 2.5
"""LDU: minimum spacing of the points that carry a part's mass."""
_MAX_POINTS = 30_000
_SHAFT_KG, _SHAFT_RADIUS_M = 0.002, 0.01
"""Estimates for a motor's shaft with nothing on it."""


@dataclass(frozen=True, eq=False)
class Link:
    """Parts without relative motion.

    Attributes:
        parts: indices in the plan.
        mass_kg: total; all of a motor's mass is at its case.
        centre_m: centre of mass [3].
        inertia: about the centre of mass, kg m² [3, 3].
    """

    parts: tuple[int, ...]
    mass_kg: float
    centre_m: Floats
    inertia: Floats


@dataclass(frozen=True, eq=False)
class Hinge:
    """A hinge, or a ball joint, between two links.

    Attributes:
        parent, child: indices of the links; the parent is nearer to the fixed or the first link.
        point_m: midpoint on the axis [3].
        axis: direction [3]; of a motor's hinge the outward direction of the shaft (reversed if the child is the case).
        port: of the motor that drives it, else ``None``.
        closes_loop: whether other hinges already connect the two links.
        turns_child: of a motor: whether the child is the rotor's side.
    """

    parent: int
    child: int
    point_m: Floats
    axis: Floats
    port: str | None
    closes_loop: bool
    turns_child: bool = True
    is_ball: bool = False


@dataclass(frozen=True, eq=False)
class Wheel:
    """A wheel on the floor: link, middle [3] in metres, diameter, index of the part."""

    link: int
    centre_m: Floats
    diameter_mm: float
    part: int


@dataclass(frozen=True, eq=False)
class Mounted:
    """The hub or a sensor: link, position [3] in metres, viewing direction [3], index of the part.

    A hub's direction is that of its USB port.
    """

    link: int
    port: str | None
    name: str
    point_m: Floats
    looks: Floats
    part: int


@dataclass(frozen=True)
class Teeth:
    """Two links with meshing gears: link, teeth and kind of each."""

    links: tuple[int, int]
    teeth: tuple[int, int]
    forms: tuple[GearForm, GearForm]


@dataclass(frozen=True, eq=False)
class Mechanism:
    """The mechanism of a robot.

    Attributes:
        ratios: [hinges, motors], turns of a hinge's child about its axis per turn of a motor's shaft about its outward direction,
            in the plan's position; motors in the order of ``ports``.
        ports: of the motors.
        gears: meshing gears.
        fixed: index of the fixed link, or ``None``.
    """

    links: tuple[Link, ...]
    hinges: tuple[Hinge, ...]
    ports: tuple[str, ...]
    ratios: Floats
    wheels: tuple[Wheel, ...]
    mounted: tuple[Mounted, ...]
    gears: tuple[Teeth, ...]
    fixed: int | None


def mechanism(plan: Plan, bodies: Bodies) -> Mechanism:
    """The mechanism of a plan from its rigid bodies. Raises PlanError if there are too many bodies to be one robot."""
    if len(bodies.members) > MAX_BODIES:
        raise PlanError(f"{plan.path} has {len(bodies.members)} bodies; run `bricktwin plan check` on it and connect them")
    motions = bodies.motions()
    members = bodies.members
    link_of = {part: number for number, parts in enumerate(members) for part in parts}
    links = tuple(
        merged([_part_link(plan.parts[part]) for part in parts]) if parts else _bare_shaft(plan, rotors[0])
        for parts, rotors in zip(members, bodies.rotors, strict=True)
    )
    ordered = _hinges(plan, bodies)
    motors = [joint for joint in bodies.joints if joint.motor is not None]
    ports = tuple(plan.parts[joint.motor].port or "" for joint in motors if joint.motor is not None)
    shaft_rates = [_rate(joint, *joint.bodies, motions) for joint in motors]
    ratios = _ratios([_rate(joint, hinge.parent, hinge.child, motions) for joint, hinge in ordered], shaft_rates)
    wheels = tuple(
        Wheel(link_of[placed.index], _point_m(placed.position), placed.part.wheel_mm, placed.index)
        for placed in plan.parts
        if placed.part.wheel_mm and placed.index in link_of
    )
    gears = tuple(
        Teeth((first, second), (mesh.gears[0].teeth, mesh.gears[1].teeth), (mesh.gears[0].form, mesh.gears[1].form))
        for first, second, mesh in bodies.meshes
        if first != second
    )
    hinges = tuple(hinge for _, hinge in ordered)
    fixed = next((link_of[placed.index] for placed in plan.parts if placed.is_fixed and placed.index in link_of), None)
    return Mechanism(links, hinges, ports, ratios, wheels, _mounted(plan, link_of), gears, fixed)


def _hinges(plan: Plan, bodies: Bodies) -> list[tuple[BodyJoint, Hinge]]:
    """A hinge per pair of links and axis: motors first, then by distance from the first link."""
    remaining: list[tuple[BodyJoint, int, int]] = []
    for joint in sorted(bodies.joints, key=lambda joint: joint.motor is None):
        first, second = joint.bodies
        is_known = any({a, b} == {first, second} and _is_coaxial(other, joint) for other, a, b in remaining)
        if first != second and not is_known:
            remaining.append((joint, first, second))
    is_fixed = [any(plan.parts[part].is_fixed for part in parts) for parts in bodies.members]
    root = is_fixed.index(True) if any(is_fixed) else 0
    reached, hinges = {root}, []
    while remaining:
        open_ends = [edge for edge in remaining if (edge[1] in reached) != (edge[2] in reached)]
        edge = (open_ends or remaining)[0]
        remaining.remove(edge)
        joint, first, second = edge
        parent, child = (first, second) if first in reached else (second, first)
        port = plan.parts[joint.motor].port if joint.motor is not None else None
        # If a motor is held by its shaft, its case turns; reversing the axis keeps the direction.
        sign = -1.0 if port is not None and parent != first else 1.0
        point_m, axis = _point_m(joint.point), sign * TO_TWIN @ joint.axis
        hinge = Hinge(parent, child, point_m, axis, port, not open_ends, parent == first, joint.is_ball)
        hinges.append((joint, hinge))
        reached |= {first, second}
    return hinges


def _is_coaxial(first: BodyJoint, second: BodyJoint) -> bool:
    is_ball = first.is_ball or second.is_ball
    return not is_ball and lines_coincide(first.point, first.axis, second.point, second.axis, offset=2.0, sine=0.05)


def _ratios(rates: list[Floats], shaft_rates: list[Floats]) -> Floats:
    """Turns of each hinge per turn of each motor [hinges, motors]."""
    if not (rates and shaft_rates):
        return np.zeros((len(rates), len(shaft_rates)))
    return np.asarray(np.round(np.stack(rates) @ np.linalg.pinv(np.stack(shaft_rates)), 6)) + 0.0


def _rate(joint: BodyJoint, parent: int, child: int, motions: Floats) -> Floats:
    """Relative angular rate of two bodies about a joint's axis in each motion [n]."""
    relative = motions[6 * child + 3 : 6 * child + 6] - motions[6 * parent + 3 : 6 * parent + 6]
    # A case that turns about its shaft is the shaft turning about the reversed axis.
    sign = -1.0 if joint.motor is not None and parent != joint.bodies[0] else 1.0
    return np.asarray(sign * joint.axis @ relative)


def _point_m(point: Floats) -> Floats:
    return np.asarray(TO_TWIN @ point * M_PER_LDU)


def _mounted(plan: Plan, link_of: dict[int, int]) -> tuple[Mounted, ...]:
    mounted = []
    for placed in plan.devices(DeviceKind.HUB, DeviceKind.SENSOR):
        if placed.index not in link_of:
            continue
        device = placed.electric
        looks = np.array(device.looks or (0.0, 0.0, 1.0))
        low, high = placed.part.bounds
        local = np.where(looks > 0.5, high, np.where(looks < -0.5, low, 0.0)) if device.looks else np.array(device.plug)
        point_m, facing = _point_m(placed.point(local)), TO_TWIN @ placed.rotation @ looks
        mounted.append(Mounted(link_of[placed.index], placed.port, placed.device or device.name, point_m, facing, placed.index))
    return tuple(mounted)


def _bare_shaft(plan: Plan, motor: int) -> Link:
    """A motor's rotor with nothing on it."""
    placed = plan.parts[motor]
    site = next(site for site in placed.part.sites if site.turns)
    return Link((), _SHAFT_KG, _point_m(placed.point(site.centre)), np.eye(3) * _SHAFT_KG * _SHAFT_RADIUS_M**2)


def merged(links: list[Link]) -> Link:
    """Links merged into one rigid body."""
    mass = sum(link.mass_kg for link in links)
    centre = np.asarray(sum(link.mass_kg * link.centre_m for link in links) / mass)
    inertia = np.zeros((3, 3))
    for link in links:
        offset = link.centre_m - centre
        inertia += link.inertia + link.mass_kg * (float(offset @ offset) * np.eye(3) - np.outer(offset, offset))
    return Link(tuple(part for link in links for part in link.parts), mass, centre, inertia)


def _part_link(placed: Placed) -> Link:
    """A part of uniform density."""
    mass = placed.part.mass_g / 1000
    centre, inertia = _unit_inertia(placed.part)
    turn = TO_TWIN @ placed.rotation
    return Link((placed.index,), mass, _point_m(placed.point(centre)), mass * turn @ inertia @ turn.T)


@functools.lru_cache(maxsize=512)
def _unit_inertia(part: Part) -> tuple[Floats, Floats]:
    """Centre [3] in LDU and inertia [3, 3] in m² per kg of a part, in its own frame, from a grid of points."""
    low, high = part.bounds
    spacing = max(_SPACING, (float(np.prod(high - low)) / _MAX_POINTS) ** (1 / 3))
    counts = np.clip(np.ceil((high - low) / spacing), 4, 48).astype(int)
    cell = (high - low) / counts
    lines = [start + size * (np.arange(count) + 0.5) for start, size, count in zip(low, cell, counts, strict=True)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[part.contains(points, 0.0)]
    centre = points.mean(axis=0)
    offset = (points - centre) * M_PER_LDU
    # Each point is a small box with an inertia of its own.
    squares = offset.T @ offset / len(points) + np.diag((cell * M_PER_LDU) ** 2 / 12)
    return centre, np.asarray(np.trace(squares) * np.eye(3) - squares)
