"""Rigid bodies of a plan, the joints between them and their possible motions. LDraw units, plan
frame.

A motion is six rates per body (linear at the plan's origin, angular). Each joint and each gear mesh
is a linear constraint on the rates; the motions are the null space.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bricktwin.plans.connections import Connection, Mesh, reached
from bricktwin.plans.geometry import Floats, lines_coincide
from bricktwin.plans.part import Fit, Site
from bricktwin.plans.plan import Placed

RATE_LENGTH = 100.0
"""Length by which angular rates are scaled (LDU), so that they have the same magnitude as linear
ones."""
_RANK_TOLERANCE = 1e-4
"""Singular values of constraints below this count as 0."""
_MOTION_TOLERANCE = 1e-4
"""Difference of rates up to which two bodies move alike."""
_AXIS_TOLERANCE = 1.5
"""Largest distance of two lines that count as one axis, LDU."""
MAX_BODIES = 250
"""Largest number of bodies for which motions are computed."""
_MAX_LOOSE_DISTANCE = 60.0
"""Largest distance between the origins of a part with unmodelled connections and of the part that
holds it, LDU."""
# An axle counts as stopped between these distances of bush and beam (LDU), because real stops leave
# up to 3.6 mm of play.
_STOP_LOW = -2.0
_STOP_HIGH = 9.0


@dataclass(frozen=True)
class BodyJoint:
    """A hinge between two bodies, which may also slide along its axis, or a ball joint.

    Attributes:
        bodies: indices of the bodies.
        motor: index of the motor whose shaft this is, or ``None``.
    """

    bodies: tuple[int, int]
    point: Floats
    axis: Floats
    slides: bool
    motor: int | None
    is_ball: bool = False

    def rates(
        self,
        motions: Floats,
        parent: int | None = None,
    ) -> Floats:
        """Angular rate of the second body relative to the first in each motion [n], or reversed:
        relative to the body ``parent``. A motor's case that turns about its shaft is the shaft
        turning about the reversed axis."""
        first, second = self.bodies
        if parent is not None and parent != first:
            first, second = second, first
        is_reversed = first != self.bodies[0]
        sign = -1.0 if self.motor is not None and is_reversed else 1.0
        # The angular rates are the last three of a body's six rows, and only they show a turn.
        first_rates = motions[6 * first + 3 : 6 * first + 6]
        second_rates = motions[6 * second + 3 : 6 * second + 6]
        return np.asarray(sign * self.axis @ (second_rates - first_rates))


@dataclass(frozen=True)
class Bodies:
    """Rigid bodies.

    Attributes:
        members: parts of each body; a motor's case counts as the motor.
        rotors: motors whose rotor belongs to each body.
        meshes: pairs of bodies with their gear mesh.
    """

    members: tuple[tuple[int, ...], ...]
    rotors: tuple[tuple[int, ...], ...]
    joints: tuple[BodyJoint, ...]
    meshes: tuple[tuple[int, int, Mesh], ...]

    def motions(self, *, locked: Iterable[int] = ()) -> Floats:
        """Possible motions [6 x bodies, n], orthonormal; the first body is at rest, the motors in
        ``locked`` are braked."""
        count = len(self.members)
        braked = set(locked)
        rows = [_rows(count, (0, np.eye(6)))]
        for joint in self.joints:
            can_turn = joint.motor not in braked
            block = _joint_rows(
                joint.point,
                joint.axis,
                slides=joint.slides,
                turns=can_turn,
                is_ball=joint.is_ball,
            )
            rows.append(_rows(count, (joint.bodies[0], block), (joint.bodies[1], -block)))
        # A rod between two balls may spin about itself. Without this row, its spin would count as a
        # motion of the mechanism.
        for body, axis in self._free_spins():
            spin = np.concatenate([np.zeros(3), axis])[None]
            rows.append(_rows(count, (body, spin)))
        for first, second, mesh in self.meshes:
            linear = mesh.motion[:, :3]
            angular = mesh.motion[:, 3:] / RATE_LENGTH
            scaled = np.concatenate([linear, angular], axis=1)  # [2, 6]
            rows.append(_rows(count, (first, scaled[:1]), (second, scaled[1:])))
        return _null_space(np.concatenate(rows))

    def _free_spins(self) -> Iterator[tuple[int, Floats]]:
        """Bodies between two ball joints, and the axis of their free spin, which moves nothing
        else."""
        for body in range(1, len(self.members)):
            joints = [joint for joint in self.joints if body in joint.bodies]
            if len(joints) != 2 or not all(joint.is_ball for joint in joints):
                continue
            if any(body in (first, second) for first, second, _ in self.meshes):
                continue
            axis = joints[1].point - joints[0].point
            length = np.linalg.norm(axis)
            # Two balls in one place leave every direction free, so there is no single axis to
            # block.
            if length > _AXIS_TOLERANCE:
                yield body, axis / length


def _null_space(rows: Floats) -> Floats:
    """Orthonormal basis [m, n] of the null space of ``rows`` [k, m]."""
    # The eigenvalues of rows.T @ rows are the squares of the singular values of rows. This product
    # stays small however many constraints there are, which a singular value decomposition would
    # not.
    eigenvalues, eigenvectors = np.linalg.eigh(rows.T @ rows)
    return np.asarray(eigenvectors[:, eigenvalues < _RANK_TOLERANCE**2])


def _joint_rows(
    point: Floats,
    axis: Floats,
    *,
    slides: bool,
    turns: bool = True,
    is_ball: bool = False,
) -> Floats:
    """Constraints [3..6, 6] on the difference of two bodies' rates."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    normals = [first, np.cross(axis, first)]
    # The common point may not move across the axis, and along it only if the joint slides.
    blocked = normals if slides else [*normals, axis]
    rows = [
        np.concatenate([direction, np.cross(point, direction) / RATE_LENGTH])
        for direction in blocked
    ]
    if is_ball:
        return np.array(rows)
    # The body may not turn across the axis, and about it only if the joint is not braked.
    fixed = normals if turns else [*normals, axis]
    rows += [np.concatenate([np.zeros(3), direction]) for direction in fixed]
    return np.array(rows)


