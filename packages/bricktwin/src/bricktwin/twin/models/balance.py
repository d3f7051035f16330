"""Balance of a robot from a plan: where its centre of mass is above what it stands on, at the
angles of the plan and in one turn of its legs, and how far it tips.

A robot that is put down level rolls, over whatever of it touches the floor, as long as its centre
of mass comes lower so. All is at rest: what legs do by their speed is left to the twin.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brickhub.errors import PlanError
from brickhub.finding import Finding, Outcome
from bricktwin.plans.geometry import M_PER_LDU, Floats, Form, frame_of, triple
from bricktwin.plans.mechanism.kinematics import TO_TWIN, point_m_of
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.mechanism.roles import roles_of
from bricktwin.plans.part import DeviceKind
from bricktwin.plans.plan import Plan
from bricktwin.plans.planned_robot import PlannedRobot, planned_as_drawn
from bricktwin.twin.models.feet import Shape, Turns, feet_of, shapes_of, skids_of, turns_of

TIPS_DEG = 12.0
"""Tilt above which a robot does not stand as it was drawn. Below, it may lean on a skid."""
FALLS_DEG = 45.0
"""Tilt above which it does not come back."""
MOST_LEAN_DEG = 15.0
"""So far off upright, the wheels of a robot on one axle cannot get below it any more."""
_STEPS_DEG = (3.0, 1.0)
"""Steps in which it tips, first coarse, then fine."""
_DIRECTIONS = 24
"""Directions that are tried in each."""
_SIDES = 120
"""Directions in which the centre of mass may leave what the robot stands on."""
_DOWNHILL_M = 1e-5
"""Least fall of the centre of mass for each degree: friction and rounding hold less."""
_MOST_TILT_DEG = 100.0
_LEVEL = np.array([0.0, 0.0, -1.0])
"""What is downwards of a robot that is level."""
_TOUCHING_M = 0.003
"""Height above the lowest point up to which something counts as touching the floor."""
_BEYOND = {
    "forwards": ("in front of its front", "back"),
    "backwards": ("behind its back", "forwards"),
    "to the left": ("to the left of its left", "to the right"),
    "to the right": ("to the right of its right", "to the left"),
}
"""Where the centre of mass is of what the robot stands on, and where to move the hub, by the side
to which it tips."""


@dataclass(frozen=True)
class Balance:
    """Balance of a robot.

    Attributes:
        mass_g: its mass.
        height_mm: height of its centre of mass above the floor.
        inside_mm: how far that is inside of what the robot stands on, at the nearest side; negative
            outside.
        side: of the four sides the one to which that is.
        tilt_deg: how far the robot tips as it was drawn.
        largest_tilt_deg: how far at most in one turn of its legs, at the phases of the plan.
        on_wheels: whether it has wheels; else it stands on its feet.
        lean_deg: for a robot that stands on the wheels of one axle alone: how far it leans, nose
            down, when its centre of mass is above the axle; ``None`` for any other.
    """

    mass_g: float
    height_mm: float
    inside_mm: float
    side: str
    tilt_deg: float
    largest_tilt_deg: float
    on_wheels: bool
    lean_deg: float | None = None

    @property
    def can_balance(self) -> bool:
        """Whether the motors can keep it upright on one axle."""
        return self.lean_deg is not None and abs(self.lean_deg) <= MOST_LEAN_DEG

    @property
    def fault(self) -> str | None:
        """Why it does not stand, and what to do; ``None`` if it does."""
        beyond, remedy = _BEYOND[self.side]
        stands_on = "wheels" if self.on_wheels else "feet"
        beyond_mm = round(-self.inside_mm)
        place = f"{beyond_mm} mm {beyond} {stands_on}"
        if beyond_mm <= 0:
            place = f"right above the edge of its {stands_on}"
        where = f"its centre of mass, {self.height_mm:.0f} mm high, is {place}"
        upright = ", or let it learn to keep upright" if self.can_balance else ""
        if self.tilt_deg > TIPS_DEG:
            support = "add a caster" if self.on_wheels else "make its feet longer there"
            tips = f"tips over {self.side} by {self.tilt_deg:.0f} degrees"
            return f"it {tips}: {where}; move the hub {remedy}, or {support}{upright}"
        if self.lean_deg is not None:
            return f"it stands on one axle alone, and falls; add a caster{upright}"
        if self.largest_tilt_deg > FALLS_DEG:
            tips = f"falls {self.side} while its legs turn ({self.mass_g:.0f} g)"
            return f"it {tips}: {where}; make its feet wider there, or its legs shorter"
        return None

    @property
    def findings(self) -> list[Finding]:
        """That as a finding of a check; empty if it stands."""
        if self.fault is None:
            return []
        # Who falls by itself may be kept upright by its motors.
        outcome = Outcome.WARNING if self.can_balance else Outcome.ERROR
        return [Finding("balance", outcome, self.fault)]

    def __str__(self) -> str:
        inside = f"{self.inside_mm:.0f} mm inside of" if self.inside_mm >= 0 else "beyond"
        stands_on = "wheels" if self.on_wheels else "feet"
        return f"its centre of mass is {self.height_mm:.0f} mm high, {inside} its {stands_on}"


def balance_of(planned: PlannedRobot) -> Balance | None:
    """Balance of a robot that can move around; ``None`` of one without wheels and legs, or that
    stands on the table."""
    articulation = planned.articulation
    feet = feet_of(planned)
    if articulation.is_fixed or not (feet or articulation.wheels):
        return None
    # A crane may reach the floor with its boom, but does not go anywhere.
    has_legs = Role.LEG in roles_of(planned.plan, articulation).values()
    if not (has_legs or articulation.wheels):
        return None
    chassis = _outer(list(shapes_of(planned, 0)))
    shapes = [*feet, *chassis, *_wheels(planned)]
    drawn = _stance(planned, shapes, pose=0)
    worst = drawn
    # What does not stand as it was drawn need not be turned.
    if drawn.tilt_deg <= TIPS_DEG:
        poses, *_ = turns_of(planned)[0][0].shape
        stances = [_stance(planned, shapes, pose) for pose in range(poses)]
        worst = max(stances, key=lambda stance: stance.tilt_deg)
    shown = worst if worst.tilt_deg > FALLS_DEG else drawn
    mass_kg = sum(body.mass_kg for body in articulation.bodies)
    return Balance(
        mass_g=mass_kg * 1000,
        height_mm=shown.height_m * 1000,
        inside_mm=shown.inside_m * 1000,
        side=shown.side,
        tilt_deg=drawn.tilt_deg,
        largest_tilt_deg=worst.tilt_deg,
        on_wheels=bool(articulation.wheels),
        lean_deg=lean_on_one_axle_deg(planned),
    )


@functools.lru_cache(maxsize=16)
def lean_on_one_axle_deg(planned: PlannedRobot) -> float | None:
    """How far a robot leans, nose down, in balance on the wheels of one axle; ``None`` if it stands
    on more, or on the table."""
    articulation = planned.articulation
    wheels = articulation.wheels
    if articulation.is_fixed or len(wheels) < 2:
        return None
    shapes = [*feet_of(planned), *_outer(list(shapes_of(planned, 0))), *_wheels(planned)]
    axle_x_m, _, axle_z_m = wheels[0].centre_m
    are_on_axle = all(abs(wheel.centre_m[0] - axle_x_m) < _TOUCHING_M for wheel in wheels)
    contacts_m = np.concatenate([_contacts_m(shape) for shape in shapes])  # [n, 3]
    lowest_m = contacts_m[:, 2].min()
    touching_m = contacts_m[contacts_m[:, 2] < lowest_m + _TOUCHING_M]
    # What else is as low as the wheels bears the robot too.
    stands_on_more = bool((abs(touching_m[:, 0] - axle_x_m) > _TOUCHING_M).any())
    if not are_on_axle or stands_on_more:
        return None
    centre_m = _centre_m(planned, turns_of(planned), pose=0)
    above_m = float(centre_m[2] - axle_z_m)
    # A centre below the axle is at rest there: it needs nobody to keep it upright.
    if above_m <= 0:
        return None
    # Nose up brings what is ahead back above the axle.
    return -math.degrees(math.atan2(float(centre_m[0] - axle_x_m), above_m))


IN_THE_AIR = (
    "its driven wheels do not touch the floor, as something else is lower; take larger wheels, or "
    "put what is lower higher"
)
"""What is said of wheels that turn in the air."""


def turns_wheels_in_the_air(planned: PlannedRobot) -> bool:
    """Whether a robot has driven wheels, and none of them touches the floor where it comes to
    rest."""
    driven = {wheel.part for _, wheel in planned.rolling}
    if planned.articulation.is_fixed or not driven:
        return False
    wheels = list(_wheels(planned))
    shapes = [*feet_of(planned), *_outer(list(shapes_of(planned, 0))), *wheels]
    down = _rest(shapes, _centre_m(planned, turns_of(planned), pose=0))[None]
    lowest_m = max(float(shape.reach_m(down)[0]) for shape in shapes)
    heights_m = [lowest_m - float(one.reach_m(down)[0]) for one in wheels if one.part in driven]
    return min(heights_m, default=0.0) > _TOUCHING_M


class _Stance(NamedTuple):
    """Stance of a robot in a pose of its legs: how far it tips, where its centre of mass is inside
    of what it stands on and to which side that is nearest, and how high it is."""

    tilt_deg: float
    inside_m: float
    side: str
    height_m: float


def _stance(
    planned: PlannedRobot,
    shapes: Sequence[Shape],
    pose: int,
) -> _Stance:
    """The stance on some shapes in a pose of the turn."""
    turns = turns_of(planned)
    moved = [_moved(shape, turns, pose) for shape in shapes]
    centre_m = _centre_m(planned, turns, pose)
    down = _rest(moved, centre_m)
    tilt_deg = _tilt_deg(down)
    # Of a robot that leans a little, what it leans on touches the floor too.
    stands_on = down if tilt_deg <= TIPS_DEG else _LEVEL
    inside_m, side = _inside_m(moved, centre_m, stands_on)
    (height_m,) = _heights_m(moved, centre_m, stands_on[None])
    return _Stance(tilt_deg, inside_m, side, float(height_m))


def standing_shapes(planned: PlannedRobot) -> tuple[Shape, ...]:
    """What a robot without wheels stands on: its feet, and what its chassis drags where it cannot
    stand on these alone."""
    feet = feet_of(planned)
    if not feet or planned.articulation.wheels:
        return feet
    stance = _stance(planned, feet, pose=0)
    if stance.tilt_deg <= TIPS_DEG:
        return feet
    return (*feet, *skids_of(planned, feet))


def plan_balance(plan: Plan) -> Balance | None:
    """Balance of the robot of a plan; ``None`` where `balance_of` has none, for a plan that is no
    complete robot, and for one with unknown parts: one of them may be its caster."""
    robot = _known_robot(plan)
    return None if robot is None else balance_of(robot)


def plan_stance(plan: Plan) -> list[Finding]:
    """What is wrong with how the robot of a plan stands: its balance, and driven wheels in the
    air; nothing where that is not known, as of `plan_balance`."""
    robot = _known_robot(plan)
    if robot is None:
        return []
    balance = balance_of(robot)
    findings = [] if balance is None else balance.findings
    if turns_wheels_in_the_air(robot):
        findings.append(Finding("wheels", Outcome.ERROR, IN_THE_AIR))
    return findings


def _known_robot(plan: Plan) -> PlannedRobot | None:
    """The robot of a plan, if all of it is known."""
    if plan.unknown or not plan.devices(DeviceKind.HUB):
        return None
    try:
        return planned_as_drawn(plan)
    except PlanError:
        return None


def _wheels(planned: PlannedRobot) -> Iterator[Shape]:
    """Wheels and casters."""
    for wheel in planned.articulation.wheels:
        placed = planned.plan.parts[wheel.part]
        balls = [solid for solid in placed.part.solids if solid.form is Form.BALL]
        radius_m = wheel.diameter_mm / 2000
        if balls:
            ball = balls[0]
            yield Shape(
                wheel.link,
                wheel.part,
                Form.BALL,
                point_m_of(placed.point(ball.centre)),
                np.eye(3),
                np.array(ball.half) * M_PER_LDU,
            )
            continue
        low, high = placed.part.bounds
        width_ldu = float(high[2] - low[2])
        half_width_m = width_ldu / 2 * M_PER_LDU
        # Wheels of the parts library turn about their z axis.
        axis = triple(TO_TWIN @ placed.rotation[:, 2])
        yield Shape(
            wheel.link,
            wheel.part,
            Form.CYLINDER,
            wheel.centre_m,
            np.array(frame_of(axis)),
            np.array([radius_m, radius_m, half_width_m]),
            is_level=True,
        )


def _outer(shapes: Sequence[Shape]) -> list[Shape]:
    """Those shapes of a body that reach farthest in some direction in which it may tip: a few of
    hundreds."""
    tilts = np.radians(np.arange(0.0, _MOST_TILT_DEG, 8.0))
    angles = np.radians(np.arange(0.0, 360.0, 15.0))
    tilt, angle = np.meshgrid(tilts, angles)
    ahead = np.sin(tilt) * np.cos(angle)
    aside = np.sin(tilt) * np.sin(angle)
    directions = np.stack([ahead, aside, -np.cos(tilt)], axis=-1).reshape(-1, 3)
    reaches_m = np.array([shape.reach_m(directions) for shape in shapes])  # [shapes, n]
    farthest = np.unique(reaches_m.argmax(axis=0))
    return [shapes[number] for number in farthest]


def _moved(
    shape: Shape,
    turns: dict[int, Turns],
    pose: int,
) -> Shape:
    """A shape where it is in a pose of the turn."""
    if shape.body not in turns:
        return shape
    rotations, shifts_m = turns[shape.body]
    rotation = rotations[pose]
    centre_m = rotation @ shape.centre_m + shifts_m[pose]
    return shape._replace(centre_m=centre_m, axes=shape.axes @ rotation.T)


def _centre_m(
    planned: PlannedRobot,
    turns: dict[int, Turns],
    pose: int,
) -> Floats:
    """The centre of mass [3] in a pose of the turn."""
    moment = np.zeros(3)
    mass_kg = 0.0
    for number, body in enumerate(planned.articulation.bodies):
        centre_m = body.centre_m
        if number in turns:
            rotations, shifts_m = turns[number]
            centre_m = rotations[pose] @ centre_m + shifts_m[pose]
        moment += body.mass_kg * centre_m
        mass_kg += body.mass_kg
    return moment / mass_kg


def _tilt_deg(down: Floats) -> float:
    """Angle between a direction [3] and that downwards of the plan."""
    cosine = float(down @ _LEVEL)
    # Rounding may make it larger than 1.
    return math.degrees(math.acos(min(1.0, cosine)))


def _rest(shapes: Sequence[Shape], centre_m: Floats) -> Floats:
    """What direction [3] of a robot is downwards once it is at rest, if it is put down level."""
    down = _LEVEL
    around = _around(_DIRECTIONS)
    height_m = float(_heights_m(shapes, centre_m, down[None])[0])
    for step_deg in _STEPS_DEG:
        step = math.radians(step_deg)
        while _tilt_deg(down) < _MOST_TILT_DEG:
            first, second, _ = frame_of(triple(down))
            aside = around @ np.array([first, second])  # [n, 3]
            tried = math.cos(step) * down + math.sin(step) * aside
            heights_m = _heights_m(shapes, centre_m, tried)
            best = int(np.argmin(heights_m))
            if heights_m[best] > height_m - _DOWNHILL_M * step_deg:
                break
            down = tried[best]
            height_m = float(heights_m[best])
    return down


def _heights_m(
    shapes: Sequence[Shape],
    centre_m: Floats,
    downwards: Floats,
) -> Floats:
    """Height of the centre of mass above a floor, where directions [n, 3] are downwards [n]."""
    reaches_m = np.max([shape.reach_m(downwards) for shape in shapes], axis=0)
    return np.asarray(reaches_m - downwards @ centre_m)


def _inside_m(
    shapes: Sequence[Shape],
    centre_m: Floats,
    down: Floats,
) -> tuple[float, str]:
    """How far the centre of mass is inside of what touches the floor, at the nearest side, and that
    side."""
    contacts_m = np.concatenate([_contacts_m(shape) for shape in shapes])  # [n, 3]
    offsets_m = contacts_m - centre_m
    reaches_m = offsets_m @ down
    is_touching = reaches_m > reaches_m.max() - _TOUCHING_M
    # Seen from above, along what is downwards.
    from_above_m = offsets_m - np.outer(reaches_m, down)
    around = _around(_SIDES)
    spans_m = from_above_m[is_touching, :2] @ around.T  # [touching, sides]
    margins_m = spans_m.max(axis=0)
    nearest = int(np.argmin(margins_m))
    x, y = around[nearest]
    if abs(x) > abs(y):
        side = "forwards" if x > 0 else "backwards"
    else:
        side = "to the left" if y > 0 else "to the right"
    return float(margins_m[nearest]), side


def _around(count: int) -> Floats:
    """So many directions [count, 2] all around."""
    angles = np.arange(count) * 2 * math.pi / count
    return np.asarray(np.column_stack([np.cos(angles), np.sin(angles)]))


def _contacts_m(shape: Shape) -> Floats:
    """Points [n, 3] at which a shape may touch a level floor."""
    radius_m, *_ = shape.half_m
    below_m = np.array([0.0, 0.0, -radius_m])
    if shape.form is Form.BALL:
        return np.array([shape.centre_m + below_m])
    if shape.is_level:
        return np.asarray(np.array(shape.ends_m) + below_m)
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    corners_m = signs * shape.half_m  # [8, 3]
    return np.asarray(shape.centre_m + corners_m @ shape.axes)
