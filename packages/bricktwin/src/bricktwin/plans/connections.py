"""Connections between parts: pins and axles in holes, studs, tyres on rims, turntables, ball
joints, meshing gears, chains.

LDraw units, plan frame.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from brickhub.errors import percent
from bricktwin.plans.geometry import AXES, MM_PER_LDU, Floats
from bricktwin.plans.part import Fit, Gear, GearForm, Site
from bricktwin.plans.plan import Placed

_MAX_OFFSET = 1.2
"""Largest distance of a pin from the axis of its hole, LDU."""
_MAX_TILT = 0.03
"""Sine of the largest angle between a pin and its hole."""
# A pin that only needs room gets these wider limits, because real parts give way.
_MAX_LOOSE_OFFSET = 2.5
"""LDU."""
_MAX_LOOSE_TILT = 0.1
"""Sine of the largest angle between a pin and a hole that only gives it room."""
_MIN_DEPTH = 3.5
"""Minimum depth of a connection, LDU; a stud is 4 high."""
_MIN_SEATED_SHARE = 0.7
"""Minimum depth as a share of the shorter length."""
_MODULE = 20.0
"""Distance between holes, LDU. A connection that is as deep as this holds, however long its parts
are."""
_MESH_TOLERANCE = 1.0
"""Error up to which two gears mesh, across their teeth, LDU: 0.4 mm. So far apart, gears of 8 and
of 24 teeth (module 1 mm, pressure angle 20 deg) still have a contact ratio of 1.09."""
_NEAR_TOLERANCE = 9.0
"""Error of two gears' distance above which they are unrelated, LDU. An error between the two limits
is a mistake, which is reported."""
_MAX_COMPARED = 20_000
"""Maximum number of gear pairs to compare."""
_CROSS_DEG = 6.0
"""Largest angle between an axle's cross and that of its hole."""
_WORM_PITCH_RADIUS = 10.0
"""LDU."""
_TOOTH = 7.854
"""Length of a tooth, pi mm: lead of a worm, pitch of a rack."""
_LINK = 16.0
"""Length of a chain's link, which spans two teeth, along its z axis (LDU). The next link may begin
half of it away, because LSynth fills a straight part with whole links."""
_LINK_TOLERANCE = 1.5
"""Largest offset of a link from a gear, LDU."""
_BARS = (Fit.PIN, Fit.FRICTION_PIN, Fit.AXLE, Fit.PEG)
_JOINTS = (Fit.TURNTABLE, Fit.BALL, Fit.SOCKET, Fit.RIM, Fit.TYRE)
"""Kinds of sites that are connected if their middles are in one place, and not if one is inside of
the other."""
_SEAT_PLAY = 4.0
"""Tolerance of a tyre's place and of its diameter, LDU."""
# These pairs hold without any freedom: the fit of the male part, then that of the hole.
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
        """Whether the connection is possible: a pin does not fit into an axle hole."""
        is_pin = self.male_site.fit in (Fit.PIN, Fit.FRICTION_PIN)
        return not (is_pin and self.female_site.fit is Fit.AXLE_HOLE)

    @property
    def is_axle(self) -> bool:
        """Whether the connection is an axle in a hole."""
        return self.male_site.fit is Fit.AXLE

    @property
    def is_ball(self) -> bool:
        """Whether the connection is a ball joint."""
        return self.male_site.fit is Fit.BALL

    @property
    def is_rigid(self) -> bool:
        """Whether the connection has no freedom: an axle in an axle hole, a stud (even a single
        one), or a tyre."""
        return (self.male_site.fit, self.female_site.fit) in _RIGID


