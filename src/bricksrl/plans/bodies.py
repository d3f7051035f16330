"""Rigid bodies of a plan, the joints between them, and which motions they leave. LDraw units, the plan's frame.

A motion is given by six rates of each body, linear at the plan's origin and angular; each joint and each pair of gears in mesh
makes some sums of them zero. What is left over is the null space of these equations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bricksrl.plans.connections import Connection, Mesh
from bricksrl.plans.geometry import Floats
from bricksrl.plans.part import DeviceKind, Fit, Site
from bricksrl.plans.plan import Placed

RATE_LENGTH = 100.0
"""LDU; turning is counted as what a point moves so far from the axis, so that turning and moving are alike."""
_SMALL, _STILL = 1e-4, 1e-4
_SAME_AXIS = 1.5
MAX_BODIES = 250
"""More than these are not searched for motions."""
_LOOSE_REACH = 60.0
_STOP_LOW, _STOP_HIGH = -2.0, 9.0
"""How far a bush may be from a beam and still keep an axle from sliding: 3.6 mm of play."""


@dataclass(frozen=True)
class Joint:
    """Two bodies that turn, or also slide, against each other about one axis.

    Attributes:
        bodies: indices of the bodies.
        slides: whether nothing keeps them from sliding along the axis.
        motor: index of the motor whose shaft this is, ``None`` for others.
    """

    bodies: tuple[int, int]
    point: Floats
    axis: Floats
    slides: bool
    motor: int | None


@dataclass(frozen=True)
class Bodies:
    """The rigid bodies.

    Attributes:
        members: for each body, the parts in it; a motor's index is that of its case.
        rotors: for each body, the motors whose turning piece belongs to it.
        joints: between different bodies.
        meshes: pairs of bodies and the equation of their gears.
    """

    members: tuple[tuple[int, ...], ...]
    rotors: tuple[tuple[int, ...], ...]
    joints: tuple[Joint, ...]
    meshes: tuple[tuple[int, int, Mesh], ...]

    def body_of(self, part: int) -> int:
        """The body that holds a part, or a motor's case."""
        return next(number for number, members in enumerate(self.members) if part in members)

    def rotor_body(self, motor: int) -> int:
        """The body that holds what a motor turns."""
        return next(number for number, rotors in enumerate(self.rotors) if motor in rotors)

    def motions(self, *, locked: Iterable[int] = ()) -> Floats:
        """Motions that are left [6 x bodies, n], orthonormal, the first body at rest and the motors in ``locked`` braked."""
        rows = [_placed_row(np.eye(6), 0, None, len(self.members))]
        braked = set(locked)
        for joint in self.joints:
            block = _joint_rows(joint.point, joint.axis, slides=joint.slides, turns=joint.motor not in braked)
            rows.append(_placed_row(block, joint.bodies[0], joint.bodies[1], len(self.members)))
        for first, second, mesh in self.meshes:
            row = np.zeros((1, 6 * len(self.members)))
            scaled = np.concatenate([mesh.motion[:, :3], mesh.motion[:, 3:] / RATE_LENGTH], axis=1)
            row[0, 6 * first : 6 * first + 6] += scaled[0]
            row[0, 6 * second : 6 * second + 6] += scaled[1]
            rows.append(row)
        return _null_space(np.concatenate(rows))

    def rates(self, motor: int, motions: Floats) -> Floats:
        """How fast a motor's shaft turns against its case in each of the motions [n]."""
        joint = next(joint for joint in self.joints if joint.motor == motor)
        case, rotor = joint.bodies
        turning = motions[6 * rotor + 3 : 6 * rotor + 6] - motions[6 * case + 3 : 6 * case + 6]
        return np.asarray(joint.axis @ turning)


def _null_space(rows: Floats) -> Floats:
    """Orthonormal columns [m, n] that the equations [k, m] make zero."""
    sizes, directions = np.linalg.eigh(rows.T @ rows)
    return np.asarray(directions[:, sizes < _SMALL**2])


def _joint_rows(point: Floats, axis: Floats, *, slides: bool, turns: bool = True) -> Floats:
    """Equations [3..6, 6] of the difference of two bodies' rates."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    across = [first, np.cross(axis, first)]
    rows = [np.concatenate([way, np.cross(point, way) / RATE_LENGTH]) for way in (across if slides else [*across, axis])]
    rows += [np.concatenate([np.zeros(3), way]) for way in (across if turns else [*across, axis])]
    return np.array(rows)


def _placed_row(block: Floats, first: int, second: int | None, count: int) -> Floats:
    rows = np.zeros((len(block), 6 * count))
    rows[:, 6 * first : 6 * first + 6] = block
    if second is not None:
        rows[:, 6 * second : 6 * second + 6] -= block
    return rows


class _Groups:
    """Sets that grow together."""

    def __init__(self, count: int) -> None:
        self._above = list(range(count))

    def find(self, node: int) -> int:
        """The representative of a node's set."""
        while self._above[node] != node:
            self._above[node] = self._above[self._above[node]]
            node = self._above[node]
        return node

    def join(self, first: int, second: int) -> None:
        """Make two sets one."""
        self._above[self.find(first)] = self.find(second)


