"""Connections between parts: pins and axles in holes, studs, tyres on rims, turntables, ball
joints, meshing gears, chains.

LDraw units, plan frame.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from bricktwin.plans.geometry import AXES, Floats
from bricktwin.plans.part import Fit, Gear, GearForm, Site
from bricktwin.plans.plan import Placed

_MAX_OFFSET = 1.2
_MAX_TILT = 0.03
"""Tolerances of a pin: offset from the hole's axis (LDU), tilt (sine)."""
_MAX_LOOSE_OFFSET = 2.5
_MAX_LOOSE_TILT = 0.1
"""The same where it only has room: real parts give way."""
_MIN_DEPTH = 3.5
"""Minimum depth of a connection, LDU; a stud is 4 high."""
_MIN_SEATED_SHARE = 0.7
"""Minimum depth as a share of the shorter length."""
_MESH_TOLERANCE = 1.0
_NEAR_TOLERANCE = 9.0
"""Tolerances of two gears' distance, LDU: up to the first they mesh; above the second they are
unrelated."""
_MAX_COMPARED = 20_000
"""Maximum number of gear pairs to compare."""
_CROSS_DEG = 6.0
_WORM_PITCH_RADIUS = 10.0
_TOOTH = 7.854
"""Length of a tooth, pi mm: lead of a worm, pitch of a rack."""
_LINK = 16.0
_LINK_TOLERANCE = 1.5
"""Length of a chain's link, along its z axis: two teeth. Its largest offset from a gear. From the
previous link it may be half of its length away: LSynth fills a straight part with whole links."""
_BARS = (Fit.PIN, Fit.FRICTION_PIN, Fit.AXLE, Fit.PEG)
_JOINTS = (Fit.TURNTABLE, Fit.BALL, Fit.SOCKET, Fit.RIM, Fit.TYRE)
_SEAT_PLAY = 4.0
"""Tolerance of a tyre, LDU: of its place and of its diameter."""
_RIGID = ((Fit.AXLE, Fit.AXLE_HOLE), (Fit.STUD, Fit.STUD_HOLE), (Fit.RIM, Fit.TYRE))
_Placed = tuple[int, Site, Floats, Floats]
"""A site: index of its part, centre, direction."""


@dataclass(frozen=True)
class Connection:
    """A pin or an axle in a hole, the two halves of a turntable, or a ball in its socket.

    Attributes:
        male, female: indices of the parts.
        male_site, female_site: in their parts' frames.
        point: middle of the overlap [3].
        axis: direction [3] of the male site.
        depth: length of the overlap.
        is_seated: whether it is deep enough.
        is_crossed: whether the axle is misaligned with its hole, so that it cannot go in.
    """

    male: int
    female: int
    male_site: Site
    female_site: Site
    point: Floats
    axis: Floats
    depth: float
    is_seated: bool
    is_crossed: bool

    @property
    def fits(self) -> bool:
        """Whether it is possible; a pin does not fit into an axle hole."""
        return not (
            self.male_site.fit in (Fit.PIN, Fit.FRICTION_PIN)
            and self.female_site.fit is Fit.AXLE_HOLE
        )

    @property
    def is_axle(self) -> bool:
        """Whether it is an axle in a hole."""
        return self.male_site.fit is Fit.AXLE

    @property
    def is_ball(self) -> bool:
        """Whether it is a ball joint."""
        return self.male_site.fit is Fit.BALL

    @property
    def is_rigid(self) -> bool:
        """Whether it has no freedom: an axle in an axle hole, a stud (also a single one), or a
        tyre."""
        return (self.male_site.fit, self.female_site.fit) in _RIGID


@dataclass(frozen=True)
class Mesh:
    """Two gears that mesh, or nearly mesh.

    Attributes:
        first, second: indices of the parts.
        gears: their gears.
        error: distance minus the correct distance, LDU.
        engaged: overlap as a share of the narrower gear's width, 0..1.
        point: contact point [3].
        motion: [2, 6], constraint on the rates (linear at the plan's origin, angular) of both: the
            products add to 0.
    """

    first: int
    second: int
    gears: tuple[Gear, Gear]
    error: float
    engaged: float
    point: Floats
    motion: Floats

    @property
    def is_good(self) -> bool:
        """Whether they turn each other."""
        return abs(self.error) <= _MESH_TOLERANCE and self.engaged >= _MIN_SEATED_SHARE


