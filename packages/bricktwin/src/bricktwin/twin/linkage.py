"""Linkages: joints of a model that are turned without forces, while rods, gears and loops hold, as
those of a real robot from its sensors: joints from motor angles, chassis from the tilt, feet or
wheels on the floor; and of a ghost at its goal.
"""

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from bricktwin.plans.drawing.shapes import X_AXIS, Y_AXIS
from bricktwin.plans.geometry import Floats, triple
from bricktwin.plans.mechanism.articulation import Articulation
from bricktwin.twin.models.mjcf import SHAPE_GROUP, quaternion
from bricktwin.twin.models.turning import TurningParts, add_coupling, add_loop, add_rod, add_spinner
from bricktwin.twin.mujoco_body import MujocoBody, Pose
from bricktwin.twin.scene import Goal

_TURN_RAD = 0.25
"""Largest turn between two solutions, so that a linkage does not flip."""
_MAX_STEPS = 8
_STEP_RAD = 0.3
_TOLERANCE = 1e-6
_OPEN = 1e-3


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
    steps = max(1, math.ceil(np.abs(changes).max(initial=0.0) / _TURN_RAD))
    for _ in range(steps):
        data.qpos[addresses] += changes / steps
        if passive and model.neq:
            _close_loops(model, data, passive)


def _close_loops(model: mujoco.MjModel, data: mujoco.MjData, passive: Sequence[int]) -> None:
    """Gauss-Newton from the present angles."""
    addresses = model.jnt_qposadr[passive]
    dofs = model.jnt_dofadr[passive]
    start = data.qpos[addresses].copy()
    for _ in range(_MAX_STEPS):
        gaps, slopes = _constraints(model, data)
        if np.abs(gaps).max(initial=0.0) < _TOLERANCE:
            return
        step = np.linalg.lstsq(slopes[:, dofs], -gaps, rcond=1e-6)[0]
        data.qpos[addresses] += np.clip(step, -_STEP_RAD, _STEP_RAD)
    if np.abs(_constraints(model, data)[0]).max() > _OPEN:
        data.qpos[addresses] = start


def _constraints(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Floats, Floats]:
    """Residuals [n] of the equality constraints (m, rad), and their slopes [n, nv]."""
    for compute in (
        mujoco.mj_kinematics,
        mujoco.mj_comPos,
        mujoco.mj_tendon,
        mujoco.mj_makeConstraint,
    ):
        compute(model, data)
    slopes = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(
            slopes, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        )
    else:
        slopes = data.efc_J.reshape(slopes.shape)
    return data.efc_pos[: data.ne].copy(), slopes[: data.ne]


class Linkage:
    """Linkage of a building plan, whose parts follow its motors and free joints.

    Attributes:
        free: names of the joints that no motor, rod or loop turns; a ball joint is three.
    """

    def __init__(self, made: Articulation) -> None:
        spec = mujoco.MjSpec()
        self._gears = {f"motor_{drive.port}": drive.gear for drive in made.drives}
        drives = {drive.joint: f"motor_{drive.port}" for drive in made.drives}
        bodies = [spec.worldbody.add_body(name="body_0")]
        origins = [np.zeros(3)]
        for joint in made.joints:
            body = bodies[joint.parent].add_body(
                name=f"body_{joint.child}", pos=joint.point_m - origins[joint.parent]
            )
            body.explicitinertial = True
            body.mass = 1.0
            body.inertia = [1.0] * 3
            for number, axis in enumerate(np.eye(3) if joint.is_ball else [joint.axis]):
                name = drives.get(joint, f"joint_{joint.child}_{number}")
                body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
            bodies.append(body)
            origins.append(joint.point_m)
        for geared in made.geared:
            add_coupling(spec, geared, "", f"joint_{geared.joint.child}_0")
        for loop in made.loops:
            add_loop(
                spec,
                "",
                bodies[loop.parent],
                bodies[loop.child],
                triple(loop.point_m - origins[loop.parent]),
            )
        body_of = {
            part: body for number, body in enumerate(bodies) for part in made.bodies[number].parts
        }
        for number, rod in enumerate(made.rods):
            pins = (rod.near, rod.near_m), (rod.far, rod.far_m)
            near, far = ((bodies[end], tuple(at_m - origins[end])) for end, at_m in pins)
            body_of |= dict.fromkeys(rod.parts, add_rod(spec, str(number), near, far))
        for number, follower in enumerate(made.followers):
            at_m = triple(follower.point_m - origins[follower.body])
            body_of |= dict.fromkeys(
                follower.parts, add_spinner(bodies[follower.body], number, follower, at_m)
            )
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._body_of = {part: int(body.id) for part, body in body_of.items()}
        self._turning = TurningParts(model)
        names = [model.joint(joint).name for joint in range(model.njnt)]
        self._passive = [joint for joint, name in enumerate(names) if name not in self._gears]
        held = np.abs(_constraints(model, self._data)[1]).max(axis=0, initial=0.0) > _TOLERANCE
        self.free = tuple(
            names[joint] for joint in self._passive if not held[model.jnt_dofadr[joint]]
        )
        self.turn({})
        self._start_m, self._start_axes = (
            self._data.xpos.copy(),
            self._data.xmat.reshape(-1, 3, 3).copy(),
        )

    def turn(self, angles: Mapping[str, float]) -> None:
        """Turn joints to angles (rad) by name: those in `free`, and the shafts of motors,
        clockwise, such as ``"motor_A"``."""
        addresses = [int(self._model.joint(name).qposadr[0]) for name in angles]
        wanted = np.array([angle / self._gears.get(name, 1.0) for name, angle in angles.items()])
        turn_joints(
            self._model, self._data, addresses, wanted - self._data.qpos[addresses], self._passive
        )
        mujoco.mj_kinematics(self._model, self._data)
        self._turning.turn(self._model, self._data)

    def motion(self, part: int) -> tuple[Floats, Floats]:
        """Rotation [3, 3] and shift [3], m, of a part from its place in the plan; none of a part
        that is not in the linkage."""
        body = self._body_of.get(part, 0)
        turn = self._data.xmat[body].reshape(3, 3) @ self._start_axes[body].T
        return turn, self._data.xpos[body] - turn @ self._start_m[body]