@dataclass(frozen=True)
class Mesh:
    """Two gears that mesh, or nearly mesh.

    Attributes:
        first, second: indices of the parts.
        gears: their gears.
        error: distance minus the correct distance, LDU.
        parted: what of it is across the teeth, LDU: of a bevel gear that is off along its axle, the
            share that its cone's slope makes of it.
        engaged: overlap as a share of the narrower gear's width, 0..1.
        point: contact point [3].
        motion: [2, 6], constraint on the rates (linear at the plan's origin, angular) of both: the
            products add to 0.
    """

    first: int
    second: int
    gears: tuple[Gear, Gear]
    error: float
    parted: float
    engaged: float
    point: Floats
    motion: Floats

    @property
    def is_good(self) -> bool:
        """Whether the gears mesh well enough to turn each other."""
        return abs(self.parted) <= _MESH_TOLERANCE and self.engaged >= _MIN_SEATED_SHARE

    @property
    def fault(self) -> str:
        """What is wrong with the teeth of a mesh that is not good, and what to do."""
        if abs(self.parted) <= _MESH_TOLERANCE:
            return (
                f"meet over only {percent(self.engaged)} of their width; shift one along its axle"
            )
        error_mm = abs(self.error) * MM_PER_LDU
        kind = "far apart" if self.error > 0 else "close"
        return f"are {error_mm:.1f} mm too {kind}; move one"


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
    # Parts are numbered from 0, so that negative numbers are free for the groups.
    for number, group in enumerate(groups):
        pairs += [(-1 - number, part) for part in group]
    return graph_of(pairs)


def reached(starts: Iterable[int], graph: Mapping[int, Iterable[int]]) -> set[int]:
    """The nodes of a graph that are connected to one of ``starts``, with these."""
    found = set(starts)
    waiting = list(found)
    while waiting:
        node = waiting.pop()
        unseen = set(graph[node]) - found
        found |= unseen
        waiting += unseen
    return found


def connections(parts: Sequence[Placed]) -> list[Connection]:
    """All pins and axles in holes, studs, tyres on rims, turntables and ball joints."""
    males, females, joints = _sites_of(parts)
    return _coinciding(joints) + _inserted(parts, males, females)


def _sites_of(parts: Sequence[Placed]) -> tuple[list[_Placed], list[_Placed], list[_Placed]]:
    """The sites that go into others (males), the sites that take others (females), and the halves
    of joints."""
    males: list[_Placed] = []
    females: list[_Placed] = []
    joints: list[_Placed] = []
    for placed in parts:
        for site in placed.part.sites:
            direction = placed.rotation @ np.array(site.axis)
            entry = (placed.index, site, placed.point(site.centre), direction)
            if site.fit in _JOINTS:
                joints.append(entry)
            elif site.fit.is_male:
                males.append(entry)
            else:
                females.append(entry)
    return males, females, joints


class _Overlap(NamedTuple):
    """A hole, and the part of a pin's axis, from ``low`` to ``high``, that both share (LDU from the
    pin's middle)."""

    hole: _Placed
    low: float
    high: float


