"""Physics in a model: its parameters for a robot's :class:`~bricktwin.twin.physics.Physics`, always
from the nominal ones, so that a second call does not multiply what the first one did."""

import math
from collections.abc import Collection, Sequence
from typing import Protocol

from brickhub.errors import TwinError
from brickhub.robot import Robot
from bricktwin.twin.bindings import Motors
from bricktwin.twin.engines.conventions import BACKLASH
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import (
    Matrix,
    Vector,
    dot,
    matrix_of,
    plus,
    principal_axes,
    times,
    vector,
)
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.physics import Physics

SIDE_LOAD_OFFSET_M = (0.0, 0.048, 0.0)
"""Position of the side load relative to the chassis' centre of mass: 6 modules of LEGO to the left,
in the hub's axes."""


class Placed(Protocol):
    """What the physics of a robot depend on.

    Attributes:
        robot: its description.
        motors: where its motors are in the model.
        chassis: index of its first body; ``moves``: whether it moves freely.
    """

    robot: Robot
    motors: Motors
    chassis: int
    moves: bool


def up(physics: Physics) -> Vector:
    """Upward direction in the axes of the floor, which rises along x."""
    slope = math.radians(physics.slope_deg)
    return math.sin(slope), 0.0, math.cos(slope)


def backlash_joints(engine: Engine) -> list[int]:
    """Joints between a motor's shaft and what it drives."""
    return [joint for joint, name in enumerate(engine.names("joint")) if BACKLASH in name]


def set_physics(
    engine: Engine,
    physics: Physics,
    robots: Sequence[Placed],
    bodies: Collection[int],
) -> None:
    """Set a model's parameters. Raises TwinError if there is a side load, and a robot without a
    chassis that moves.

    Args:
        bodies: bodies whose masses are scaled.
    """
    # A slope is a floor that stays level under a gravity that is aslant.
    downwards = engine.nominal_gravity[2]
    for axis, share in enumerate(up(physics)):
        engine.gravity[axis] = downwards * share
    for field in ("geom_friction", "pair_friction"):
        nominal = engine.nominal(field)
        engine.set_parameters(field, [value * physics.friction_scale for value in nominal])
    _set_masses(
        engine,
        physics,
        robots,
        bodies,
    )
    play = math.radians(physics.backlash_deg)
    ranges = engine.parameters("jnt_range")
    for joint in backlash_joints(engine):
        ranges[2 * joint : 2 * joint + 2] = (-play, play)
    for robot in robots:
        for joint, share in robot.motors.plays:
            ranges[2 * joint : 2 * joint + 2] = (-share * play, share * play)
    engine.set_parameters("jnt_range", ranges)
    for robot in robots:
        _set_tyres(engine, physics, robot)
        _set_motors(engine, physics, robot)
    engine.derive_constants()


def _set_masses(
    engine: Engine,
    physics: Physics,
    robots: Sequence[Placed],
    bodies: Collection[int],
) -> None:
    """Set the masses of bodies, and the side loads of robots."""
    masses_kg = engine.parameters("body_mass")
    inertias = engine.parameters("body_inertia")
    nominal_kg = engine.nominal("body_mass")
    nominal_inertias = engine.nominal("body_inertia")
    for body in bodies:
        masses_kg[body] = nominal_kg[body] * physics.mass_scale
        for number in range(3 * body, 3 * body + 3):
            inertias[number] = nominal_inertias[number] * physics.mass_scale
    centres_m = engine.parameters("body_ipos")
    turns = engine.parameters("body_iquat")
    for robot in robots:
        if not robot.moves:
            if physics.side_load_g:
                raise TwinError(
                    "physics: side_load_g is for robots that move; leave it at 0 for one that "
                    "stands on a fixed base"
                )
            continue
        body = robot.chassis
        of_vector = slice(3 * body, 3 * body + 3)
        of_turn = slice(4 * body, 4 * body + 4)
        centres_m[of_vector] = engine.nominal("body_ipos")[of_vector]
        turns[of_turn] = engine.nominal("body_iquat")[of_turn]
        load_kg = physics.side_load_g / 1000
        if load_kg == 0.0:
            continue
        mass_kg = masses_kg[body]
        inertias[of_vector], turns[of_turn] = _loaded(
            vector(inertias[of_vector]),
            matrix_of(turns[of_turn]),
            mass_kg,
            load_kg,
        )
        shift_m = times(load_kg / (mass_kg + load_kg), SIDE_LOAD_OFFSET_M)
        centres_m[of_vector] = plus(vector(centres_m[of_vector]), shift_m)
        masses_kg[body] = mass_kg + load_kg
    engine.set_parameters("body_mass", masses_kg)
    engine.set_parameters("body_inertia", inertias)
    engine.set_parameters("body_ipos", centres_m)
    engine.set_parameters("body_iquat", turns)


