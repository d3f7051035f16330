"""Mechanism of a plan: links with mass and inertia, hinges, gear ratios, wheels, sensors, and the
gear train of each motor.

Plain data in metres, kilograms, radians; x forward, y left, z up (plan: z forward, y down). The
origin is the plan's.
"""

import functools
import math
from collections import Counter, defaultdict
from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from brickhub.errors import PlanError
from bricktwin.plans.bodies import MAX_BODIES, Bodies, BodyJoint
from bricktwin.plans.connections import Mesh, reached
from bricktwin.plans.geometry import M_PER_LDU, Floats, lines_coincide
from bricktwin.plans.part import DeviceKind, GearForm, Part
from bricktwin.plans.plan import Placed, Plan

TO_TWIN = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from a plan's frame to the twin's."""
_SPACING = 2.5
"""Least spacing of the points that carry a part's mass, LDU."""
_MAX_POINTS = 30_000
"""Number of these points, roughly, for a large part."""
_MIN_RATIO = 1e-4
"""Least turns of a hinge for a turn of a motor that drives it."""
_COAXIAL_M = 0.001
# These are estimates for the shaft of a motor with nothing on it.
_SHAFT_KG = 0.002
_SHAFT_RADIUS_M = 0.01


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
        axis: direction [3]; of a motor's hinge the outward direction of the shaft (reversed if the
            child is the case).
        port: of the motor that drives it, else ``None``.
        closes_loop: whether other hinges already connect the two links.
        is_shaft: whether a gear that meshes turns about its axis.
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
    is_shaft: bool = False


@dataclass(frozen=True, eq=False)
class Wheel:
    """A wheel on the floor: link, middle [3] in metres, diameter, index of the part."""

    link: int
    centre_m: Floats
    diameter_mm: float
    part: int


@dataclass(frozen=True, eq=False)
class Mechanism:
    """The mechanism of a robot.

    Attributes:
        ratios: [hinges, motors], turns of a hinge's child about its axis per turn of a motor's
            shaft about its outward direction, in the plan's position; motors in the order of
            ``ports``.
        ports: of the motors.
        devices: links that carry the hub and the sensors.
        meshes: pairs of links with their gears that mesh.
        corners_m: corners [n, 3] of the solids of each part, by its index in the plan.
        fixed: index of the fixed link, or ``None``.
    """

    links: tuple[Link, ...]
    hinges: tuple[Hinge, ...]
    ports: tuple[str, ...]
    ratios: Floats
    wheels: tuple[Wheel, ...]
    devices: tuple[int, ...]
    meshes: tuple[tuple[int, int, Mesh], ...]
    corners_m: dict[int, Floats]
    fixed: int | None


def mechanism(plan: Plan, bodies: Bodies) -> Mechanism:
    """The mechanism of a plan from its rigid bodies. Raises PlanError if there are too many bodies
    to be one robot."""
    if len(bodies.members) > MAX_BODIES:
        raise PlanError(
            f"{plan.path} has {len(bodies.members)} bodies; run `bricktwin plan check` on it and "
            "connect them"
        )
    motions = bodies.motions()
    members = bodies.members
    link_of = {part: number for number, parts in enumerate(members) for part in parts}
    links = []
    for parts, rotors in zip(members, bodies.rotors, strict=True):
        # A body without parts is the rotor of a motor that carries nothing.
        if parts:
            links.append(merged([_part_link(plan.parts[part]) for part in parts]))
        else:
            links.append(_bare_shaft(plan, rotors[0]))
    ordered = _hinges(plan, bodies)
    hinges = tuple(hinge for _, hinge in ordered)
    motors = [joint for joint in bodies.joints if joint.motor is not None]
    ports = tuple(plan.parts[joint.motor].port or "" for joint in motors if joint.motor is not None)
    ratios = np.zeros((len(ordered), len(motors)))
    if ratios.size:
        # The rates of the hinges [hinges, motions] are `ratios` times the rates of the shafts
        # [motors, motions]. The pseudo-inverse solves that also where motors and motions differ in
        # number.
        rates = np.stack([joint.rates(motions, hinge.parent) for joint, hinge in ordered])
        shaft_rates = np.stack([joint.rates(motions) for joint in motors])
        solved = rates @ np.linalg.pinv(shaft_rates)  # [hinges, motors]
        ratios += np.round(solved, 6)
    # A part that is not connected to the heaviest body has no link.
    connected = [placed for placed in plan.parts if placed.index in link_of]
    wheels = []
    for placed in connected:
        if placed.part.wheel_mm:
            centre_m = point_m_of(placed.position)
            link = link_of[placed.index]
            wheels.append(
                Wheel(
                    link,
                    centre_m,
                    placed.part.wheel_mm,
                    placed.index,
                )
            )
    carried = plan.devices(DeviceKind.HUB, DeviceKind.SENSOR)
    devices = tuple(link_of[placed.index] for placed in carried if placed.index in link_of)
    fixed_links = [link_of[placed.index] for placed in connected if placed.is_fixed]
    return Mechanism(
        tuple(links),
        hinges,
        ports,
        ratios,
        tuple(wheels),
        devices,
        bodies.meshes,
        {placed.index: _corners_m(placed) for placed in connected},
        fixed=fixed_links[0] if fixed_links else None,
    )