class _Holes:
    """All holes of a plan in arrays of n, so that one operation compares a pin with many.

    They are sorted along x, so that a pin is compared with those near to it only: a plan may have
    thousands of both.
    """

    def __init__(self, females: Iterable[_Placed]) -> None:
        self._sorted = sorted(females, key=lambda entry: float(entry[2][0]))
        self._owners = np.array([owner for owner, _, _, _ in self._sorted])
        self._centres = np.array([centre for _, _, centre, _ in self._sorted])  # [n, 3]
        self._axes = np.array([axis for _, _, _, axis in self._sorted])  # [n, 3]
        self._lengths = np.array([hole.length for _, hole, _, _ in self._sorted])
        kinds = [hole.fit is Fit.STUD_HOLE for _, hole, _, _ in self._sorted]
        self._is_for_stud = np.array(kinds)
        self._longest = float(self._lengths.max())

    def around(self, male: _Placed) -> Iterator[_Overlap]:
        """The holes that a pin, an axle or a stud is in."""
        owner, site, centre, axis = male
        reach = (site.length + self._longest) / 2 + _MAX_OFFSET
        bounds = np.searchsorted(self._centres[:, 0], [centre[0] - reach, centre[0] + reach])
        start = int(bounds[0])
        nearby = slice(start, int(bounds[1]))
        # For each of the m holes nearby: `along` [m] is its place on the male's axis, `across` [m]
        # its distance from that axis, `tilt` [m] the sine of the angle between both, and `low` to
        # `high` [m] the part of the axis that both share.
        offset = self._centres[nearby] - centre  # [m, 3]
        along = offset @ axis
        beside = offset - along[:, None] * axis  # [m, 3]
        across = np.linalg.norm(beside, axis=1)
        tilt = np.linalg.norm(np.cross(self._axes[nearby], axis), axis=1)
        low = np.maximum(-site.length / 2, along - self._lengths[nearby] / 2)
        high = np.minimum(site.length / 2, along + self._lengths[nearby] / 2)
        is_coaxial = (across < _MAX_OFFSET) & (tilt < _MAX_TILT)
        is_inside = high - low > _MIN_DEPTH
        is_other_part = self._owners[nearby] != owner
        # A stud does not hold in a pin hole, and a pin does not hold between studs.
        is_of_kind = self._is_for_stud[nearby] == (site.fit is Fit.STUD)
        is_connected = is_coaxial & is_inside & is_other_part & is_of_kind
        for index in np.flatnonzero(is_connected):
            hole = self._sorted[start + index]
            yield _Overlap(hole, float(low[index]), float(high[index]))


def _inserted(
    parts: Sequence[Placed],
    males: list[_Placed],
    females: list[_Placed],
) -> list[Connection]:
    """Pins and axles in holes, and studs."""
    result: list[Connection] = []
    if not females:
        return result
    holes = _Holes(females)
    for male in males:
        owner, site, centre, axis = male
        for (other, hole, _, _), low, high in holes.around(male):
            depth = high - low
            shortest = min(_MODULE, site.length, hole.length)
            is_crossed = _is_crossed(
                parts[owner],
                site,
                parts[other],
                hole,
            )
            result.append(
                Connection(
                    male=owner,
                    female=other,
                    male_site=site,
                    female_site=hole,
                    point=centre + axis * (low + high) / 2,
                    axis=axis,
                    depth=depth,
                    is_seated=depth >= _MIN_SEATED_SHARE * shortest,
                    is_crossed=is_crossed,
                )
            )
    return result


def open_holes(
    male: Placed,
    shift: Floats,
    female: Placed,
) -> list[Site]:
    """The holes of a part into which a pin or an axle of another part fits, however deep. ``shift``
    [3] moves the other part."""
    bars = [site for site in male.part.sites if site.fit in _BARS]
    holes = female.part.holes
    if not bars or not holes:
        return []
    # The holes are given in the frame of their own part, so the bars are moved into it: centres [b,
    # 3] and directions [b, 3].
    bar_centres = np.array([site.centre for site in bars])
    bar_axes = np.array([site.axis for site in bars])
    moved_centres = male.to_plan(bar_centres) + shift  # [b, 3]
    points = female.to_part(moved_centres)
    axes = bar_axes @ male.rotation.T @ female.rotation
    hole_centres = np.array([site.centre for site in holes])[:, None]  # [h, 1, 3]
    hole_axes = np.array([site.axis for site in holes])[:, None]  # [h, 1, 3]
    # One operation compares each of the h holes with each of the b bars [h, b].
    offsets = hole_centres - points  # [h, b, 3]
    across = np.linalg.norm(np.cross(offsets, axes), axis=2)
    tilts = np.linalg.norm(np.cross(hole_axes, axes), axis=2)
    is_fitting = (across < _MAX_LOOSE_OFFSET) & (tilts < _MAX_LOOSE_TILT)
    has_bar = is_fitting.any(axis=1)
    return [site for site, fits in zip(holes, has_bar, strict=True) if fits]


