"""Open gears: those whose turns no single motor decides, because a differential shares them or
several motors turn them.

Each of their meshes is a constraint on several joints of the articulation, where that of an
ordinary pair is a ratio of two.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bricktwin.plans.connections import Mesh, graph_of, reached
from bricktwin.plans.geometry import M_PER_LDU, Floats
from bricktwin.plans.mechanism.kinematics import TO_TWIN, Hinge, Mechanism, share_axis

_LEAST_SHARE = 0.005
"""Least share of a joint in a mesh, of the largest one. A worm has a fortieth; less is an error of
drawing."""
_RANK_TOLERANCE = 1e-4
"""Singular values of couplings below this are errors of drawing."""
_LEAST_TURN = 1e-3
"""Turns of a joint for a turn of a motor that count as none."""

OpenMesh = tuple[int, int, Mesh]
"""Two links, and the mesh of their gears."""


@dataclass(frozen=True, eq=False)
class OpenGears:
    """The open gears of a mechanism.

    Attributes:
        meshes: pairs of links with their gears that mesh.
        links: the links of these gears, and those that carry them.
    """

    meshes: tuple[OpenMesh, ...] = ()
    links: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Coupling:
    """A constraint on joints: the sum of their angles, each times its coefficient, stays as it is.

    Attributes:
        coefficients: of joints, by the bodies that they turn; the largest is 1 or -1.
    """

    coefficients: tuple[tuple[int, float], ...]


def open_gears(mechanism: Mechanism) -> OpenGears:
    """The open gears of a mechanism: of each group of links whose gears mesh, all or none."""
    root = mechanism.fixed or 0
    ways = _ways(mechanism.hinges, root)
    edges: list[tuple[int, int]] = []
    planetary: set[int] = set()
    meshes = [row for row in mechanism.meshes if row[0] != row[1]]
    geared = {link for first, second, _ in meshes for link in (first, second)}
    for first, second, mesh in meshes:
        if first not in ways or second not in ways:
            continue
        # The root turns nothing, so gears that mesh with it are no group.
        if root not in (first, second):
            edges.append((first, second))
        carriers = _carriers(mechanism.hinges, mesh, ways[first], ways[second], geared)
        if carriers:
            # What carries a gear that rolls around another one is geared with both.
            members = {first, second, *carriers} - {root}
            edges += pairwise(sorted(members))
            planetary.update(members)
    neighbours = graph_of(edges)
    rotors: set[int] = set()
    for hinge in mechanism.hinges:
        if hinge.port is not None:
            rotors.add(hinge.child if hinge.turns_child else hinge.parent)
    links: set[int] = set()
    for link in neighbours:
        group = reached([link], neighbours)
        if group & planetary or len(group & rotors) > 1:
            links |= group
    # One of the two may be the root, which is in no group.
    found = [row for row in meshes if links & {row[0], row[1]}]
    return OpenGears(tuple(found), frozenset(links))


def _ways(hinges: Sequence[Hinge], root: int) -> dict[int, tuple[int, ...]]:
    """Hinges on the way from the root to each link, by the fewest."""
    hinges_of: dict[int, list[int]] = defaultdict(list)
    for number, hinge in enumerate(hinges):
        hinges_of[hinge.parent].append(number)
        hinges_of[hinge.child].append(number)
    ways: dict[int, tuple[int, ...]] = {root: ()}
    queue = [root]
    while queue:
        link = queue.pop(0)
        for number in hinges_of[link]:
            hinge = hinges[number]
            other = hinge.child if hinge.parent == link else hinge.parent
            if other not in ways:
                ways[other] = (*ways[link], number)
                queue.append(other)
    return ways


def _carriers(
    hinges: Sequence[Hinge],
    mesh: Mesh,
    way: Sequence[int],
    other_way: Sequence[int],
    geared: set[int],
) -> set[int]:
    """The links on the ways to two gears, if one of these rolls around the other; else none."""
    count = 0
    carriers: set[int] = set()
    for row, numbers in zip(mesh.motion, _apart(way, other_way), strict=True):
        turning = [hinges[number] for number in numbers]
        # No twin of ours rolls a gear on what hangs on a ball.
        if any(hinge.is_ball for hinge in turning):
            return set()
        turning = [hinge for hinge in turning if abs(row @ _twist(hinge)) > _LEAST_TURN]
        count += len(turning)
        for carried, hinge in pairwise(reversed(turning)):
            # A gear that is loose on a loose axle has two joints about one axis, which count as
            # one: no other gear depends on the axle.
            ends = {hinge.parent, hinge.child}
            between = ends & {carried.parent, carried.child}
            if not between & geared and share_axis(hinge, carried):
                count -= 1
        for hinge in turning:
            carriers |= {hinge.parent, hinge.child}
    # Of an ordinary pair, each gear turns on what both are on.
    return carriers if count > 2 else set()


def _apart(way: Sequence[int], other_way: Sequence[int]) -> tuple[list[int], list[int]]:
    """What is on one of two ways only: what both have in common moves no gear against another."""
    first = [number for number in way if number not in other_way]
    second = [number for number in other_way if number not in way]
    return first, second


def _twist(hinge: Hinge) -> Floats:
    """Rates [6] of what a hinge turns about its axis, in a plan's frame and LDU: linear at the
    plan's origin, then angular."""
    axis = TO_TWIN.T @ hinge.axis
    point = TO_TWIN.T @ hinge.point_m / M_PER_LDU
    return np.concatenate([np.cross(point, axis), axis])