def _rows(count: int, *blocks: tuple[int, Floats]) -> Floats:
    """Constraints [n, 6 x count] on the rates of so many bodies from blocks [n, 6] for some of
    them."""
    rows = np.zeros((len(blocks[0][1]), 6 * count))
    for body, block in blocks:
        rows[:, 6 * body : 6 * body + 6] += block
    return rows


_Groups = NDArray[np.intp]
"""Disjoint sets of nodes: the representative of each."""


def _join(
    groups: _Groups,
    first: int,
    second: int,
) -> None:
    """Merge the sets of two nodes."""
    groups[groups == groups[first]] = groups[second]


class _Link(NamedTuple):
    """A connection between two nodes: a part, or the rotor of a motor, ``len(parts) + index``."""

    connection: Connection
    male: int
    female: int


def find_bodies(
    parts: Sequence[Placed],
    connections: Sequence[Connection],
    meshes: Sequence[Mesh],
) -> Bodies:
    """The bodies of the parts, the heaviest first; bodies that are not connected to it are left
    out.

    Parts are one body if their connections leave no relative motion, first in pairs, then in the
    whole mechanism.
    """
    count = len(parts)
    links = []
    for connection in connections:
        # Two parts that cannot be put together do not hold each other.
        if not connection.fits or connection.is_crossed:
            continue
        # A rotor has the number of its motor plus `count`: what is in the shaft turns with the
        # rotor, not with the case.
        male = connection.male + count * connection.male_site.turns
        female = connection.female + count * connection.female_site.turns
        links.append(_Link(connection, male, female))
    groups = np.arange(2 * count)
    for link in links:
        if link.connection.is_rigid:
            _join(groups, link.male, link.female)
    _join_fasteners(parts, links, groups)
    _join_loose(parts, groups)
    # Joining bodies may remove an axis between them, or enclose a third body, so this is repeated
    # until nothing changes.
    while True:
        while _merge_rigid(links, groups):
            pass
        bodies, roots = _bodies(parts, links, meshes, groups)
        if len(roots) > MAX_BODIES or not _merge_equal_motions(bodies, roots, groups):
            return bodies


