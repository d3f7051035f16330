"""Feet of a robot from a plan: those shapes of its moving parts that come to the floor at some
angle of its motors.

The linkage is turned once around. What is nearer to the floor than the chassis, in the robot's
level position or in one that is tilted a little, touches it; of what touches, as few shapes are
kept as reach as far. So both ends of a beam that turns about its middle are feet, each arm of a
star, the corners of a plate, and the lower ends of a linkage wherever they are drawn.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from bricktwin.plans.connections import graph_of, reached
from bricktwin.plans.geometry import M_PER_LDU, Bools, Floats, Form, Solid
from bricktwin.plans.mechanism.articulation import Articulation
from bricktwin.plans.mechanism.kinematics import TO_TWIN, point_m_of
from bricktwin.plans.plan import Placed
from bricktwin.plans.planned_robot import PlannedRobot
from bricktwin.twin.models.linkage import Linkage

_POSES = 48
"""Poses of a turn of the legs that are tried."""
_TILT_DEG = 15.0
"""Tilt of a robot on legs that is tried, to each side."""
_SLACK_M = 0.0005
"""Difference of height that no floor feels."""
_ABOVE_FLOOR_M = 0.005
"""Height above the wheels' lowest point below which other parts may touch the floor."""
_SAME_AXIS_M = 0.0012
"""Largest distance of cylinders that count as one round end of a leg."""
_GAP_M = 0.004
"""Largest gap between two such cylinders."""
_LEVEL = 0.1
"""Sine of the largest slope of a cylinder that lies on its side."""
Turns = tuple[Floats, Floats]
"""Rotations [poses, 3, 3] and shifts [poses, 3], m, of a body in one turn of the motors."""


class Shape(NamedTuple):
    """Convex solid of a part on a body, in the twin's axes and the plan's position.

    Attributes:
        form: a box; a ball; a cylinder, which lies on its side if it ``is_level`` however the legs
            are turned; a ring counts as a cylinder.
        centre_m: midpoint [3].
        axes: rows [3, 3]; the third is the axis of a cylinder.
        half_m: half sizes [3] along them; those of a cylinder are radius, radius and half length.
    """

    body: int
    part: int
    form: Form
    centre_m: Floats
    axes: Floats
    half_m: Floats
    is_level: bool = False

    @property
    def axis(self) -> Floats:
        """Axis [3] of a cylinder."""
        return np.asarray(self.axes[2])

    @property
    def lowest_m(self) -> float:
        """Height of its lowest point."""
        downwards = np.array([[0.0, 0.0, -1.0]])
        return -float(self.reach_m(downwards)[0])

    @property
    def ends_m(self) -> tuple[Floats, Floats]:
        """Ends [3] of the axis of a cylinder."""
        along_m = self.axis * self.half_m[2]
        return self.centre_m - along_m, self.centre_m + along_m

    def reach_m(self, directions: Floats) -> Floats:
        """How far it reaches in directions [n, 3] from the origin of the plan [n]."""
        from_origin_m = directions @ self.centre_m
        cosines = np.abs(directions @ self.axes.T)  # [n, 3]
        if self.form is Form.BALL:
            return np.asarray(from_origin_m + self.half_m[0])
        if self.form is Form.BOX:
            # The farthest corner is the one on the direction's side of each axis.
            return np.asarray(from_origin_m + cosines @ self.half_m)
        radius_m, _, half_length_m = self.half_m
        along = cosines[:, 2]
        # Rounding may make a cosine larger than 1.
        across = np.sqrt(np.maximum(1.0 - along**2, 0.0))
        own_m = across * radius_m + along * half_length_m
        return np.asarray(from_origin_m + own_m)