@dataclass(frozen=True)
class _Link:
    """A connection that works, between two nodes: a part, or the piece of a motor that turns, ``len(parts) + index``."""

    connection: Connection
    male: int
    female: int

    @property
    def is_axle(self) -> bool:
        """It may slide."""
        return self.connection.male_site.fit is Fit.AXLE


def find_bodies(parts: Sequence[Placed], found: Sequence[Connection], meshes: Sequence[Mesh]) -> Bodies:
    """The bodies of the parts: the heaviest one first, without parts that nothing connects to it.

    Two parts are one body where their connections leave no motion between them, then also where all others together leave none.
    """
    count = len(parts)
    links = [
        _Link(one, one.male + count * one.male_site.turns, one.female + count * one.female_site.turns)
        for one in found
        if one.fits and not one.is_crossed
    ]
    groups = _Groups(2 * count)
    for link in links:
        if link.connection.is_rigid:
            groups.join(link.male, link.female)
    _hold_fasteners(parts, links, groups)
    _hold_loose(parts, groups)
    while True:
        while _merge_rigid(links, groups):
            pass
        bodies, roots = _bodies(parts, links, meshes, groups)
        if len(roots) > MAX_BODIES or not _merge_still(bodies, roots, groups):
            return bodies


def _bodies(parts: Sequence[Placed], links: Sequence[_Link], meshes: Sequence[Mesh], groups: _Groups) -> tuple[Bodies, list[int]]:
    """The bodies as they are joined by now, and the representative of each."""
    count = len(parts)
    motors = [placed.index for placed in parts if any(site.turns for site in placed.part.sites)]
    roots = _ordered(parts, motors, links, groups)
    number_of = {root: number for number, root in enumerate(roots)}
    joints = []
    for motor in motors:
        if groups.find(motor) in number_of:
            point, axis = _shaft(parts[motor])
            pair = (number_of[groups.find(motor)], number_of[groups.find(motor + count)])
            joints.append(Joint(pair, point, axis, False, motor))
    slides = _sliding(parts, links, groups)
    for (first, second), bundles in _between(links, groups).items():
        if first in number_of and second in number_of:
            loose = frozenset((first, second)) in slides
            pair = (number_of[first], number_of[second])
            joints += [Joint(pair, *_line_of(bundle), bundle[0].is_axle and loose, None) for bundle in bundles]
    geared = [
        (number_of[groups.find(mesh.first)], number_of[groups.find(mesh.second)], mesh)
        for mesh in meshes
        if mesh.is_good and groups.find(mesh.first) in number_of and groups.find(mesh.second) in number_of
    ]
    members = tuple(tuple(part for part in range(count) if groups.find(part) == root) for root in roots)
    rotors = tuple(tuple(motor for motor in motors if groups.find(motor + count) == root) for root in roots)
    return Bodies(members, rotors, tuple(joints), tuple(geared)), roots


def _between(links: Sequence[_Link], groups: _Groups) -> dict[tuple[int, int], list[list[_Link]]]:
    """The connections between each two bodies, in bundles about one axis; those that cannot slide come first in theirs."""
    found: dict[tuple[int, int], list[list[_Link]]] = {}
    for link in sorted(links, key=lambda one: one.is_axle):
        first, second = groups.find(link.male), groups.find(link.female)
        if first == second:
            continue
        bundles = found.setdefault((min(first, second), max(first, second)), [])
        bundle = next((one for one in bundles if _is_coaxial(link.connection, one[0].connection)), None)
        if bundle is None:
            bundles.append([link])
        else:
            bundle.append(link)
    return found


def _line_of(bundle: Sequence[_Link]) -> tuple[Floats, Floats]:
    """Middle and direction of what connects two bodies about one axis; they depend on nothing but where the parts are."""
    axis = bundle[0].connection.axis
    axis = axis * np.sign(axis[int(np.argmax(np.abs(np.round(axis, 6))))])
    points = np.array([link.connection.point for link in bundle])
    along = points @ axis
    aside = points.mean(axis=0)
    return aside + axis * ((along.min() + along.max()) / 2 - float(aside @ axis)), axis


def _is_coaxial(one: Connection, other: Connection) -> bool:
    aside = np.linalg.norm(np.cross(other.point - one.point, one.axis))
    return bool(aside < _SAME_AXIS and np.linalg.norm(np.cross(one.axis, other.axis)) < 0.05)


def _shaft(placed: Placed) -> tuple[Floats, Floats]:
    """Where a motor's shaft is, and the direction in which it points out."""
    site = next(site for site in placed.part.sites if site.turns and site.fit is Fit.AXLE_HOLE)
    device = placed.part.device
    shaft = device.shaft if device is not None and device.kind is DeviceKind.MOTOR and device.shaft else site.axis
    return placed.to_plan(np.array([site.centre]))[0], placed.rotation @ np.array(shaft)