def _hinges(plan: Plan, bodies: Bodies) -> list[tuple[BodyJoint, Hinge]]:
    """A hinge per pair of links and axis: motors first, then gears, then by distance from the first
    link. A geared crank hangs on its axle: were it reached through its leg instead, its axle would
    only close a loop, which no gear can turn."""
    remaining: list[tuple[BodyJoint, int, int]] = []
    shafts = _gear_shafts(plan, bodies)

    def is_shaft(joint: BodyJoint) -> bool:
        lines = [line for body in joint.bodies for line in shafts[body]]
        return any(_is_on_line(joint, *line) for line in lines)

    def rank(joint: BodyJoint) -> tuple[bool, bool]:
        return joint.motor is None, not is_shaft(joint)

    for joint in sorted(bodies.joints, key=rank):
        first, second = joint.bodies
        known = [other for other, *pair in remaining if {*pair} == {first, second}]
        if first != second and not any(_is_same_axis(joint, other) for other in known):
            remaining.append((joint, first, second))
    is_fixed = [any(plan.parts[part].is_fixed for part in parts) for parts in bodies.members]
    root = is_fixed.index(True) if any(is_fixed) else 0
    reached = {root}
    hinges = []
    while remaining:
        # Hinges that reach a new link make the tree first, because only once there is none does a
        # hinge close a loop.
        open_ends = [edge for edge in remaining if (edge[1] in reached) != (edge[2] in reached)]
        edge = (open_ends or remaining)[0]
        remaining.remove(edge)
        joint, first, second = edge
        parent, child = (first, second) if first in reached else (second, first)
        port = plan.parts[joint.motor].port if joint.motor is not None else None
        # A motor that is held by its shaft turns its case. Reversing the axis keeps the direction
        # of its angle.
        is_held_by_shaft = port is not None and parent != first
        sign = -1.0 if is_held_by_shaft else 1.0
        axis = sign * TO_TWIN @ joint.axis
        hinge = Hinge(
            parent,
            child,
            point_m_of(joint.point),
            axis,
            port,
            closes_loop=not open_ends,
            turns_child=parent == first,
            is_ball=joint.is_ball,
            is_shaft=is_shaft(joint),
        )
        hinges.append((joint, hinge))
        reached |= {first, second}
    return hinges


def _gear_shafts(plan: Plan, bodies: Bodies) -> dict[int, list[tuple[Floats, Floats]]]:
    """Point [3] and direction [3] of the axes of the meshing gears of each body."""
    shafts: dict[int, list[tuple[Floats, Floats]]] = defaultdict(list)
    for first, second, mesh in bodies.meshes:
        of_bodies = (first, second)
        of_parts = (mesh.first, mesh.second)
        for body, part, gear in zip(of_bodies, of_parts, mesh.gears, strict=True):
            placed = plan.parts[part]
            # A rack travels along its axis, on which nothing turns.
            if gear.form is not GearForm.RACK:
                axis = placed.rotation @ np.array(gear.axis)
                shafts[body].append((placed.point(gear.centre), axis))
    return shafts


def _is_same_axis(joint: BodyJoint, other: BodyJoint) -> bool:
    """Whether two joints between the same two bodies are one hinge. A ball joint never is."""
    return not other.is_ball and _is_on_line(joint, other.point, other.axis)


def _is_on_line(
    joint: BodyJoint,
    point: Floats,
    axis: Floats,
) -> bool:
    """Whether a joint turns about a line; a ball joint has no axis."""
    return not joint.is_ball and lines_coincide(
        point,
        axis,
        joint.point,
        joint.axis,
        offset=2.0,
        sine=0.05,
    )


def point_m_of(point: Floats) -> Floats:
    """A point [3] of a plan in the twin's axes, m."""
    return np.asarray(TO_TWIN @ point * M_PER_LDU)


def _corners_m(placed: Placed) -> Floats:
    """Corners [n, 3] of a part's solids in the twin's axes, m."""
    return np.asarray(placed.to_plan(placed.part.corners) @ TO_TWIN.T * M_PER_LDU)


def _bare_shaft(plan: Plan, motor: int) -> Link:
    """A motor's rotor with nothing on it."""
    placed = plan.parts[motor]
    site = next(site for site in placed.part.sites if site.turns)
    inertia = np.eye(3) * _SHAFT_KG * _SHAFT_RADIUS_M**2
    return Link(
        (),
        _SHAFT_KG,
        point_m_of(placed.point(site.centre)),
        inertia,
    )