def _bodies(
    parts: Sequence[Placed],
    links: Sequence[_Link],
    meshes: Sequence[Mesh],
    groups: _Groups,
) -> tuple[Bodies, list[int]]:
    """The current bodies and the representative of each."""
    count = len(parts)
    motors = [placed.index for placed in parts if any(site.turns for site in placed.part.sites)]
    roots = _ordered(parts, motors, links, groups)
    number_of = {root: number for number, root in enumerate(roots)}
    joints = []
    for motor in motors:
        # A motor that is not connected to the heaviest body is no part of the mechanism.
        if groups[motor] not in number_of:
            continue
        placed = parts[motor]
        shaft = next(site for site in placed.part.sites if site.turns and site.fit is Fit.AXLE_HOLE)
        pair = (number_of[groups[motor]], number_of[groups[motor + count]])
        axis = placed.rotation @ np.array(placed.electric.direction)
        joints.append(
            BodyJoint(
                pair,
                placed.point(shaft.centre),
                axis,
                False,
                motor,
            )
        )
    sliding = _sliding(parts, links, groups)
    for (first, second), bundles in _bundles(links, groups).items():
        if first not in number_of or second not in number_of:
            continue
        can_slide = frozenset((first, second)) in sliding
        pair = (number_of[first], number_of[second])
        for bundle in bundles:
            # Bundles begin with a connection that cannot slide, if they have any.
            connection = bundle[0].connection
            point, axis = _line_of(bundle)
            slides = connection.is_axle and can_slide
            joints.append(
                BodyJoint(
                    pair,
                    point,
                    axis,
                    slides,
                    None,
                    connection.is_ball,
                )
            )
    # Teeth that nearly mesh turn nothing here; `check` reports them to the author.
    geared_bodies = []
    for mesh in meshes:
        first = groups[mesh.first]
        second = groups[mesh.second]
        if mesh.is_good and first in number_of and second in number_of:
            geared_bodies.append((number_of[first], number_of[second], mesh))
    members: list[tuple[int, ...]] = []
    rotors: list[tuple[int, ...]] = []
    for root in roots:
        members.append(tuple(part for part in range(count) if groups[part] == root))
        # Rotors are numbered after all parts (see `_Link`).
        rotors.append(tuple(motor for motor in motors if groups[motor + count] == root))
    bodies = Bodies(
        tuple(members),
        tuple(rotors),
        tuple(joints),
        tuple(geared_bodies),
    )
    return bodies, roots


def _bundles(links: Sequence[_Link], groups: _Groups) -> dict[tuple[int, int], list[list[_Link]]]:
    """The connections between each pair of bodies, grouped by axis; in each group those that cannot
    slide come first."""
    bundles_of: dict[tuple[int, int], list[list[_Link]]] = {}
    for link in sorted(links, key=lambda link: link.connection.is_axle):
        first = groups[link.male]
        second = groups[link.female]
        if first == second:
            continue
        bundles = bundles_of.setdefault((min(first, second), max(first, second)), [])
        for bundle in bundles:
            if _is_coaxial(link.connection, bundle[0].connection):
                bundle.append(link)
                break
        else:
            bundles.append([link])
    return bundles_of


def _line_of(bundle: Sequence[_Link]) -> tuple[Floats, Floats]:
    """Midpoint and direction of coaxial connections; independent of their order."""
    axis = bundle[0].connection.axis
    # The largest component is made positive, so that an axis and its reverse are one line. Rounding
    # keeps the last digit from deciding between components that are equal.
    largest = int(np.argmax(np.abs(np.round(axis, 6))))
    axis = axis * np.sign(axis[largest])
    points = np.array([link.connection.point for link in bundle])  # [n, 3]
    along = points @ axis  # [n]
    middle = (along.min() + along.max()) / 2
    mean = points.mean(axis=0)
    # The mean of the points averages their errors across the axis, but along it the middle of both
    # ends counts.
    to_middle = middle - float(mean @ axis)
    return mean + axis * to_middle, axis


def _is_coaxial(first: Connection, second: Connection) -> bool:
    # A ball joint has a point but no axis, so nothing can be coaxial with it.
    is_ball = first.is_ball or second.is_ball
    return not is_ball and lines_coincide(
        first.point,
        first.axis,
        second.point,
        second.axis,
        offset=_AXIS_TOLERANCE,
        sine=0.05,
    )


def _join_fasteners(
    parts: Sequence[Placed],
    links: Sequence[_Link],
    groups: _Groups,
) -> None:
    """Join each pin, and each axle or bush with a pin to which nothing is fixed, to a part around
    it: it may spin."""
    fixed: set[int] = set()
    for link in links:
        if link.connection.is_rigid:
            fixed.update((link.male, link.female))
    for link in links:
        sites = parts[link.connection.male].part.sites
        # All sites of a fastener, for example of a pin, are on one line. A beam with a pin on it
        # has sites elsewhere too.
        lines = {(site.axis, site.centre[1], site.centre[2]) for site in sites}
        is_fastener = len(lines) == 1
        if is_fastener and link.male not in fixed and not link.connection.is_ball:
            _join(groups, link.male, link.female)
            fixed.add(link.male)


def _join_loose(parts: Sequence[Placed], groups: _Groups) -> None:
    """Join parts with unmodelled connections to the nearest part, such as a tyre to its rim."""
    held_parts = [placed for placed in parts if not placed.part.is_loose]
    for placed in parts:
        if not placed.part.is_loose:
            continue
        others = held_parts
        if placed.part.family == "tyres":
            others = [other for other in others if other.part.family == "wheels"]
        # The links of a chain are drawn at rest while its gears turn, so a chain is held by what
        # holds still.
        is_chain = placed.part.family == "chains"
        if is_chain:
            others = [other for other in others if other.part.family in ("beams", "hubs", "motors")]
        if not others:
            continue
        distances = [float(np.linalg.norm(other.position - placed.position)) for other in others]
        nearest = others[distances.index(min(distances))]
        if is_chain or min(distances) < _MAX_LOOSE_DISTANCE:
            _join(groups, placed.index, nearest.index)