@functools.lru_cache(maxsize=16)
def feet_of(planned: PlannedRobot) -> tuple[Shape, ...]:
    """Shapes that may touch the floor, of all moving bodies without a tyre; of each body first the
    one that is lowest in the plan. Empty for a robot that stands on the table."""
    articulation = planned.articulation
    if articulation.is_fixed:
        return ()
    turns = turns_of(planned)
    # What rolls stands level. Legs seldom carry a robot so.
    tilts = downwards(0.0 if articulation.wheels else _TILT_DEG)
    chassis_m = _chassis_reach_m(planned, tilts)
    on_wheels = {wheel.link for wheel in articulation.wheels}
    found: list[Shape] = []
    for group in _groups(articulation):
        shapes: dict[int, list[Shape]] = {}
        for number in group:
            if number in turns and number not in on_wheels:
                shapes[number] = _joined_shapes(planned, number, turns[number])
        # Only what is as low as all others of one linkage, and as the chassis, can touch.
        floor_m = np.tile(chassis_m, _POSES)
        reaches_m: dict[int, Floats] = {}
        for number, own in shapes.items():
            reaches_m[number] = _reaches_m(own, turns[number], tilts)
            floor_m = np.maximum(floor_m, reaches_m[number].max(axis=0, initial=-math.inf))
        for number, own in shapes.items():
            found += _touching(own, reaches_m[number], floor_m)
    return tuple(sorted(found, key=lambda shape: (shape.body, shape.lowest_m)))


def skids_of(planned: PlannedRobot, feet: Sequence[Shape]) -> tuple[Shape, ...]:
    """Shapes of the chassis that may touch the floor beside the feet, at the phases of the plan."""
    turns = turns_of(planned)
    tilts = downwards(_TILT_DEG)
    floor_m = np.full(len(tilts) * _POSES, -math.inf)
    for foot in feet:
        reach_m = _reaches_m([foot], turns[foot.body], tilts)[0]
        floor_m = np.maximum(floor_m, reach_m)
    # The chassis is what all turns are relative to, so its own are none.
    upright = np.tile(np.eye(3), (_POSES, 1, 1))
    still = (upright, np.zeros((_POSES, 3)))
    shapes = _joined_shapes(planned, 0, still)
    reaches_m = _reaches_m(shapes, still, tilts)
    return tuple(_touching(shapes, reaches_m, floor_m))


def _touching(
    shapes: Sequence[Shape],
    reaches_m: Floats,
    floor_m: Floats,
) -> list[Shape]:
    """Of shapes with their reaches [shapes, n], as few as reach as far as all together, where that
    is as far as a floor [n] may be."""
    if not shapes:
        return []
    farthest_m = reaches_m.max(axis=0)
    touches = farthest_m > floor_m - _SLACK_M
    # What is a little higher than the lowest shape is as good as that.
    is_lowest = reaches_m > farthest_m - _SLACK_M
    chosen = _fewest(is_lowest[:, touches])
    return [shapes[index] for index in chosen]


def _groups(articulation: Articulation) -> list[list[int]]:
    """Moving bodies by what moves together: those of a linkage, and of a motor with its gears."""
    edges = [(rod.near, rod.far) for rod in articulation.rods]
    for joint in (*articulation.joints, *articulation.loops):
        edges.append((joint.parent, joint.child))
    driven = {drive.port: drive.joint.child for drive in articulation.drives}
    for geared in articulation.geared:
        edges.append((driven[geared.port], geared.joint.child))
    for coupling in articulation.couplings:
        first, *others = (body for body, _ in coupling.coefficients)
        edges += [(first, other) for other in others]
    # The chassis joins all of them, and none.
    neighbours = graph_of(edge for edge in edges if 0 not in edge)
    groups: list[list[int]] = []
    for number in range(1, len(articulation.bodies)):
        if not any(number in group for group in groups):
            groups.append(sorted(reached([number], neighbours)))
    return groups


def downwards(tilt_deg: float) -> Floats:
    """Directions [9, 3] that may be downwards for a chassis: straight, and tilted to each side and
    each corner, so that of two equal feet each is once the lower one."""
    tilt = math.radians(tilt_deg)
    directions = [(0.0, 0.0, -1.0)]
    for eighth in range(8):
        angle = eighth * math.pi / 4
        ahead = math.sin(tilt) * math.cos(angle)
        aside = math.sin(tilt) * math.sin(angle)
        directions.append((ahead, aside, -math.cos(tilt)))
    return np.array(directions)