def _loaded(
    moments: Vector,
    axes: Matrix,
    mass_kg: float,
    load_kg: float,
) -> tuple[Vector, Sequence[float]]:
    """Principal moments and axes of a chassis with a point mass at its side (parallel axis
    theorem)."""
    # Steiner's theorem for two masses: about their common centre, they count as one mass (the
    # reduced one) at their distance.
    reduced_kg = mass_kg * load_kg / (mass_kg + load_kg)
    offset_m = SIDE_LOAD_OFFSET_M
    square = dot(offset_m, offset_m)
    rows = []
    for row in range(3):
        values = []
        for column in range(3):
            # In the body's axes.
            parts = zip(axes[row], axes[column], moments, strict=True)
            value = sum(first * second * moment for first, second, moment in parts)
            spread = square if row == column else 0.0
            value += reduced_kg * (spread - offset_m[row] * offset_m[column])
            values.append(value)
        rows.append(vector(values))
    first_row, second_row, third_row = rows
    return principal_axes((first_row, second_row, third_row))


def _set_tyres(
    engine: Engine,
    physics: Physics,
    robot: Placed,
) -> None:
    """Make one tyre of a drive base larger than the other."""
    for field in ("geom_size", "geom_rbound", "geom_aabb"):
        nominal = engine.nominal(field)
        values = engine.parameters(field)
        width = len(values) // len(engine.names("geom"))
        # Half of the difference for each wheel, so that their mean stays; robots without wheels
        # have no tyres.
        for tyre, share in zip(robot.motors.tyres, (0.5, -0.5), strict=False):
            scale = 1.0 + share * physics.wheel_difference_pct / 100.0
            for number in range(width * tyre, width * tyre + width):
                values[number] = nominal[number] * scale
        engine.set_parameters(field, values)


def _set_motors(
    engine: Engine,
    physics: Physics,
    robot: Placed,
) -> None:
    """Set the motors' friction and speed."""
    if not robot.motors.terminals:
        return
    frictions_nm = engine.parameters("dof_frictionloss")
    drags = engine.parameters("actuator_biasprm")
    nominal_frictions_nm = engine.nominal("dof_frictionloss")
    nominal_drags = engine.nominal("actuator_biasprm")
    gears = engine.nominal("actuator_gear")
    motors = robot.motors
    width = len(drags) // len(engine.names("actuator"))
    described = zip(robot.robot.motors, motors.dofs, physics.motor_scales, strict=False)
    for motor, dof, scale in described:
        actuator, _ = motors.terminals[motor.port]
        # The joint has the friction of a gear train too, which is not the motor's.
        gear = abs(gears[6 * actuator])
        friction_nm = motor_constants(motor.kind).friction_nm * gear
        added_nm = (physics.motor_friction_scale - 1.0) * friction_nm
        frictions_nm[dof] = nominal_frictions_nm[dof] + added_nm
        # A faster motor has less back-EMF per speed, and the same torque at a standstill.
        drag = width * actuator + 2
        drags[drag] = nominal_drags[drag] / scale
    engine.set_parameters("dof_frictionloss", frictions_nm)
    engine.set_parameters("actuator_biasprm", drags)
