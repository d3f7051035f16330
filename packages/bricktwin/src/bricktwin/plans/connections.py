"""Connections between parts: pins and axles in holes, studs, turntables, ball joints, gear meshes. LDraw units, plan frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bricktwin.plans.geometry import AXES, Floats
from bricktwin.plans.part import Fit, Gear, GearForm, Site
from bricktwin.plans.plan import Placed

_MAX_OFFSET, _MAX_TILT = 1.2, 0.03
"""Tolerances of a pin: offset from the hole's axis (LDU), tilt (sine)."""
_MIN_DEPTH = 3.5
"""Minimum depth of a connection, LDU; a stud is 4 high."""
_MIN_SEATED_SHARE = 0.7
"""Minimum depth as a share of the shorter length."""
_MESH_TOLERANCE, _NEAR_TOLERANCE = 1.0, 9.0
"""Tolerances of two gears' distance, LDU: up to the first they mesh; above the second they are unrelated."""
_MAX_COMPARED = 20_000
"""Maximum number of gear pairs to compare."""
_CROSS_DEG = 6.0
_WORM_PITCH_RADIUS = 10.0
_WORM_LEAD = 7.854
"""One tooth, pi mm, per turn."""
_JOINTS = (Fit.TURNTABLE, Fit.BALL, Fit.SOCKET)
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
        return not (self.male_site.fit in (Fit.PIN, Fit.FRICTION_PIN) and self.female_site.fit is Fit.AXLE_HOLE)

    @property
    def is_ball(self) -> bool:
        """Whether it is a ball joint."""
        return self.male_site.fit is Fit.BALL

    @property
    def is_rigid(self) -> bool:
        """Whether it has no freedom: an axle in an axle hole, or a stud (also a single one)."""
        return (self.male_site.fit, self.female_site.fit) in ((Fit.AXLE, Fit.AXLE_HOLE), (Fit.STUD, Fit.STUD_HOLE))


@dataclass(frozen=True)
class Mesh:
    """Two gears that mesh, or nearly mesh.

    Attributes:
        first, second: indices of the parts.
        gears: their gears.
        error: distance minus the correct distance, LDU.
        engaged: overlap as a share of the narrower gear's width, 0..1.
        point: contact point [3].
        motion: [2, 6], constraint on the rates (linear at the plan's origin, angular) of both: the products add to 0.
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


def connections(parts: Sequence[Placed]) -> list[Connection]:
    """All pins and axles in holes, studs, turntables and ball joints."""
    males: list[_Placed] = []
    females: list[_Placed] = []
    joints: list[_Placed] = []
    for placed in parts:
        for site in placed.part.sites:
            entry = (placed.index, site, placed.point(site.centre), placed.rotation @ np.array(site.axis))
            (joints if site.fit in _JOINTS else males if site.fit.is_male else females).append(entry)
    result = _coinciding(joints)
    if not females:
        return result
    females.sort(key=lambda entry: float(entry[2][0]))
    owners = np.array([entry[0] for entry in females])
    centres, axes = np.array([entry[2] for entry in females]), np.array([entry[3] for entry in females])
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
        fitting = (across < _MAX_OFFSET) & (tilt < _MAX_TILT) & (high - low > _MIN_DEPTH) & (owners[nearby] != owner)
        fitting &= is_for_stud[nearby] == (site.fit is Fit.STUD)
        for index in np.flatnonzero(fitting):
            depth = float(high[index] - low[index])
            other, hole = females[int(start) + index][0], females[int(start) + index][1]
            is_seated = depth >= _MIN_SEATED_SHARE * min(20.0, site.length, hole.length)
            is_crossed = _is_crossed(parts[owner], site, parts[other], hole)
            point = centre + axis * float(low[index] + high[index]) / 2
            result.append(Connection(owner, other, site, hole, point, axis, depth, is_seated, is_crossed))
    return result


def _is_crossed(axle: Placed, site: Site, holder: Placed, hole: Site) -> bool:
    """Whether an axle's cross is misaligned with that of its hole; a motor turns its shaft to fit."""
    if site.fit is not Fit.AXLE or hole.fit is not Fit.AXLE_HOLE or hole.turns:
        return False
    first, second = axle.rotation @ _arm(site), holder.rotation @ _arm(hole)
    angle = np.degrees(np.arccos(np.clip(abs(float(first @ second)), 0.0, 1.0)))
    return bool(min(angle, 90 - angle) > _CROSS_DEG)