def _is_crossed(
    axle: Placed,
    site: Site,
    holder: Placed,
    hole: Site,
) -> bool:
    """Whether an axle's cross is misaligned with that of its hole. It never is in a motor, which
    turns its shaft to fit."""
    if site.fit is not Fit.AXLE or hole.fit is not Fit.AXLE_HOLE or hole.turns:
        return False
    first = axle.rotation @ _arm(site)
    second = holder.rotation @ _arm(hole)
    # Rounding may leave a cosine slightly above 1, for which `arccos` gives NaN.
    cosine = np.clip(abs(float(first @ second)), 0.0, 1.0)
    angle_deg = np.degrees(np.arccos(cosine))
    # A cross looks the same after a quarter of a turn, so the angle is taken from the nearest
    # quarter.
    return bool(min(angle_deg, 90 - angle_deg) > _CROSS_DEG)


def _arm(site: Site) -> Floats:
    """One direction of the cross in the part's frame."""
    if site.arm:
        return np.array(site.arm)
    # The catalogue omits an arm that lies along one of the part's axes, so that one is the default.
    return np.array(AXES["x"] if abs(site.axis[0]) < 0.5 else AXES["y"])


def _coinciding(joints: list[_Placed]) -> list[Connection]:
    """Halves of a turntable, balls in sockets, tyres on rims."""
    result = []
    for owner, site, centre, axis in joints:
        for other, hole, other_centre, other_axis in joints:
            if owner == other:
                continue
            pair = (site.fit, hole.fit)
            is_wheel = pair == (Fit.RIM, Fit.TYRE)
            distance = np.linalg.norm(other_centre - centre)
            if distance > (_SEAT_PLAY if is_wheel else _MAX_OFFSET):
                continue
            is_aligned = bool(np.linalg.norm(np.cross(axis, other_axis)) < _MAX_TILT)
            # The lengths of rims and tyres are their diameters, and a tyre fits only on a rim of
            # its size.
            is_seat = is_wheel and is_aligned and abs(site.length - hole.length) <= _SEAT_PLAY
            # Both halves of a turntable have the same fit, so each pair is met twice; the order
            # keeps one of them.
            is_turntable = pair == (Fit.TURNTABLE, Fit.TURNTABLE) and is_aligned and owner < other
            # A ball may point anywhere in its socket, so its alignment does not matter.
            if pair == (Fit.BALL, Fit.SOCKET) or is_turntable or is_seat:
                result.append(
                    Connection(
                        male=owner,
                        female=other,
                        male_site=site,
                        female_site=hole,
                        point=centre,
                        axis=axis,
                        depth=site.length,
                        is_seated=True,
                        is_crossed=False,
                    )
                )
    return result


class _Geared(NamedTuple):
    """A gear at its place: middle [3] and axis [3]."""

    placed: Placed
    gear: Gear
    centre: Floats
    axis: Floats

    @property
    def reach(self) -> float:
        """Largest distance from the gear's middle to anything that meshes with it, LDU."""
        # A rack is longer than any radius. Half of its length is 4 LDU for each tooth.
        return max(self.gear.pitch_radius, self.gear.width, 4.0 * self.gear.teeth)


def _geared(parts: Sequence[Placed]) -> list[_Geared]:
    geared = []
    for placed in parts:
        for gear in placed.part.gears:
            axis = placed.rotation @ np.array(gear.axis)
            geared.append(
                _Geared(
                    placed,
                    gear,
                    placed.point(gear.centre),
                    axis,
                )
            )
    return geared


def meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """Pairs of gears that mesh, or are nearly close enough, then the pairs in chains."""
    found: list[Mesh] = []
    # A file from somebody else may hold thousands of gears in a heap, and the search must end.
    for first, second in islice(_near_gears(_geared(parts)), _MAX_COMPARED):
        if first.placed is second.placed:
            continue
        mesh = _mesh(first, second)
        if mesh is not None:
            found.append(mesh)
    return found + chain_meshes(parts)