def _hold_fasteners(parts: Sequence[Placed], links: Sequence[_Link], groups: _Groups) -> None:
    """Join each pin, and each axle that nothing is fixed to, with a part that it goes through: its own turning is nothing."""
    fixed = {node for link in links if link.connection.is_rigid for node in (link.male, link.female)}
    for link in links:
        sites = parts[link.connection.male].part.sites
        is_alone = len({(site.centre[1], site.centre[2]) for site in sites}) == 1
        if is_alone and all(site.fit.is_male for site in sites) and link.male not in fixed:
            groups.join(link.male, link.female)
            fixed.add(link.male)


def _hold_loose(parts: Sequence[Placed], groups: _Groups) -> None:
    """Join what holds by something that is not modelled with the nearest part: a tyre with its rim, a sensor with its plate."""
    for placed in parts:
        others = [one for one in parts if one.index != placed.index and not one.part.is_loose]
        if placed.part.family == "tyres":
            others = [one for one in others if one.part.family == "wheels"]
        if placed.part.is_loose and others:
            nearest = min(others, key=lambda one: float(np.linalg.norm(one.position - placed.position)))
            if np.linalg.norm(nearest.position - placed.position) < _LOOSE_REACH:
                groups.join(placed.index, nearest.index)


def _merge_rigid(links: Sequence[_Link], groups: _Groups) -> bool:
    """Join bodies whose connections leave no motion between the two; whether there were any."""
    merged = False
    for pair, kept in _between(links, groups).items():
        if len(kept) < 2:
            continue
        middle, firsts = kept[0][0].connection.point, [bundle[0] for bundle in kept]
        blocks = [_joint_rows(one.connection.point - middle, one.connection.axis, slides=one.is_axle) for one in firsts]
        if not _null_space(np.concatenate(blocks)).size:
            groups.join(*pair)
            merged = True
    return merged


def _merge_still(bodies: Bodies, roots: Sequence[int], groups: _Groups) -> bool:
    """Join bodies that move alike in all motions; whether there were any."""
    motions = bodies.motions()
    merged = False
    for number, root in enumerate(roots):
        rates = motions[6 * number : 6 * number + 6]
        for other in range(number):
            if np.abs(motions[6 * other : 6 * other + 6] - rates).max(initial=0.0) < _STILL:
                groups.join(root, roots[other])
                merged = True
                break
    return merged


def _ordered(parts: Sequence[Placed], motors: Sequence[int], links: Sequence[_Link], groups: _Groups) -> list[int]:
    """Representatives of the bodies that hang together with the heaviest one, that one first."""
    count = len(parts)
    masses: dict[int, float] = defaultdict(float)
    for placed in parts:
        masses[groups.find(placed.index)] += placed.part.mass_g
    beside: dict[int, set[int]] = defaultdict(set)
    for first, second in [(link.male, link.female) for link in links] + [(motor, motor + count) for motor in motors]:
        beside[groups.find(first)].add(groups.find(second))
        beside[groups.find(second)].add(groups.find(first))
    start = max(masses, key=lambda root: masses[root])
    seen, waiting = {start}, [start]
    while waiting:
        for other in sorted(beside[waiting.pop(0)] - seen):
            seen.add(other)
            waiting.append(other)
    return [start, *sorted(seen - {start})]


def _sliding(parts: Sequence[Placed], links: Sequence[_Link], groups: _Groups) -> set[frozenset[int]]:
    """Pairs of bodies of which one can slide on the other's axle: no part that is fixed to the axle stops it both ways."""
    holders: dict[int, list[Connection]] = defaultdict(list)
    for link in links:
        if link.is_axle and groups.find(link.male) == groups.find(link.female):
            holders[link.male].append(link.connection)
    stops: dict[frozenset[int], list[int]] = defaultdict(lambda: [0, 0])
    for link in links:
        first, second, one = groups.find(link.male), groups.find(link.female), link.connection
        if not link.is_axle or first == second:
            continue
        ends = stops[frozenset((first, second))]
        # The two directions along parallel axles are the same two, whichever of the bodies has the axle.
        sign = float(np.sign(one.axis[int(np.argmax(np.abs(one.axis)))])) * (1 if first < second else -1)
        low, high = _span(parts[one.female], one.female_site, one)
        for fixed in holders[link.male]:
            start, end = _span(parts[fixed.female], fixed.female_site, one)
            ends[0 if sign > 0 else 1] += _STOP_LOW < start - high < _STOP_HIGH
            ends[1 if sign > 0 else 0] += _STOP_LOW < low - end < _STOP_HIGH
    return {pair for pair, ends in stops.items() if not all(ends)}


def _span(placed: Placed, site: Site, link: Connection) -> tuple[float, float]:
    """Where a hole begins and ends along an axle, from the middle of the connection."""
    middle = float((placed.to_plan(np.array([site.centre]))[0] - link.point) @ link.axis)
    return middle - site.length / 2, middle + site.length / 2