def graph_of(pairs: Iterable[tuple[int, int]]) -> dict[int, list[int]]:
    """The neighbours of each node of a graph with these edges."""
    graph: dict[int, list[int]] = defaultdict(list)
    for node, other in pairs:
        graph[node].append(other)
        graph[other].append(node)
    return graph


def neighbours(
    connections: Iterable[Connection], groups: Sequence[frozenset[int]] = ()
) -> dict[int, list[int]]:
    """The connected parts of each part. Groups may be held together by something unknown: a node
    -1, -2, ... each."""
    pairs = [(link.male, link.female) for link in connections]
    return graph_of(
        [*pairs, *((-1 - number, part) for number, group in enumerate(groups) for part in group)]
    )


def reached(starts: Iterable[int], graph: Mapping[int, Iterable[int]]) -> set[int]:
    """All nodes of a graph that are connected to one of ``starts``, and these."""
    found = set(starts)
    waiting = list(found)
    while waiting:
        unseen = set(graph[waiting.pop()]) - found
        found |= unseen
        waiting += unseen
    return found


def connections(parts: Sequence[Placed]) -> list[Connection]:
    """All pins and axles in holes, studs, tyres on rims, turntables and ball joints."""
    males: list[_Placed] = []
    females: list[_Placed] = []
    joints: list[_Placed] = []
    for placed in parts:
        for site in placed.part.sites:
            entry = (
                placed.index,
                site,
                placed.point(site.centre),
                placed.rotation @ np.array(site.axis),
            )
            (joints if site.fit in _JOINTS else males if site.fit.is_male else females).append(
                entry
            )
    result = _coinciding(joints)
    if not females:
        return result
    females.sort(key=lambda entry: float(entry[2][0]))
    owners = np.array([entry[0] for entry in females])
    centres = np.array([entry[2] for entry in females])
    axes = np.array([entry[3] for entry in females])
    lengths = np.array([entry[1].length for entry in females])
    is_for_stud = np.array([entry[1].fit is Fit.STUD_HOLE for entry in females])
    for owner, site, centre, axis in males:
        reach = (site.length + float(lengths.max())) / 2 + _MAX_OFFSET
        start, end = np.searchsorted(centres[:, 0], [centre[0] - reach, centre[0] + reach])
        nearby = slice(int(start), int(end))
        offset = centres[nearby] - centre
        along = offset @ axis
        across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        tilt = np.linalg.norm(np.cross(axes[nearby], axis), axis=1)
        low = np.maximum(-site.length / 2, along - lengths[nearby] / 2)
        high = np.minimum(site.length / 2, along + lengths[nearby] / 2)
        fitting = (
            (across < _MAX_OFFSET)
            & (tilt < _MAX_TILT)
            & (high - low > _MIN_DEPTH)
            & (owners[nearby] != owner)
        )
        fitting &= is_for_stud[nearby] == (site.fit is Fit.STUD)
        for index in np.flatnonzero(fitting):
            depth = float(high[index] - low[index])
            other = females[int(start) + index][0]
            hole = females[int(start) + index][1]
            is_seated = depth >= _MIN_SEATED_SHARE * min(20.0, site.length, hole.length)
            is_crossed = _is_crossed(parts[owner], site, parts[other], hole)
            point = centre + axis * float(low[index] + high[index]) / 2
            result.append(
                Connection(owner, other, site, hole, point, axis, depth, is_seated, is_crossed)
            )
    return result


def open_holes(male: Placed, shift: Floats, female: Placed) -> list[Site]:
    """The holes of a part into which a pin or an axle of another one fits that is moved by
    ``shift`` [3], however deep."""
    bars = [site for site in male.part.sites if site.fit in _BARS]
    holes = female.part.holes
    if not bars or not holes:
        return []
    points = female.to_part(male.to_plan(np.array([site.centre for site in bars])) + shift)
    axes = np.array([site.axis for site in bars]) @ male.rotation.T @ female.rotation
    offsets = np.array([site.centre for site in holes])[:, None] - points
    across = np.linalg.norm(np.cross(offsets, axes), axis=2)
    tilts = np.linalg.norm(np.cross(np.array([site.axis for site in holes])[:, None], axes), axis=2)
    fitting = ((across < _MAX_LOOSE_OFFSET) & (tilts < _MAX_LOOSE_TILT)).any(axis=1)
    return [site for site, fits in zip(holes, fitting, strict=True) if fits]