def _reaches_m(
    shapes: Sequence[Shape],
    turns: Turns,
    directions: Floats,
) -> Floats:
    """How far shapes of one body reach [shapes, poses * n] in directions [n, 3] of the chassis."""
    rotations, shifts_m = turns
    # A direction is turned into the body's own axes, and the body's shift along it is added.
    turned = directions @ rotations  # [poses, n, 3]
    moved_m = shifts_m @ directions.T  # [poses, n]
    reaches_m = np.zeros((len(shapes), moved_m.size))
    for row, shape in enumerate(shapes):
        own_m = shape.reach_m(turned.reshape(-1, 3))
        reaches_m[row] = own_m + moved_m.ravel()
    return reaches_m


def _chassis_reach_m(planned: PlannedRobot, tilts: Floats) -> Floats:
    """How far from the origin a floor is at the nearest, in directions [n, 3]: where the chassis or
    the wheels touch it [n]."""
    reaches_m = [np.full(len(tilts), -math.inf)]
    reaches_m += [shape.reach_m(tilts) for shape in shapes_of(planned, 0)]
    for wheel in planned.articulation.wheels:
        radius_m = wheel.diameter_mm / 2000
        reaches_m.append(tilts @ wheel.centre_m + radius_m - _ABOVE_FLOOR_M)
    return np.asarray(np.max(reaches_m, axis=0))


def _fewest(is_reached: Bools) -> list[int]:
    """Rows of a table [shapes, directions] that together reach all columns: each time the one that
    reaches most of those that remain."""
    remaining = is_reached.any(axis=0)
    chosen: list[int] = []
    while remaining.any():
        counts = (is_reached & remaining).sum(axis=1)
        best = int(np.argmax(counts))
        chosen.append(best)
        remaining &= ~is_reached[best]
    return chosen


@functools.lru_cache(maxsize=16)
def turns_of(planned: PlannedRobot) -> dict[int, Turns]:
    """One turn of all that motors drive, at the phases of the plan: the motions of each body with
    parts from its place in the plan. The first pose is the plan's."""
    articulation = planned.articulation
    linkage = Linkage(articulation)
    members = _members(articulation)
    moved: dict[int, list[tuple[Floats, Floats]]] = {number: [] for number in members}
    for pose in range(_POSES):
        turn = 2 * math.pi * pose / _POSES
        # A gear that turns the leg once needs more turns of its motor, or fewer.
        angles = {f"motor_{drive.port}": turn * abs(drive.gear) for drive in articulation.drives}
        linkage.turn(angles)
        for number, part in members.items():
            rotation, shift_m = linkage.motion(part)
            moved[number].append((rotation.copy(), shift_m.copy()))
    turns: dict[int, Turns] = {}
    for number, motions in moved.items():
        rotations = np.array([rotation for rotation, _ in motions])
        shifts_m = np.array([shift_m for _, shift_m in motions])
        turns[number] = (rotations, shifts_m)
    return turns


def _members(articulation: Articulation) -> dict[int, int]:
    """One part of each body that has parts, which moves as the body does."""
    apart: set[int] = set()
    for follower in articulation.followers:
        apart.update(follower.parts)
    members: dict[int, int] = {}
    for number, body in enumerate(articulation.bodies):
        own = [part for part in body.parts if part not in apart]
        if own:
            members[number] = own[0]
    return members


def shapes_of(planned: PlannedRobot, number: int) -> Iterator[Shape]:
    """The convex solids of a body's parts, but for wheels and casters."""
    rolling = {wheel.part for wheel in planned.articulation.wheels}
    for part in planned.articulation.bodies[number].parts:
        placed = planned.plan.parts[part]
        if part in rolling or placed.part.is_loose:
            continue
        for solid in (*placed.part.solids, *placed.part.turning):
            yield _shape(number, placed, solid)