def merged(links: list[Link]) -> Link:
    """Links merged into one rigid body."""
    mass = sum(link.mass_kg for link in links)
    first_moment = sum(link.mass_kg * link.centre_m for link in links)  # [3]
    centre = np.asarray(first_moment / mass)
    inertia = np.zeros((3, 3))
    for link in links:
        # The parallel axis theorem (Steiner) moves each inertia to the common centre.
        offset = link.centre_m - centre
        squared_distance = float(offset @ offset)
        of_offset = squared_distance * np.eye(3) - np.outer(offset, offset)
        inertia += link.inertia + link.mass_kg * of_offset
    parts = tuple(part for link in links for part in link.parts)
    return Link(parts, mass, centre, inertia)


def _part_link(placed: Placed) -> Link:
    """A part of uniform density."""
    mass = placed.part.mass_g / 1000
    centre, inertia = _unit_inertia(placed.part)
    turn = TO_TWIN @ placed.rotation
    centre_m = point_m_of(placed.point(centre))
    return Link(
        (placed.index,),
        mass,
        centre_m,
        mass * turn @ inertia @ turn.T,
    )


@functools.lru_cache(maxsize=512)
def _unit_inertia(part: Part) -> tuple[Floats, Floats]:
    """Centre [3] in LDU and inertia [3, 3] in m² per kg of a part, in its own frame, from a grid of
    points."""
    low, high = part.bounds
    # The spacing grows with the part, so that a large one does not need millions of points.
    volume = float(np.prod(high - low))
    spacing = max(_SPACING, (volume / _MAX_POINTS) ** (1 / 3))
    wanted_counts = np.ceil((high - low) / spacing)
    counts = np.clip(wanted_counts, 4, 48).astype(int)
    cell = (high - low) / counts
    lines = [
        start + size * (np.arange(count) + 0.5)
        for start, size, count in zip(low, cell, counts, strict=True)
    ]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)  # [i, j, k, 3]
    points = grid.reshape(-1, 3)
    points = points[part.contains(points, 0.0)]
    centre = points.mean(axis=0)
    offset = (points - centre) * M_PER_LDU
    # Each point stands for a small box, whose own inertia must not be lost.
    cell_m = cell * M_PER_LDU
    of_cell = np.diag(cell_m**2 / 12)
    of_points = offset.T @ offset / len(points)
    moments = of_points + of_cell  # [3, 3]
    # The inertia follows from the second moments S as trace(S) 1 - S.
    inertia = np.trace(moments) * np.eye(3) - moments
    return centre, np.asarray(inertia)


@dataclass(frozen=True)
class Train:
    """A motor and what it drives.

    Attributes:
        output: index of the driven hinge; the shaft's without gears.
        ratio: turns of the output's child about its axis per turn of the shaft.
        teeth: meshing pairs from the motor to the output; empty without gears.
        others: indices and ratios of the other geared hinges, including the shaft's.
    """

    port: str
    output: int
    ratio: float
    teeth: tuple[int, ...]
    others: tuple[tuple[int, float], ...]

    @property
    def hinges(self) -> set[int]:
        """Indices of all hinges that it turns."""
        return {self.output, *(number for number, _ in self.others)}

    @property
    def gears(self) -> tuple[int, ...]:
        """Teeth ``(motor, output)`` of one pair with the same ratio; empty without gears."""
        if not self.teeth:
            return ()
        driving = Counter(self.teeth[::2])
        driven = Counter(self.teeth[1::2])
        first = list((driving - driven).elements())
        last = list((driven - driving).elements())
        # An idler is both driven and driving, so it cancels out and leaves the ratio unchanged.
        if len(first) == len(last) == 1:
            return first[0], last[0]
        before = math.prod(first)
        after = math.prod(last)
        shared = math.gcd(before, after)
        return before // shared, after // shared