def _is_crossed(axle: Placed, site: Site, holder: Placed, hole: Site) -> bool:
    """Whether an axle's cross is misaligned with that of its hole; a motor turns its shaft to
    fit."""
    if site.fit is not Fit.AXLE or hole.fit is not Fit.AXLE_HOLE or hole.turns:
        return False
    first = axle.rotation @ _arm(site)
    second = holder.rotation @ _arm(hole)
    angle = np.degrees(np.arccos(np.clip(abs(float(first @ second)), 0.0, 1.0)))
    return bool(min(angle, 90 - angle) > _CROSS_DEG)


def _arm(site: Site) -> Floats:
    """One direction of the cross in the part's frame."""
    return np.array(site.arm or (AXES["x"] if abs(site.axis[0]) < 0.5 else AXES["y"]))


def _coinciding(joints: list[_Placed]) -> list[Connection]:
    """Halves of a turntable, balls in sockets, tyres on rims."""
    result = []
    for owner, site, centre, axis in joints:
        for other, hole, centre2, direction in joints:
            distance = np.linalg.norm(centre2 - centre)
            pair = (site.fit, hole.fit)
            if owner == other or distance > (
                _SEAT_PLAY if pair == (Fit.RIM, Fit.TYRE) else _MAX_OFFSET
            ):
                continue
            is_aligned = bool(np.linalg.norm(np.cross(axis, direction)) < _MAX_TILT)
            is_seat = (
                pair == (Fit.RIM, Fit.TYRE)
                and is_aligned
                and abs(site.length - hole.length) <= _SEAT_PLAY
            )
            is_turntable = pair == (Fit.TURNTABLE, Fit.TURNTABLE) and is_aligned and owner < other
            if pair == (Fit.BALL, Fit.SOCKET) or is_turntable or is_seat:
                result.append(
                    Connection(owner, other, site, hole, centre, axis, site.length, True, False)
                )
    return result


class _Geared(NamedTuple):
    """A gear at its place: middle [3] and axis [3]."""

    placed: Placed
    gear: Gear
    centre: Floats
    axis: Floats


def _geared(parts: Sequence[Placed]) -> list[_Geared]:
    gears = [(placed, gear) for placed in parts for gear in placed.part.gears]
    return [
        _Geared(placed, gear, placed.point(gear.centre), placed.rotation @ np.array(gear.axis))
        for placed, gear in gears
    ]


def meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """Pairs of gears that mesh, or are nearly close enough, then the pairs in chains."""
    gears = _geared(parts)
    centres = np.array([gear.centre for gear in gears]).reshape(-1, 3)
    reach = np.array(
        [
            max(placed.gear.pitch_radius, placed.gear.width, 4.0 * placed.gear.teeth)
            for placed in gears
        ]
    )
    near = (
        (first, gears[number + 1 + int(other)])
        for number, first in enumerate(gears)
        for other in np.flatnonzero(
            np.linalg.norm(centres[number + 1 :] - centres[number], axis=1)
            < reach[number + 1 :] + reach[number] + 2 * _NEAR_TOLERANCE
        )
    )
    found = [
        _mesh(*pair) for pair in islice(near, _MAX_COMPARED) if pair[0].placed is not pair[1].placed
    ]
    return [*(mesh for mesh in found if mesh is not None), *chain_meshes(parts)]


def _mesh(first: _Geared, second: _Geared) -> Mesh | None:
    forms = (first.gear.form, second.gear.form)
    for form, kind in ((GearForm.RACK, _rack), (GearForm.WORM, _worm)):
        if form in forms:
            return kind(first, second) if forms[0] is form else kind(second, first)
    if np.linalg.norm(np.cross(first.axis, second.axis)) < _MAX_TILT:
        return _parallel(first, second)
    # At a right angle a spur gear meshes with a crown gear only.
    if abs(float(first.axis @ second.axis)) < _MAX_TILT and (
        GearForm.SPUR not in forms or GearForm.CROWN in forms
    ):
        return _right_angle(first, second)
    return None


