"""Collision shapes of a plan's robot: tyres, casters, feet, and convex hulls of the other bodies."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from bricktwin.plans.geometry import M_PER_LDU, Floats, Form
from bricktwin.plans.mechanism.kinematics import TO_TWIN, Wheel
from bricktwin.plans.plan import Placed
from bricktwin.plans.planned_robot import PlannedRobot
from bricktwin.twin.models.mjcf import COLLIDING, add_caster, add_tyre, contact_attributes

PLASTIC_FRICTION = 0.8
"""Sliding friction of plastic on a smooth floor; an estimate."""
_FOOT_REACH_M = 0.015
"""Height above the robot's lowest point up to which a leg's lower end is a foot, in a robot without wheels."""
_SAME_AXIS_M = 0.0012


@dataclass(frozen=True, eq=False)
class Foot:
    """Round lower end of a leg: its body, the ends [3] of its axis in the twin's axes, and its radius."""

    body: int
    start_m: Floats
    end_m: Floats
    radius_m: float


def lowest_m(planned: PlannedRobot) -> float:
    """Height of the robot's lowest point in the plan."""
    articulation = planned.articulation
    lowest = [float(wheel.centre_m[2]) - wheel.diameter_mm / 2000 for wheel in _rolling(planned)]
    lowest += [float(foot.start_m[2]) - foot.radius_m for foot in feet(planned)]
    lowest += [_ball(planned, wheel)[2] - _ball(planned, wheel)[3] for wheel in _casters(planned)]
    if articulation.is_fixed or not lowest:
        lowest += [float(_corners(planned.plan.parts[part])[:, 2].min()) for body in articulation.bodies for part in body.parts]
    return min(lowest)


def feet(planned: PlannedRobot) -> tuple[Foot, ...]:
    """Feet of a robot without wheels; empty for others."""
    articulation = planned.articulation
    if articulation.is_fixed or articulation.wheels:
        return ()
    legs = []
    for number, body in enumerate(articulation.bodies):
        cylinders = [cylinder for part in body.parts for cylinder in _cylinders(planned.plan.parts[part])]
        if number == 0 or not cylinders:
            continue
        centre, axis, _, radius = min(cylinders, key=lambda cylinder: cylinder[0][2] - cylinder[3])
        ends = [
            other + axis * sign * half_length
            for other, other_axis, half_length, _ in cylinders
            for sign in (-1.0, 1.0)
            if np.linalg.norm(np.cross(other - centre, axis)) < _SAME_AXIS_M and abs(float(other_axis @ axis)) > 0.99
        ]
        along = np.array([float((end - centre) @ axis) for end in ends])
        legs.append(Foot(number, centre + axis * along.min(), centre + axis * along.max(), radius))
    low = min((foot.start_m[2] - foot.radius_m for foot in legs), default=0.0)
    standing = tuple(foot for foot in legs if foot.start_m[2] - foot.radius_m < low + _FOOT_REACH_M)
    return standing if len(standing) > 1 else ()  # nothing stands on one


def add_shapes(
    spec: mujoco.MjSpec,
    planned: PlannedRobot,
    bodies: dict[int, mujoco.MjsBody],
    origins: dict[int, Floats],
    ports: dict[int, str],
) -> None:
    """Add all collision shapes; tyres and feet are named after the port of their motor.

    Fixed robots have none: nothing collides within the ranges of their joints.
    """
    if planned.articulation.is_fixed:
        return
    for wheel in _rolling(planned):
        name = _free_name(spec, f"tyre_{ports.get(wheel.link, wheel.part)}")
        _add_wheel(planned, wheel, name, bodies[wheel.link], origins[wheel.link])
    for number, wheel in enumerate(_casters(planned)):
        *centre_m, radius = _ball(planned, wheel)
        name = "caster" if number == 0 else f"caster_{number}"
        add_caster(bodies[wheel.link], name, np.array(centre_m) - origins[wheel.link], radius)
    standing = feet(planned)
    for number, foot in enumerate(standing):
        ends = [*(foot.start_m - origins[foot.body]).tolist(), *(foot.end_m - origins[foot.body]).tolist()]
        shape = mujoco.mjtGeom.mjGEOM_CAPSULE
        name = _free_name(spec, f"foot_{ports.get(foot.body, number)}")
        size, attributes = [foot.radius_m, 0, 0], contact_attributes(PLASTIC_FRICTION)
        bodies[foot.body].add_geom(name=name, type=shape, fromto=ends, size=size, **attributes)
    for number, body in bodies.items():
        if number not in {foot.body for foot in standing} | {wheel.link for wheel in _rolling(planned)} or number == 0:
            _add_hull(spec, planned, number, body, origins[number])


