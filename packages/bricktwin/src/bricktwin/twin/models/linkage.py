"""Linkage of a building plan: its joints are turned without forces, while rods, gears and loops
hold."""

import math
from collections.abc import Iterable, Mapping, Sequence

import mujoco
import numpy as np

from bricktwin.plans.geometry import Floats, triple
from bricktwin.plans.mechanism.articulation import Articulation
from bricktwin.plans.mechanism.open_gears import free_among
from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.models.turning import (
    add_coupling,
    add_gears,
    add_loop,
    add_rod,
    add_spinner,
)
from bricktwin.twin.models.turning_parts import TurningParts

_TURN_RAD = 0.25
"""Largest turn between two solutions, so that a linkage does not flip."""
_MAX_STEPS = 8
"""Most steps of Gauss-Newton for one solution."""
_STEP_RAD = 0.3
"""Largest change of a hinge in one of these steps, because near a dead centre the linear solution
is far off."""
_TOLERANCE = 1e-6
"""Residual (m, rad) below which constraints hold."""
_OPEN = 1e-3
"""Residual above which a linkage cannot be closed, and stays as it was."""


def turn_joints(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    addresses: Sequence[int],
    changes: Floats,
    passive: Sequence[int],
) -> None:
    """Turn joints, and the ``passive`` hinges so that all equality constraints hold.

    Args:
        addresses: of the joints' positions, which change by ``changes`` [n], rad.
        passive: indices of the hinges that follow; they stay where the constraints cannot hold.
    """
    largest_rad = np.abs(changes).max(initial=0.0)
    steps = max(1, math.ceil(largest_rad / _TURN_RAD))
    for _ in range(steps):
        data.qpos[addresses] += changes / steps
        if passive and model.neq:
            _close_loops(model, data, passive)


def _close_loops(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    passive: Sequence[int],
) -> None:
    """Gauss-Newton from the present angles."""
    addresses = model.jnt_qposadr[passive]
    dofs = model.jnt_dofadr[passive]
    start = data.qpos[addresses].copy()
    for _ in range(_MAX_STEPS):
        gaps, slopes = _constraints(model, data)
        if np.abs(gaps).max(initial=0.0) < _TOLERANCE:
            return
        # Least squares are used because the hinges may outnumber the constraints, or the other way
        # round.
        passive_slopes = slopes[:, dofs]
        solution = np.linalg.lstsq(passive_slopes, -gaps, rcond=1e-6)
        step = np.clip(solution[0], -_STEP_RAD, _STEP_RAD)
        data.qpos[addresses] += step
    gaps, _ = _constraints(model, data)
    if np.abs(gaps).max() > _OPEN:
        data.qpos[addresses] = start


def _constraints(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Floats, Floats]:
    """Residuals [n] of the equality constraints (m, rad), and their slopes [n, nv]."""
    # These are the stages of `mj_forward` that constraints need, in MuJoCo's order.
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    mujoco.mj_makeConstraint(model, data)
    slopes = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(
            slopes,
            data.efc_J,
            data.efc_J_rownnz,
            data.efc_J_rowadr,
            data.efc_J_colind,
        )
    else:
        # MuJoCo keeps room for the rows of all constraints, but leaves out those that no joint can
        # change; the rows that are left come first.
        slopes = data.efc_J.ravel()[: slopes.size].reshape(slopes.shape)
    # MuJoCo puts equalities first; friction, limits and contacts follow them.
    equalities = slice(0, data.ne)
    gaps = data.efc_pos[equalities].copy()
    return gaps, slopes[equalities]