def _parallel(first: _Geared, second: _Geared) -> Mesh | None:
    gear = first.gear
    other = second.gear
    axis = first.axis
    offset = second.centre - first.centre
    along = float(offset @ axis)
    across = offset - along * axis
    distance = float(np.linalg.norm(across))
    error = distance - gear.pitch_radius - other.pitch_radius
    overlap = min(gear.width / 2, along + other.width / 2) - max(
        -gear.width / 2, along - other.width / 2
    )
    if abs(error) > _NEAR_TOLERANCE or overlap <= 1.0 or distance < 1.0:
        return None
    # Dividing the distance by the teeth gives the exact ratio, even if the pitch circles do not
    # quite touch.
    fraction = gear.pitch_radius / (gear.pitch_radius + other.pitch_radius)
    point = first.centre + across * fraction + axis * along / 2
    return _make_mesh(
        first,
        second,
        error,
        point,
        np.cross(axis, across / distance),
        overlap / min(gear.width, other.width),
    )


def _right_angle(first: _Geared, second: _Geared) -> Mesh | None:
    """Bevel and crown gears, or a crown gear and a spur gear, with intersecting axes."""
    gear = first.gear
    other = second.gear
    offset = second.centre - first.centre
    normal = np.cross(first.axis, second.axis)
    along = float(offset @ first.axis)
    along2 = float(offset @ second.axis)
    error = max(_set_back_error(along, gear, other), _set_back_error(along2, other, gear), key=abs)
    if abs(float(offset @ normal)) > _NEAR_TOLERANCE or abs(error) > _NEAR_TOLERANCE:
        return None
    error += abs(float(offset @ normal))
    # On the line where the pitch cones touch, whose distances from the axes have the ratio of the
    # teeth.
    apex = first.centre + along * first.axis
    point = (
        apex
        - np.sign(along) * other.pitch_radius * first.axis
        + np.sign(along2) * gear.pitch_radius * second.axis
    )
    return _make_mesh(first, second, error, point, normal)


def _set_back_error(along: float, gear: Gear, other: Gear) -> float:
    """A gear's distance from the axis of another at a right angle, minus the correct distance,
    LDU."""
    # it may lie anywhere on its axle where the crown gear's teeth pass its own
    if gear.form is GearForm.SPUR:
        return max(abs(abs(along) - other.pitch_radius) - gear.width / 2, 0.0)
    return abs(along) - other.pitch_radius - gear.set_back


def _worm(worm: _Geared, wheel: _Geared) -> Mesh | None:
    axis = worm.axis
    offset = wheel.centre - worm.centre
    radius = wheel.gear.pitch_radius
    is_beside = (
        abs(float(offset @ wheel.axis)) > wheel.gear.width / 2
        or abs(float(offset @ axis)) > worm.gear.width / 2
    )
    if is_beside or abs(float(axis @ wheel.axis)) > _MAX_TILT:
        return None
    across = offset - (offset @ axis) * axis - (offset @ wheel.axis) * wheel.axis
    distance = float(np.linalg.norm(across))
    error = distance - _WORM_PITCH_RADIUS - radius
    if abs(error) > _NEAR_TOLERANCE or distance < 1.0:
        return None
    mesh = _make_mesh(worm, wheel, error, wheel.centre - across / distance * radius, axis)
    # The thread is right-handed: turning it about its axis also moves the teeth backwards along the
    # axis.
    mesh.motion[0, 3:] -= axis * _TOOTH / (2 * np.pi)
    return mesh


def _rack(rack: _Geared, wheel: _Geared) -> Mesh | None:
    along = rack.axis
    up = rack.placed.rotation @ np.array(rack.gear.up)
    axis = wheel.axis
    offset = wheel.centre - rack.centre
    error = float(offset @ up) - wheel.gear.pitch_radius
    if (
        abs(float(axis @ along)) > _MAX_TILT
        or abs(float(axis @ up)) > _MAX_TILT
        or abs(error) > _NEAR_TOLERANCE
    ):
        return None
    if (
        abs(float(offset @ along)) > rack.gear.teeth * _TOOTH / 2
        or abs(float(offset @ axis)) > 0.3 * rack.gear.width
    ):
        return None
    return _make_mesh(rack, wheel, error, wheel.centre - up * wheel.gear.pitch_radius, along)