def _near_gears(gears: Sequence[_Geared]) -> Iterator[tuple[_Geared, _Geared]]:
    """Pairs of gears that are near enough to be compared."""
    centres = np.array([gear.centre for gear in gears]).reshape(-1, 3)
    reach = np.array([gear.reach for gear in gears])
    for number, first in enumerate(gears):
        after = slice(number + 1, None)
        distances = np.linalg.norm(centres[after] - centres[number], axis=1)
        is_near = distances < reach[after] + reach[number] + 2 * _NEAR_TOLERANCE
        for other in np.flatnonzero(is_near):
            yield first, gears[number + 1 + int(other)]


def _mesh(first: _Geared, second: _Geared) -> Mesh | None:
    forms = (first.gear.form, second.gear.form)
    # Racks and worms are no discs. Each has a rule of its own, which expects it as the first of the
    # pair.
    for form, special_mesh in ((GearForm.RACK, _rack), (GearForm.WORM, _worm)):
        if forms[0] is form:
            return special_mesh(first, second)
        if forms[1] is form:
            return special_mesh(second, first)
    if np.linalg.norm(np.cross(first.axis, second.axis)) < _MAX_TILT:
        return _parallel(first, second)
    # At a right angle a spur gear meshes with a crown gear only.
    is_right_angle = abs(float(first.axis @ second.axis)) < _MAX_TILT
    if is_right_angle and (GearForm.SPUR not in forms or GearForm.CROWN in forms):
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
    low = max(-gear.width / 2, along - other.width / 2)
    high = min(gear.width / 2, along + other.width / 2)
    overlap = high - low
    # Two gears on one axle have no distance, and so no direction of contact.
    if abs(error) > _NEAR_TOLERANCE or overlap <= 1.0 or distance < 1.0:
        return None
    # Dividing the distance by the teeth gives the exact ratio, even where the pitch circles do not
    # quite touch.
    fraction = gear.pitch_radius / (gear.pitch_radius + other.pitch_radius)
    point = first.centre + across * fraction + axis * along / 2
    tangent = np.cross(axis, across / distance)
    engaged = overlap / min(gear.width, other.width)
    return _make_mesh(
        first,
        second,
        error,
        point,
        tangent,
        engaged,
    )


def _right_angle(first: _Geared, second: _Geared) -> Mesh | None:
    """Bevel and crown gears, or a crown gear and a spur gear, with intersecting axes."""
    gear = first.gear
    other = second.gear
    offset = second.centre - first.centre
    normal = np.cross(first.axis, second.axis)
    along = float(offset @ first.axis)
    other_along = float(offset @ second.axis)
    first_error = _set_back_error(along, gear, other)
    second_error = _set_back_error(other_along, other, gear)
    error = max(first_error, second_error, key=abs)
    # The axes should intersect; `gap` is how far they miss each other.
    gap = abs(float(offset @ normal))
    if gap > _NEAR_TOLERANCE or abs(error) > _NEAR_TOLERANCE:
        return None
    parted = max(
        first_error * _slope(gear, other),
        second_error * _slope(other, gear),
        key=abs,
    )
    error += gap
    # The pitch cones touch on a line through the apex, and the distances of its points from both
    # axes have the ratio of the teeth.
    apex = first.centre + along * first.axis
    back = np.sign(along) * other.pitch_radius * first.axis
    aside = np.sign(other_along) * gear.pitch_radius * second.axis
    return _make_mesh(
        first,
        second,
        error,
        apex - back + aside,
        normal,
        parted=parted + gap,
    )


def _slope(gear: Gear, other: Gear) -> float:
    """How far a gear's teeth part from another's for each step along its own axis: the sine of its
    pitch cone's half angle. The teeth of a crown gear stand along that axis."""
    if GearForm.CROWN in (gear.form, other.form):
        return 1.0
    return gear.pitch_radius / math.hypot(gear.pitch_radius, other.pitch_radius)