def _free_name(spec: mujoco.MjSpec, name: str) -> str:
    """The name, or with a number if it is taken."""
    numbered = itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))
    return next(candidate for candidate in numbered if spec.geom(candidate) is None)


def _add_wheel(planned: PlannedRobot, wheel: Wheel, name: str, body: mujoco.MjsBody, origin: Floats) -> None:
    """Add the tyre of a wheel."""
    placed = planned.plan.parts[wheel.part]
    low, high = placed.part.bounds
    radius, half_width = wheel.diameter_mm / 2000, float(high[2] - low[2]) / 2 * M_PER_LDU
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, TO_TWIN @ placed.rotation[:, 2])
    add_tyre(body, name, (radius, radius, half_width), at_m=wheel.centre_m - origin, turn=quaternion)


def _add_hull(spec: mujoco.MjSpec, planned: PlannedRobot, number: int, body: mujoco.MjsBody, origin: Floats) -> None:
    """Add the convex hull of a body's parts, except wheels and casters. MuJoCo makes it from the points."""
    rolls = {wheel.part for wheel in planned.articulation.wheels}
    parts = [part for part in planned.articulation.bodies[number].parts if part not in rolls]
    if not parts:
        return
    points = np.concatenate([_corners(planned.plan.parts[part]) for part in parts]) - origin
    if np.ptp(points, axis=0).min() < 0.001:
        return
    # Corners closer than 2 mm make no difference in a collision.
    corners = points[np.unique(np.round(points / 0.002), axis=0, return_index=True)[1]]
    name = f"hull_{number}"
    spec.add_mesh(name=name, uservert=corners.ravel().tolist(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0, **COLLIDING)


def _rolling(planned: PlannedRobot) -> list[Wheel]:
    """Wheels that roll on the floor: the largest of those at one position, without casters."""
    wheels = sorted(planned.articulation.wheels, key=lambda wheel: -wheel.diameter_mm)
    rolling: list[Wheel] = []
    for wheel in wheels:
        if _is_caster(planned, wheel):
            continue
        if all(other.link != wheel.link or np.linalg.norm(other.centre_m - wheel.centre_m) > 0.008 for other in rolling):
            rolling.append(wheel)
    return rolling


def _casters(planned: PlannedRobot) -> list[Wheel]:
    return [wheel for wheel in planned.articulation.wheels if _is_caster(planned, wheel)]


def _is_caster(planned: PlannedRobot, wheel: Wheel) -> bool:
    return any(solid.form is Form.BALL for solid in planned.plan.parts[wheel.part].part.solids)


def _ball(planned: PlannedRobot, wheel: Wheel) -> tuple[float, float, float, float]:
    """Centre and radius of a caster's ball."""
    placed = planned.plan.parts[wheel.part]
    ball = next(solid for solid in placed.part.solids if solid.form is Form.BALL)
    x, y, z = _in_twin(placed, np.array([ball.centre]))[0].tolist()
    return x, y, z, ball.half[0] * M_PER_LDU


def _cylinders(placed: Placed) -> list[tuple[Floats, Floats, float, float]]:
    """Centre [3], axis [3], half length and radius of each horizontal cylinder of a part."""
    cylinders = []
    for solid in placed.part.solids:
        if solid.form is Form.CYLINDER:
            axis = TO_TWIN @ placed.rotation @ np.array(solid.axes[2])
            if abs(float(axis[2])) < 0.1:
                cylinders.append(
                    (_in_twin(placed, np.array([solid.centre]))[0], axis, solid.half[2] * M_PER_LDU, solid.half[0] * M_PER_LDU)
                )
    return cylinders


def _corners(placed: Placed) -> Floats:
    """Corner points [n, 3] of a part's solids."""
    return _in_twin(placed, placed.part.corners)


def _in_twin(placed: Placed, points: Floats) -> Floats:
    return np.asarray(placed.to_plan(points) @ TO_TWIN.T * M_PER_LDU)