def trains(
    mechanism: Mechanism,
    path: str,
    open_links: Container[int] = (),
) -> tuple[Train, ...]:
    """The train of each motor, in the order of the mechanism's ports; that of a motor with open
    gears, whose links are given, ends at its shaft. Raises PlanError if two motors drive the same
    thing, or a gear drives a rack."""
    neighbours: dict[int, list[tuple[int, int, int]]] = defaultdict(list)
    for link, other, mesh in mechanism.meshes:
        gear, other_gear = mesh.gears
        if link != other and GearForm.RACK in (gear.form, other_gear.form):
            raise PlanError(
                f"{path}: a gear drives a rack; sliding parts have no twin, so drive a "
                "rotating part"
            )
        if link in open_links or other in open_links:
            continue
        neighbours[link].append((other, gear.teeth, other_gear.teeth))
        neighbours[other].append((link, other_gear.teeth, gear.teeth))
    result: list[Train] = []
    for column, port in enumerate(mechanism.ports):
        shafts = [number for number, hinge in enumerate(mechanism.hinges) if hinge.port == port]
        if not shafts:
            raise PlanError(
                f"{path}: the motor of port {port} drives the same part as another one, or "
                "nothing; remove it"
            )
        result.append(
            _train(
                mechanism,
                neighbours,
                shafts[0],
                column,
            )
        )
    driven = Counter(hinge for train in result for hinge in train.hinges)
    shared = {hinge for hinge, count in driven.items() if count > 1}
    if shared:
        ports = ", ".join(train.port for train in result if train.hinges & shared)
        raise PlanError(
            f"{path}: the motors of ports {ports} drive the same part; give each part one motor"
        )
    return tuple(result)


def _train(
    mechanism: Mechanism,
    neighbours: dict[int, list[tuple[int, int, int]]],
    index: int,
    column: int,
) -> Train:
    """The train of the motor with shaft hinge ``index``."""
    shaft = mechanism.hinges[index]
    ratios = mechanism.ratios[:, column]
    rotor = shaft.child
    case = shaft.parent
    if not shaft.turns_child:
        rotor, case = case, rotor
    # A breadth-first search finds the teeth on the way from the rotor to each link, by the fewest
    # meshes.
    reached: dict[int, tuple[int, ...]] = {rotor: ()}
    queue = [rotor]
    while queue:
        link = queue.pop(0)
        for other, link_teeth, other_teeth in neighbours[link]:
            # The motor pushes against its case, which is therefore no part of the train.
            if other not in reached and other != case:
                reached[other] = (*reached[link], link_teeth, other_teeth)
                queue.append(other)
    hinges: dict[int, tuple[int, ...]] = {index: ()}
    for link, teeth in reached.items():
        for number, hinge in enumerate(mechanism.hinges):
            ratio = abs(ratios[number])
            is_in_tree = not (hinge.closes_loop or hinge.is_ball)
            # Only the axis of its gear tells a geared link's ratio. Its other hinges belong to a
            # linkage, and have that ratio at most by chance, in the plan's position.
            is_free = hinge.is_shaft and hinge.port is None and is_in_tree and ratio > _MIN_RATIO
            is_of_link = bool(teeth) and is_free and link in (hinge.parent, hinge.child)
            if is_of_link and abs(ratio - _ratio(teeth)) < 0.02 * ratio:
                hinges.setdefault(number, teeth)

    def rank(number: int) -> tuple[tuple[bool, float], int, int]:
        # The output is what carries most; among equal loads it has the fewest gears, or comes
        # first.
        return _weight(mechanism, number), -len(hinges[number]), -number

    output = max(hinges, key=rank)
    # The size of a ratio is taken from the teeth, which are exact, and its sign from the motions.
    exact: dict[int, float] = {}
    for number, teeth in hinges.items():
        exact[number] = math.copysign(_ratio(teeth), ratios[number])
    others = tuple((number, ratio) for number, ratio in exact.items() if number != output)
    return Train(
        mechanism.ports[column],
        output,
        exact[output],
        hinges[output],
        others,
    )


def _ratio(teeth: tuple[int, ...]) -> float:
    """Turns of the last gear per turn of the first one, without sign."""
    return math.prod(teeth[::2]) / math.prod(teeth[1::2])


def _weight(mechanism: Mechanism, number: int) -> tuple[bool, float]:
    """Sort key of a hinge's load: whether there is a wheel, and the mass."""
    children: dict[int, list[int]] = defaultdict(list)
    for hinge in mechanism.hinges:
        if not hinge.closes_loop:
            children[hinge.parent].append(hinge.child)
    carried = reached([mechanism.hinges[number].child], children)
    mass_kg = sum(mechanism.links[link].mass_kg for link in carried)
    return any(wheel.link in carried for wheel in mechanism.wheels), round(mass_kg, 6)


def is_balanced(
    mechanism: Mechanism,
    hinge: Hinge,
    link: int,
    max_kg_m: float,
) -> bool:
    """Whether a link's centre of mass is close to a hinge's axis."""
    body = mechanism.links[link]
    offset: Floats = np.cross(body.centre_m - hinge.point_m, hinge.axis)
    return bool(body.mass_kg * np.linalg.norm(offset) < max_kg_m)


def share_axis(first: Hinge, second: Hinge) -> bool:
    """Whether two hinges share an axis; a ball joint has none."""
    is_ball = first.is_ball or second.is_ball
    return not is_ball and lines_coincide(
        first.point_m,
        first.axis,
        second.point_m,
        second.axis,
        offset=_COAXIAL_M,
        sine=0.02,
    )