def _shape(
    body: int,
    placed: Placed,
    solid: Solid,
) -> Shape:
    """A solid of a part, in the twin's axes."""
    to_twin = TO_TWIN @ placed.rotation
    axes = np.array(solid.axes) @ to_twin.T
    first, second, third = solid.half
    form = solid.form
    if form is Form.RING:
        # The second size of a ring is its bore, which nothing of a floor goes into.
        second = first
        form = Form.CYLINDER
    return Shape(
        body,
        placed.index,
        form,
        point_m_of(placed.point(solid.centre)),
        axes,
        np.array([first, second, third]) * M_PER_LDU,
    )


def _joined_shapes(
    planned: PlannedRobot,
    number: int,
    turns: Turns,
) -> list[Shape]:
    """The shapes of a body, with level cylinders of one line joined."""
    return _joined([_if_level(shape, turns) for shape in shapes_of(planned, number)])


def _if_level(shape: Shape, turns: Turns) -> Shape:
    """A shape that knows whether it is a cylinder that lies on its side in all poses."""
    if shape.form is not Form.CYLINDER:
        return shape
    rotations, _ = turns
    slopes = np.abs((rotations @ shape.axis)[:, 2])
    return shape._replace(is_level=bool(slopes.max() < _LEVEL))


def _joined(shapes: Sequence[Shape]) -> list[Shape]:
    """The shapes, with level cylinders in one line and without a gap made one: a leg may be several
    beams thick. The lowest one in the plan gives the radius."""
    remaining = [shape for shape in shapes if shape.is_level]
    remaining.sort(key=lambda shape: shape.centre_m[2] - shape.half_m[0])
    joined = [shape for shape in shapes if not shape.is_level]
    while remaining:
        lowest = remaining[0]
        in_line = [shape for shape in remaining if _is_in_line(lowest, shape)]
        low_m, high_m = _without_gap(lowest, in_line)
        taken: set[int] = set()
        for shape in in_line:
            start_m, end_m = _along_m(lowest, shape)
            if start_m >= low_m and end_m <= high_m:
                taken.add(id(shape))
        remaining = [shape for shape in remaining if id(shape) not in taken]
        middle_m = (low_m + high_m) / 2
        radius_m, _, _ = lowest.half_m
        whole = lowest._replace(
            centre_m=lowest.centre_m + lowest.axis * middle_m,
            half_m=np.array([radius_m, radius_m, (high_m - low_m) / 2]),
        )
        joined.append(whole)
    return joined


def _is_in_line(lowest: Shape, shape: Shape) -> bool:
    """Whether two cylinders have one axis."""
    offset_m = shape.centre_m - lowest.centre_m
    across_m = np.linalg.norm(np.cross(offset_m, shape.axis))
    cosine = float(shape.axis @ lowest.axis)
    return bool(across_m < _SAME_AXIS_M and abs(cosine) > 0.99)


def _along_m(lowest: Shape, shape: Shape) -> tuple[float, float]:
    """Where a cylinder begins and ends on the axis of another one, from that one's middle."""
    ends_m = [float((end_m - lowest.centre_m) @ lowest.axis) for end_m in shape.ends_m]
    return min(ends_m), max(ends_m)


def _without_gap(lowest: Shape, in_line: Sequence[Shape]) -> tuple[float, float]:
    """Beginning and end of what belongs to a cylinder of those in its line, from its middle."""
    low_m, high_m = _along_m(lowest, lowest)
    # From the middle outwards, so that each one finds its neighbour there.
    spans_m = [_along_m(lowest, shape) for shape in in_line]
    for start_m, end_m in sorted(spans_m, key=lambda span: abs(span[0] + span[1])):
        if start_m < high_m + _GAP_M and end_m > low_m - _GAP_M:
            low_m = min(low_m, start_m)
            high_m = max(high_m, end_m)
    return low_m, high_m