def _merge_rigid(links: Sequence[_Link], groups: _Groups) -> bool:
    """Join pairs of bodies without relative motion. Returns whether there were any."""
    merged = False
    for pair, bundles in _bundles(links, groups).items():
        if len(bundles) < 2:
            continue
        # Bodies with a single common axis can turn about it, so only pairs with two axes are
        # tested.
        connections = [bundle[0].connection for bundle in bundles]
        # Points are taken relative to the first one: far from the origin, large numbers would blur
        # the rank.
        origin = connections[0].point
        blocks = [
            _joint_rows(
                link.point - origin,
                link.axis,
                slides=link.is_axle,
                is_ball=link.is_ball,
            )
            for link in connections
        ]
        if not _null_space(np.concatenate(blocks)).size:
            _join(groups, *pair)
            merged = True
    return merged


def _merge_equal_motions(
    bodies: Bodies,
    roots: Sequence[int],
    groups: _Groups,
) -> bool:
    """Join bodies with equal rates in all motions. Returns whether there were any."""
    motions = bodies.motions()  # [6 x bodies, n]
    merged = False
    for number, root in enumerate(roots):
        rates = motions[6 * number : 6 * number + 6]
        for other in range(number):
            other_rates = motions[6 * other : 6 * other + 6]
            # `initial` covers a mechanism without motions, in which every body is at rest.
            difference = np.abs(other_rates - rates).max(initial=0.0)
            if difference < _MOTION_TOLERANCE:
                _join(groups, root, roots[other])
                merged = True
                break
    return merged


def _ordered(
    parts: Sequence[Placed],
    motors: Sequence[int],
    links: Sequence[_Link],
    groups: _Groups,
) -> list[int]:
    """Representatives of the bodies connected to the heaviest one, which comes first."""
    count = len(parts)
    masses: dict[int, float] = defaultdict(float)
    for placed in parts:
        masses[groups[placed.index]] += placed.part.mass_g
    neighbours: dict[int, set[int]] = defaultdict(set)
    # A motor's case holds its rotor, although no connection says so.
    pairs = [(link.male, link.female) for link in links]
    pairs += [(motor, motor + count) for motor in motors]
    for first, second in pairs:
        neighbours[groups[first]].add(groups[second])
        neighbours[groups[second]].add(groups[first])
    start = max(masses, key=lambda root: masses[root])
    return [start, *sorted(reached([start], neighbours) - {start})]


def _sliding(
    parts: Sequence[Placed],
    links: Sequence[_Link],
    groups: _Groups,
) -> set[frozenset[int]]:
    """Pairs of bodies that slide along a common axle: no part fixed to the axle stops them in both
    directions."""
    fixed_to: dict[int, list[Connection]] = defaultdict(list)
    for link in links:
        if link.connection.is_axle and groups[link.male] == groups[link.female]:
            fixed_to[link.male].append(link.connection)
    # A joint slides unless it is stopped in both directions, so stops are counted for each of them.
    stops: dict[frozenset[int], list[int]] = defaultdict(lambda: [0, 0])
    for link in links:
        first = groups[link.male]
        second = groups[link.female]
        connection = link.connection
        if not connection.is_axle or first == second:
            continue
        ends = stops[frozenset((first, second))]
        # Axles of both bodies may point either way. The sign of the largest component gives them
        # one common direction.
        largest = int(np.argmax(np.abs(connection.axis)))
        order = 1 if first < second else -1
        is_forward = float(np.sign(connection.axis[largest])) * order > 0
        ahead, behind = (0, 1) if is_forward else (1, 0)
        low, high = _span(parts[connection.female], connection.female_site, connection)
        for fixed in fixed_to[link.male]:
            start, end = _span(parts[fixed.female], fixed.female_site, connection)
            ends[ahead] += _STOP_LOW < start - high < _STOP_HIGH
            ends[behind] += _STOP_LOW < low - end < _STOP_HIGH
    return {pair for pair, ends in stops.items() if not all(ends)}


def _span(
    placed: Placed,
    site: Site,
    link: Connection,
) -> tuple[float, float]:
    """Ends of a hole along an axle, from the middle of the connection."""
    middle = float((placed.point(site.centre) - link.point) @ link.axis)
    return middle - site.length / 2, middle + site.length / 2