def _set_back_error(
    along: float,
    gear: Gear,
    other: Gear,
) -> float:
    """A gear's distance from the axis of another at a right angle, minus the correct distance,
    LDU."""
    # A spur gear may lie anywhere on its axle, as long as the teeth of the crown gear pass those of
    # it.
    if gear.form is GearForm.SPUR:
        from_middle = abs(abs(along) - other.pitch_radius)
        return max(from_middle - gear.width / 2, 0.0)
    return abs(along) - other.pitch_radius - gear.set_back


def _worm(worm: _Geared, wheel: _Geared) -> Mesh | None:
    axis = worm.axis
    offset = wheel.centre - worm.centre
    radius = wheel.gear.pitch_radius
    is_beside_wheel = abs(float(offset @ wheel.axis)) > wheel.gear.width / 2
    is_beside_worm = abs(float(offset @ axis)) > worm.gear.width / 2
    is_tilted = abs(float(axis @ wheel.axis)) > _MAX_TILT
    if is_beside_wheel or is_beside_worm or is_tilted:
        return None
    along_worm = (offset @ axis) * axis
    along_wheel = (offset @ wheel.axis) * wheel.axis
    across = offset - along_worm - along_wheel
    distance = float(np.linalg.norm(across))
    error = distance - _WORM_PITCH_RADIUS - radius
    if abs(error) > _NEAR_TOLERANCE or distance < 1.0:
        return None
    contact = wheel.centre - across / distance * radius
    mesh = _make_mesh(
        worm,
        wheel,
        error,
        contact,
        axis,
    )
    # The thread is right-handed, so turning the worm about its axis also moves its teeth backwards.
    mesh.motion[0, 3:] -= axis * _TOOTH / (2 * np.pi)
    return mesh


def _rack(rack: _Geared, wheel: _Geared) -> Mesh | None:
    along = rack.axis
    up = rack.placed.rotation @ np.array(rack.gear.up)
    axis = wheel.axis
    offset = wheel.centre - rack.centre
    error = float(offset @ up) - wheel.gear.pitch_radius
    # The wheel rolls along the rack, so its axis is across the rack and across the direction of its
    # teeth.
    is_tilted = abs(float(axis @ along)) > _MAX_TILT or abs(float(axis @ up)) > _MAX_TILT
    if is_tilted or abs(error) > _NEAR_TOLERANCE:
        return None
    is_past_end = abs(float(offset @ along)) > rack.gear.teeth * _TOOTH / 2
    is_beside = abs(float(offset @ axis)) > 0.3 * rack.gear.width
    if is_past_end or is_beside:
        return None
    contact = wheel.centre - up * wheel.gear.pitch_radius
    return _make_mesh(
        rack,
        wheel,
        error,
        contact,
        along,
    )


def _make_mesh(
    first: _Geared,
    second: _Geared,
    error: float,
    point: Floats,
    tangent: Floats,
    engaged: float = 1.0,
    second_point: Floats | None = None,
    parted: float | None = None,
) -> Mesh:
    """A mesh in which both gears have the same velocity along ``tangent``: the first one at
    ``point``, and the second one there or at ``second_point``."""
    if second_point is None:
        second_point = point
    # A point p of a body with the rates (v, w) moves along t at v . t + w . (p x t), which is this
    # row times the rates.
    first_row = np.concatenate([tangent, np.cross(point, tangent)])
    second_row = np.concatenate([tangent, np.cross(second_point, tangent)])
    gears = (first.gear, second.gear)
    motion = np.stack([first_row, -second_row])
    return Mesh(
        first.placed.index,
        second.placed.index,
        gears,
        error,
        error if parted is None else parted,
        engaged,
        point,
        motion,
    )