def _arm(site: Site) -> Floats:
    """One direction of the cross in the part's frame."""
    return np.array(site.arm or (AXES["x"] if abs(site.axis[0]) < 0.5 else AXES["y"]))


def _coinciding(joints: list[_Placed]) -> list[Connection]:
    """Halves of a turntable, and balls in sockets."""
    result = []
    for owner, site, centre, axis in joints:
        for other, hole, centre2, direction in joints:
            if owner == other or np.linalg.norm(centre2 - centre) > _MAX_OFFSET:
                continue
            is_aligned = owner < other and np.linalg.norm(np.cross(axis, direction)) < _MAX_TILT
            pair = (site.fit, hole.fit)
            if pair == (Fit.BALL, Fit.SOCKET) or (pair == (Fit.TURNTABLE, Fit.TURNTABLE) and is_aligned):
                result.append(Connection(owner, other, site, hole, centre, axis, site.length, True, False))
    return result


def meshes(parts: Sequence[Placed]) -> list[Mesh]:
    """Pairs of gears that mesh, or are nearly close enough."""
    gears = [(placed, gear) for placed in parts for gear in placed.part.gears]
    centres = np.array([placed.point(gear.centre) for placed, gear in gears]).reshape(-1, 3)
    reach = np.array([max(gear.pitch_radius, gear.width, 4.0 * gear.teeth) for _, gear in gears])
    result: list[Mesh] = []
    compared = 0
    for number, (placed, gear) in enumerate(gears):
        distances = np.linalg.norm(centres[number + 1 :] - centres[number], axis=1)
        for near in np.flatnonzero(distances < reach[number + 1 :] + reach[number] + 2 * _NEAR_TOLERANCE):
            other, second = gears[number + 1 + int(near)]
            compared += 1
            if compared > _MAX_COMPARED:
                return result
            mesh = _mesh(placed, gear, other, second) if other.index != placed.index else None
            if mesh is not None:
                result.append(mesh)
    return result


def _mesh(first: Placed, gear: Gear, second: Placed, other: Gear) -> Mesh | None:
    if GearForm.RACK in (gear.form, other.form):
        return _rack(first, gear, second, other) if gear.form is GearForm.RACK else _rack(second, other, first, gear)
    if GearForm.WORM in (gear.form, other.form):
        return _worm(first, gear, second, other) if gear.form is GearForm.WORM else _worm(second, other, first, gear)
    axis, axis2 = first.rotation @ np.array(gear.axis), second.rotation @ np.array(other.axis)
    if np.linalg.norm(np.cross(axis, axis2)) < _MAX_TILT:
        return _parallel(first, gear, second, other, axis)
    forms = {gear.form, other.form}  # at a right angle a spur gear meshes with a crown gear only
    if abs(float(axis @ axis2)) < _MAX_TILT and (GearForm.SPUR not in forms or GearForm.CROWN in forms):
        return _right_angle(first, gear, second, other, axis, axis2)
    return None


def _parallel(first: Placed, gear: Gear, second: Placed, other: Gear, axis: Floats) -> Mesh | None:
    offset = second.point(other.centre) - first.point(gear.centre)
    along = float(offset @ axis)
    across = offset - along * axis
    distance = float(np.linalg.norm(across))
    error = distance - gear.pitch_radius - other.pitch_radius
    overlap = min(gear.width / 2, along + other.width / 2) - max(-gear.width / 2, along - other.width / 2)
    if abs(error) > _NEAR_TOLERANCE or overlap <= 1.0 or distance < 1.0:
        return None
    # Dividing the distance by the teeth gives the exact ratio, even if the pitch circles do not quite touch.
    fraction = gear.pitch_radius / (gear.pitch_radius + other.pitch_radius)
    point = first.point(gear.centre) + across * fraction + axis * along / 2
    tangent = np.cross(axis, across / distance)
    return _make_mesh(first, gear, second, other, error, overlap / min(gear.width, other.width), point, tangent)