def sensed_qpos(
    body: MujocoBody, angles_deg: dict[str, float], tilt_deg: tuple[float, float]
) -> Floats:
    """Positions of all joints of the model, solved from ``body``'s present ones, which are changed.

    Args:
        angles_deg: motor angles by name, at the output, as in Pybricks; whole turns are ignored.
        tilt_deg: pitch (nose down positive) and roll (right side down positive), as reported by the
            hub.
    """
    model = body.model
    data = body.data
    motors = [motor for motor in body.robot.motors if motor.name in angles_deg]
    joints = [model.joint(f"motor_{motor.port}") for motor in motors]
    addresses = [int(joint.qposadr[0]) for joint in joints]
    # Degrees of a motor's joint per degree at its output; the model counts the shaft, clockwise
    # positive.
    gears = [
        float(model.actuator_gear[model.actuator(f"motor_{motor.port}").id, 0]) for motor in motors
    ]
    factors = np.array(
        [
            motor.direction.value * 360.0 / motor.turn_deg / gear
            for motor, gear in zip(motors, gears, strict=True)
        ]
    )
    turns_deg = (
        np.array([angles_deg[motor.name] for motor in motors])
        - np.degrees(data.qpos[addresses]) / factors
    )
    turns_deg = (turns_deg + 180.0) % 360.0 - 180.0
    driven = {int(joint.id) for joint in joints}
    hinges = [
        joint
        for joint in range(model.njnt)
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE and joint not in driven
    ]
    passive = [joint for joint in hinges if not model.joint(joint).name.startswith("backlash_")]
    turn_joints(model, data, addresses, np.radians(turns_deg * factors), passive)
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        _stand(model, data, tilt_deg)
    qpos: Floats = data.qpos.copy()
    return qpos


def pose_at(body: MujocoBody, goal: Goal) -> None:
    """Put a body that is drawn only at a goal."""
    if goal.angles_deg:
        body.data.qpos[:] = sensed_qpos(body, dict(goal.angles_deg), (0.0, 0.0))
    if goal.at_mm is not None:
        body.put(Pose(goal.at_mm[0] / 1000, goal.at_mm[1] / 1000, goal.heading_deg))
    body.update_visuals()


def _stand(model: mujoco.MjModel, data: mujoco.MjData, tilt_deg: tuple[float, float]) -> None:
    """Tilt the chassis, and put the robot's lowest drawn point on the floor."""
    pitch, roll = map(math.radians, tilt_deg)
    data.qpos[0:3] = 0.0, 0.0, 1.0
    mujoco.mju_mulQuat(
        data.qpos[3:7], np.array(quaternion(Y_AXIS, pitch)), np.array(quaternion(X_AXIS, roll))
    )
    mujoco.mj_kinematics(model, data)
    drawn = np.flatnonzero(
        (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_group != SHAPE_GROUP)
    )
    middle = model.geom_aabb[drawn, :3]
    half = model.geom_aabb[drawn, 3:]
    frames = data.geom_xmat[drawn].reshape(-1, 3, 3)
    lowest = (
        data.geom_xpos[drawn, 2]
        + (frames[:, 2] * middle).sum(1)
        - (np.abs(frames[:, 2]) * half).sum(1)
    )
    data.qpos[2] -= float(lowest.min())
