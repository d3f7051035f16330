"""Physics applied to a compiled MuJoCo model: friction, masses, backlash, motors, and the slope of the floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from brickhub.errors import TwinError
from brickhub.robot import MotorKind
from bricktwin.twin.models.mjcf import motor_constants
from bricktwin.twin.physics import Physics

SIDE_LOAD_OFFSET_M = (0.0, 0.048, 0.0)
"""Position of the side load relative to the chassis' centre of mass: 6 modules of LEGO to the left, in the hub's axes."""


def backlash_joints(model: mujoco.MjModel) -> list[int]:
    """Joints between a motor's shaft and what it drives."""
    return [joint for joint in range(model.njnt) if "backlash_" in model.joint(joint).name]


@dataclass(frozen=True)
class RobotPart:
    """Part of a model that is a robot: its actuators with the kinds of their motors, and its chassis if that moves freely."""

    motors: Sequence[tuple[int, MotorKind]]
    chassis: int | None


def set_physics(
    model: mujoco.MjModel, nominal: mujoco.MjModel, physics: Physics, robots: Sequence[RobotPart], bodies: Sequence[int]
) -> None:
    """Set a model's parameters. Raises TwinError if there is a side load, and a robot without a chassis that moves.

    Args:
        nominal: the same model as compiled.
        bodies: bodies whose masses are scaled.
    """
    model.opt.gravity[:] = nominal.opt.gravity[2] * up(physics)
    model.geom_friction[:] = nominal.geom_friction * physics.friction_scale
    model.pair_friction[:] = nominal.pair_friction * physics.friction_scale
    model.body_mass[bodies] = nominal.body_mass[bodies] * physics.mass_scale
    model.body_inertia[bodies] = nominal.body_inertia[bodies] * physics.mass_scale
    play = math.radians(physics.backlash_deg)
    model.jnt_range[backlash_joints(model)] = (-play, play)
    for robot in robots:
        for number, (actuator, kind) in enumerate(robot.motors):
            dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
            friction_nm = motor_constants(kind).friction_nm * abs(nominal.actuator_gear[actuator, 0])
            model.dof_frictionloss[dof] = nominal.dof_frictionloss[dof] + (physics.motor_friction_scale - 1.0) * friction_nm
            strength = physics.weak_motor_scale if number == 0 else 1.0
            model.actuator_gainprm[actuator, 0] = nominal.actuator_gainprm[actuator, 0] * strength
        if robot.chassis is not None:
            _add_side_load(model, nominal, robot.chassis, physics.side_load_g / 1000)
        elif physics.side_load_g:
            raise TwinError("physics: side_load_g is for robots that move; leave it at 0 for one that stands on a fixed base")
    mujoco.mj_setConst(model, mujoco.MjData(model))  # derives constants from the masses


def up(physics: Physics) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Upward direction [3] in the axes of the floor, which rises along x."""
    slope = math.radians(physics.slope_deg)
    return np.array([math.sin(slope), 0.0, math.cos(slope)])


def _add_side_load(model: mujoco.MjModel, nominal: mujoco.MjModel, body: int, load_kg: float) -> None:
    """Add a point mass at the side of a chassis: mass, centre of mass and inertia change (parallel axis theorem)."""
    model.body_ipos[body], model.body_iquat[body] = nominal.body_ipos[body], nominal.body_iquat[body]
    if load_kg == 0.0:
        return
    mass_kg, offset = float(model.body_mass[body]), np.array(SIDE_LOAD_OFFSET_M)
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, nominal.body_iquat[body])
    axes = frame.reshape(3, 3)
    reduced_kg = mass_kg * load_kg / (mass_kg + load_kg)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    inertia += reduced_kg * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    moments, columns = np.linalg.eigh(inertia)
    columns[:, 0] *= np.linalg.det(columns)  # a rotation, not a mirror image
    mujoco.mju_mat2Quat(model.body_iquat[body], columns.ravel())
    model.body_inertia[body] = moments
    model.body_ipos[body] = nominal.body_ipos[body] + offset * load_kg / (mass_kg + load_kg)
    model.body_mass[body] = mass_kg + load_kg