class Linkage:
    """Linkage of a building plan, whose parts follow its motors and free joints.

    Attributes:
        free: names of the joints that no motor, rod or loop turns; a ball joint is three.
    """

    def __init__(self, made: Articulation) -> None:
        self._gears: dict[str, float] = {}
        for drive in made.drives:
            self._gears[f"motor_{drive.port}"] = drive.gear
        # Of motors on one gear, the first turns the others.
        driven = [drive.joint.child for drive in made.drives]
        free_bodies = set(free_among(made.couplings, driven)) if made.couplings else set(driven)
        leading = {f"motor_{one.port}" for one in made.drives if one.joint.child in free_bodies}
        spec = mujoco.MjSpec()
        body_of = _add_linkage(spec, made)
        model = spec.compile()
        data = mujoco.MjData(model)
        self._model = model
        self._data = data
        # Bodies have numbers only after compilation.
        self._body_of: dict[int, int] = {}
        for part, body in body_of.items():
            self._body_of[part] = int(body.id)
        self._turning = TurningParts(MujocoEngine(model, model, data))

        # A hinge that no constraint depends on is free, so a user can turn it.
        _, slopes = _constraints(model, data)
        steepest = np.abs(slopes).max(axis=0, initial=0.0)  # [nv]
        is_held = steepest > _TOLERANCE
        self._passive: list[int] = []
        free: list[str] = []
        for joint in range(model.njnt):
            name = model.joint(joint).name
            if name in leading:
                continue
            self._passive.append(joint)
            dof = model.jnt_dofadr[joint]
            if not is_held[dof]:
                free.append(name)
        self.free = tuple(free)

        # The start is measured after the loops are closed, because a plan may leave small gaps in
        # them.
        self.turn({})
        self._start_m = data.xpos.copy()  # [nbody, 3]
        self._start_axes = data.xmat.reshape(-1, 3, 3).copy()  # [nbody, 3, 3]

    def turn(self, angles: Mapping[str, float]) -> None:
        """Turn joints to angles (rad) by name: those in `free`, and the shafts of motors,
        clockwise, such as ``"motor_A"``."""
        model = self._model
        data = self._data
        addresses = []
        wanted = []
        for name, angle in angles.items():
            addresses.append(int(model.joint(name).qposadr[0]))
            # The angles are those of shafts, but the joints are behind the gears.
            gear = self._gears.get(name, 1.0)
            wanted.append(angle / gear)
        changes = np.array(wanted) - data.qpos[addresses]
        turn_joints(
            model,
            data,
            addresses,
            changes,
            self._passive,
        )
        mujoco.mj_kinematics(model, data)
        self._turning.turn()

    def motion(self, part: int) -> tuple[Floats, Floats]:
        """Rotation [3, 3] and shift [3], m, of a part from its place in the plan; none of a part
        that is not in the linkage."""
        body = self._body_of.get(part, 0)
        data = self._data
        axes = data.xmat[body].reshape(3, 3)
        turn = axes @ self._start_axes[body].T
        turned_start_m = turn @ self._start_m[body]
        shift_m = data.xpos[body] - turned_start_m
        return turn, shift_m


def _add_linkage(spec: mujoco.MjSpec, made: Articulation) -> dict[int, mujoco.MjsBody]:
    """Add the bodies, joints and constraints of a linkage, in the plan's configuration, to an empty
    model.

    Returns:
        The body that each part of the plan moves with, by the part's number.
    """
    drives = {drive.joint: f"motor_{drive.port}" for drive in made.drives}
    bodies = [spec.worldbody.add_body(name="body_0")]
    origins_m = [np.zeros(3)]
    names: dict[int, str] = {}
    for joint in made.joints:
        parent = bodies[joint.parent]
        at_m = joint.point_m - origins_m[joint.parent]
        body = parent.add_body(name=f"body_{joint.child}", pos=at_m)
        # Nothing here has forces, but MuJoCo does not compile a moving body without a mass.
        body.explicitinertial = True
        body.mass = 1.0
        body.inertia = [1.0] * 3
        # A ball joint becomes three hinges, so that each has an angle that a user can set.
        axes: Iterable[Floats] = np.eye(3) if joint.is_ball else [joint.axis]
        for number, axis in enumerate(axes):
            name = drives.get(joint, f"joint_{joint.child}_{number}")
            body.add_joint(
                name=name,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
            )
            names[joint.child] = name
        bodies.append(body)
        origins_m.append(joint.point_m)

    for geared in made.geared:
        add_coupling(
            spec,
            geared,
            "",
            f"joint_{geared.joint.child}_0",
        )
    for number, coupling in enumerate(made.couplings):
        joints = [(names[body], coefficient) for body, coefficient in coupling.coefficients]
        add_gears(spec, f"gears_{number}", joints)
    for loop in made.loops:
        pin_m = triple(loop.point_m - origins_m[loop.parent])
        add_loop(
            spec,
            "",
            bodies[loop.parent],
            bodies[loop.child],
            pin_m,
        )

    body_of: dict[int, mujoco.MjsBody] = {}
    for number, body in enumerate(bodies):
        for part in made.bodies[number].parts:
            body_of[part] = body
    # Rods, shafts and gears belong to those bodies too, but move apart from them. They are added
    # last, to replace the entries of their parts.
    for number, rod in enumerate(made.rods):
        near_m = tuple(rod.near_m - origins_m[rod.near])
        far_m = tuple(rod.far_m - origins_m[rod.far])
        near = (bodies[rod.near], near_m)
        far = (bodies[rod.far], far_m)
        body = add_rod(spec, str(number), near, far)
        for part in rod.parts:
            body_of[part] = body
    for number, follower in enumerate(made.followers):
        carrier = bodies[follower.body]
        axle_m = triple(follower.point_m - origins_m[follower.body])
        body = add_spinner(
            carrier,
            number,
            follower,
            axle_m,
        )
        for part in follower.parts:
            body_of[part] = body
    return body_of