def chain_meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """The gears in each closed chain, in pairs."""
    gears = [geared for geared in _geared(parts) if geared.gear.form is GearForm.SPUR]
    found = []
    for points, axis in _loops(parts):
        driven = [gear for gear in gears if _is_driven(gear, points, axis)]
        for first, second in pairwise(driven):
            mesh = _chained(first, second, axis)
            if mesh is not None:
                found.append(mesh)
    return found


def _loops(parts: Sequence[Placed]) -> list[tuple[Floats, Floats]]:
    """Points [n, 3] of each closed chain, one a link, and the direction of its pins [3]."""
    links = [placed for placed in parts if placed.part.family == "chains"]
    starts = np.array([link.position for link in links])
    # A link is followed by the one that begins where it ends.
    next_link = {}
    for number, link in enumerate(links):
        end = link.to_plan(np.array([[0.0, 0.0, _LINK]]))
        distances = np.linalg.norm(starts - end, axis=1)
        if distances.min() < _LINK / 2:
            next_link[number] = int(distances.argmin())
    # A dictionary serves as a set that keeps its order, so that the same plan always gives the same
    # first loop.
    remaining = dict.fromkeys(range(len(links)))
    loops = []
    while remaining:
        loop = [next(iter(remaining))]
        while loop[-1] in remaining:
            del remaining[loop[-1]]
            loop.append(next_link.get(loop[-1], -1))
        # The walk stops at an open end, in a loop that it only led into, or where it began: only
        # the last is a closed chain.
        if loop[-1] == loop[0]:
            loops.append((starts[loop[:-1]], links[loop[0]].rotation[:, 0]))
    return loops


def _is_driven(
    placed: _Geared,
    points: Floats,
    axis: Floats,
) -> bool:
    """Whether a gear is inside a chain, and links lie on its teeth."""
    offset = points - placed.centre
    aside = offset @ axis  # [n]
    projected = offset - np.outer(aside, axis)  # [n, 3]
    # A link spans two teeth, so its length is the chord of two pitches; this is the radius of their
    # circle.
    radius = _LINK / 2 / math.sin(2 * math.pi / placed.gear.teeth)
    distances = np.linalg.norm(projected, axis=1)
    touching = np.abs(distances - radius) < _LINK_TOLERANCE
    is_in_plane = np.abs(aside).max() < placed.gear.width / 2
    is_level = is_in_plane and abs(placed.axis @ axis) > 0.999
    # The sum of the angles from link to link is a whole turn if the chain goes round the gear, and
    # 0 if the gear is outside.
    after = np.roll(projected, -1, axis=0)
    sines = np.cross(projected, after) @ axis
    cosines = np.einsum("ij,ij->i", projected, after)
    winding = np.arctan2(sines, cosines).sum()
    return bool(is_level and np.count_nonzero(touching) >= 2 and abs(winding) > math.pi)


def _chained(
    first: _Geared,
    second: _Geared,
    axis: Floats,
) -> Mesh | None:
    """A mesh of two gears in a chain: both move equally fast along its straight part, where that
    touches them. ``None`` if one gear is inside of the other."""
    radius = first.gear.pitch_radius
    other_radius = second.gear.pitch_radius
    offset = second.centre - first.centre
    offset = offset - (offset @ axis) * axis
    distance = float(np.linalg.norm(offset))
    if distance <= abs(radius - other_radius) + _LINK_TOLERANCE:
        return None
    # The outer tangent touches both circles in the same direction from their middles.
    sine = (radius - other_radius) / distance
    cosine = math.sqrt(1 - sine**2)
    ahead = sine * offset / distance
    aside = cosine * np.cross(axis, offset / distance)
    outward = ahead + aside
    point = first.centre + radius * outward
    other_point = second.centre + other_radius * outward
    tangent = np.cross(axis, outward)
    return _make_mesh(
        first,
        second,
        0.0,
        point,
        tangent,
        second_point=other_point,
    )