def couplings_of(
    joints: Sequence[Hinge],
    meshes: Iterable[OpenMesh],
    body_of: Mapping[int, int],
) -> tuple[Coupling, ...]:
    """The couplings that open meshes are for the joints of a tree, of which each turns the body
    that is its child.

    Args:
        body_of: the body of each link; meshes of links without one are left out.
    """
    joint_of = {joint.child: joint for joint in joints}
    couplings: list[Coupling] = []
    for first, second, mesh in meshes:
        if first not in body_of or second not in body_of:
            continue
        way = way_to(joint_of, body_of[first])
        other_way = way_to(joint_of, body_of[second])
        coefficients: dict[int, float] = {}
        for row, bodies in zip(mesh.motion, _apart(way, other_way), strict=True):
            for body in bodies:
                coefficients[body] = float(row @ _twist(joint_of[body]))
        largest = max(map(abs, coefficients.values()), default=0.0)
        has_ball = any(joint_of[body].is_ball for body in coefficients)
        if has_ball or largest == 0.0:
            continue
        turned: list[tuple[int, float]] = []
        for body, coefficient in coefficients.items():
            share = round(coefficient / largest, 6)
            if abs(share) > _LEAST_SHARE:
                turned.append((body, share))
        couplings.append(Coupling(tuple(turned)))
    return tuple(couplings)


def way_to(joint_of: Mapping[int, Hinge], body: int) -> list[int]:
    """The bodies whose joints move a body of a tree: itself and all that carry it but the root."""
    way: list[int] = []
    while body in joint_of:
        way.append(body)
        body = joint_of[body].parent
    return way


def turns_with(couplings: Sequence[Coupling], body: int) -> dict[int, float]:
    """Turns of joints, by their bodies, when that of one body turns once: the least ones that the
    couplings allow. Empty for a joint that no coupling has, or that they lock."""
    bodies, slopes = _slopes(couplings)
    if body not in bodies:
        return {}
    column = bodies.index(body)
    own = slopes[:, column]
    others = np.delete(slopes, column, axis=1)
    # Least squares give the shortest solution where there are several.
    turns = np.linalg.lstsq(others, -own, rcond=_RANK_TOLERANCE)[0]
    left_over = others @ turns + own
    if np.abs(left_over).max() > _LEAST_TURN:
        return {}
    del bodies[column]
    found = zip(bodies, turns.tolist(), strict=True)
    return {other: turn for other, turn in found if abs(turn) > _LEAST_TURN}


def turn_with(
    couplings: Sequence[Coupling],
    joints: Sequence[Hinge],
    body: int,
    other: int,
) -> Floats:
    """Turn [3] of another body about the axes of the twin when the joint of one body turns once."""
    joint_of = {joint.child: joint for joint in joints}
    turns = {**turns_with(couplings, body), body: 1.0}
    turn = np.zeros(3)
    for carrier in way_to(joint_of, other):
        turn += turns.get(carrier, 0.0) * joint_of[carrier].axis
    return turn


def free_among(couplings: Sequence[Coupling], bodies: Iterable[int]) -> list[int]:
    """Those of some bodies whose joints can be turned as one likes: any other turns with those
    before it."""
    coupled, slopes = _slopes(couplings)
    # The last rows of a full decomposition, beyond the rank, are the possible motions.
    _, sizes, rows = np.linalg.svd(slopes)
    rank = int(np.count_nonzero(sizes > _RANK_TOLERANCE))
    motions = rows[rank:].T  # [joints, n]
    free: list[int] = []
    chosen: list[Floats] = []
    for body in bodies:
        if body in coupled:
            row = motions[coupled.index(body)]
            rows_so_far = np.array([*chosen, row])
            if np.linalg.matrix_rank(rows_so_far, tol=_LEAST_TURN) == len(chosen):
                continue
            chosen.append(row)
        free.append(body)
    return free


def _slopes(couplings: Sequence[Coupling]) -> tuple[list[int], Floats]:
    """The bodies of couplings, and the coefficients [couplings, bodies]."""
    bodies = sorted({body for coupling in couplings for body, _ in coupling.coefficients})
    slopes = np.zeros((len(couplings), len(bodies)))
    for row, coupling in enumerate(couplings):
        for body, coefficient in coupling.coefficients:
            slopes[row, bodies.index(body)] = coefficient
    return bodies, slopes