def _right_angle(first: Placed, gear: Gear, second: Placed, other: Gear, axis: Floats, axis2: Floats) -> Mesh | None:
    """Bevel and crown gears, or a crown gear and a spur gear, with intersecting axes."""
    offset = second.point(other.centre) - first.point(gear.centre)
    normal = np.cross(axis, axis2)
    along, along2 = float(offset @ axis), float(offset @ axis2)
    error = max(_set_back_error(along, gear, other), _set_back_error(along2, other, gear), key=abs)
    if abs(float(offset @ normal)) > _NEAR_TOLERANCE or abs(error) > _NEAR_TOLERANCE:
        return None
    error += abs(float(offset @ normal))
    # On the line where the pitch cones touch, whose distances from the axes have the ratio of the teeth.
    apex = first.point(gear.centre) + along * axis
    point = apex - np.sign(along) * other.pitch_radius * axis + np.sign(along2) * gear.pitch_radius * axis2
    return _make_mesh(first, gear, second, other, error, 1.0, point, normal)


def _set_back_error(along: float, gear: Gear, other: Gear) -> float:
    """A gear's distance from the axis of another at a right angle, minus the correct distance, LDU."""
    if gear.form is GearForm.SPUR:  # it may lie anywhere on its axle where the crown gear's teeth pass its own
        return max(abs(abs(along) - other.pitch_radius) - gear.width / 2, 0.0)
    return abs(along) - other.pitch_radius - gear.set_back


def _worm(first: Placed, worm: Gear, second: Placed, gear: Gear) -> Mesh | None:
    axis, axis2 = first.rotation @ np.array(worm.axis), second.rotation @ np.array(gear.axis)
    offset = second.point(gear.centre) - first.point(worm.centre)
    if (
        abs(float(axis @ axis2)) > _MAX_TILT
        or abs(float(offset @ axis2)) > gear.width / 2
        or abs(float(offset @ axis)) > worm.width / 2
    ):
        return None
    across = offset - (offset @ axis) * axis - (offset @ axis2) * axis2
    distance = float(np.linalg.norm(across))
    error = distance - _WORM_PITCH_RADIUS - gear.pitch_radius
    if abs(error) > _NEAR_TOLERANCE or distance < 1.0:
        return None
    point = second.point(gear.centre) - across / distance * gear.pitch_radius
    mesh = _make_mesh(first, worm, second, gear, error, 1.0, point, axis)
    # The thread is right-handed: turning it about its axis also moves the teeth backwards along the axis.
    mesh.motion[0, 3:] -= axis * _WORM_LEAD / (2 * np.pi)
    return mesh


def _rack(first: Placed, rack: Gear, second: Placed, gear: Gear) -> Mesh | None:
    along, up = first.rotation @ np.array(rack.axis), first.rotation @ np.array(rack.up)
    axis = second.rotation @ np.array(gear.axis)
    offset = second.point(gear.centre) - first.point(rack.centre)
    error = float(offset @ up) - gear.pitch_radius
    half = rack.teeth * 7.854 / 2
    if abs(float(axis @ along)) > _MAX_TILT or abs(float(axis @ up)) > _MAX_TILT or abs(error) > _NEAR_TOLERANCE:
        return None
    if abs(float(offset @ along)) > half or abs(float(offset @ axis)) > 0.3 * rack.width:
        return None
    return _make_mesh(first, rack, second, gear, error, 1.0, second.point(gear.centre) - up * gear.pitch_radius, along)


def _make_mesh(
    first: Placed, gear: Gear, second: Placed, other: Gear, error: float, engaged: float, point: Floats, tangent: Floats
) -> Mesh:
    """A mesh: at ``point`` both have the same velocity along ``tangent``."""
    row = np.concatenate([tangent, np.cross(point, tangent)])
    return Mesh(first.index, second.index, (gear, other), error, engaged, point, np.stack([row, -row]))