def _make_mesh(
    first: _Geared,
    second: _Geared,
    error: float,
    point: Floats,
    tangent: Floats,
    engaged: float = 1.0,
    point2: Floats | None = None,
) -> Mesh:
    """A mesh: the first gear at ``point`` and the second there, or at ``point2``, have the same
    velocity along ``tangent``."""
    row, row2 = (
        np.concatenate([tangent, np.cross(at, tangent)])
        for at in (point, point if point2 is None else point2)
    )
    return Mesh(
        first.placed.index,
        second.placed.index,
        (first.gear, second.gear),
        error,
        engaged,
        point,
        np.stack([row, -row2]),
    )


def chain_meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """The gears in each closed chain, in pairs."""
    gears = [placed for placed in _geared(parts) if placed.gear.form is GearForm.SPUR]
    found = []
    for points, axis in _loops(parts):
        driven = [gear for gear in gears if _is_driven(gear, points, axis)]
        found += [_chained(first, second, axis) for first, second in pairwise(driven)]
    return [mesh for mesh in found if mesh is not None]


def _loops(parts: Sequence[Placed]) -> list[tuple[Floats, Floats]]:
    """Points [n, 3] of each closed chain, one a link, and the direction of its pins [3]."""
    links = [placed for placed in parts if placed.part.family == "chains"]
    starts = np.array([link.position for link in links])
    next_link = {}
    for number, link in enumerate(links):
        distances = np.linalg.norm(starts - link.to_plan(np.array([[0.0, 0.0, _LINK]])), axis=1)
        if distances.min() < _LINK / 2:
            next_link[number] = int(distances.argmin())
    remaining = dict.fromkeys(range(len(links)))
    loops = []
    while remaining:
        loop = [next(iter(remaining))]
        while loop[-1] in remaining:
            del remaining[loop[-1]]
            loop.append(next_link.get(loop[-1], -1))
        if loop[-1] == loop[0]:
            loops.append((starts[loop[:-1]], links[loop[0]].rotation[:, 0]))
    return loops


def _is_driven(placed: _Geared, points: Floats, axis: Floats) -> bool:
    """Whether a gear is inside a chain, and links lie on its teeth."""
    offset = points - placed.centre
    projected = offset - np.outer(offset @ axis, axis)
    # a link is the chord of two teeth
    radius = _LINK / 2 / math.sin(2 * math.pi / placed.gear.teeth)
    touching = np.abs(np.linalg.norm(projected, axis=1) - radius) < _LINK_TOLERANCE
    is_level = (
        np.abs(offset @ axis).max() < placed.gear.width / 2 and abs(placed.axis @ axis) > 0.999
    )
    after = np.roll(projected, -1, axis=0)
    winding = np.arctan2(
        np.cross(projected, after) @ axis, np.einsum("ij,ij->i", projected, after)
    ).sum()
    return bool(is_level and np.count_nonzero(touching) >= 2 and abs(winding) > math.pi)


def _chained(first: _Geared, second: _Geared, axis: Floats) -> Mesh | None:
    """Two gears in a chain: where its straight part touches them, both move equally fast along it;
    ``None`` if one is inside the other."""
    radius = first.gear.pitch_radius
    radius2 = second.gear.pitch_radius
    offset = second.centre - first.centre
    offset = offset - (offset @ axis) * axis
    distance = float(np.linalg.norm(offset))
    if distance <= abs(radius - radius2) + _LINK_TOLERANCE:
        return None
    sine = (radius - radius2) / distance
    outward = sine * offset / distance + math.sqrt(1 - sine**2) * np.cross(axis, offset / distance)
    point = first.centre + radius * outward
    point2 = second.centre + radius2 * outward
    return _make_mesh(first, second, 0.0, point, np.cross(axis, outward), point2=point2)
