"""Pose of a robot that is drawn only: of a real one from its sensors, joints from motor angles, chassis from the tilt, feet or
wheels on the floor; of a ghost at its goal."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from bricktwin.twin.linkage import turn_joints
from bricktwin.twin.models.mjcf import SHAPE_GROUP
from bricktwin.twin.mujoco_body import MujocoBody, Pose
from bricktwin.twin.scene import Goal


def sensed_qpos(body: MujocoBody, angles_deg: dict[str, float], tilt_deg: tuple[float, float]) -> NDArray[np.float64]:
    """Positions of all joints of the model, solved from ``body``'s present ones, which are changed.

    Args:
        angles_deg: motor angles by name, at the output, as in Pybricks; whole turns are ignored.
        tilt_deg: pitch (nose down positive) and roll (right side down positive), as reported by the hub.
    """
    model, data = body.model, body.data
    motors = [motor for motor in body.robot.motors if motor.name in angles_deg]
    joints = [model.joint(f"motor_{motor.port}") for motor in motors]
    addresses = [int(joint.qposadr[0]) for joint in joints]
    # Degrees of a motor's joint per degree at its output; the model counts the shaft, clockwise positive.
    gears = [float(model.actuator_gear[model.actuator(f"motor_{motor.port}").id, 0]) for motor in motors]
    factors = np.array([motor.direction.value * 360.0 / motor.turn_deg / gear for motor, gear in zip(motors, gears, strict=True)])
    turns_deg = np.array([angles_deg[motor.name] for motor in motors]) - np.degrees(data.qpos[addresses]) / factors
    turns_deg = (turns_deg + 180.0) % 360.0 - 180.0
    driven = {int(joint.id) for joint in joints}
    hinges = [
        joint for joint in range(model.njnt) if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE and joint not in driven
    ]
    passive = [joint for joint in hinges if not model.joint(joint).name.startswith("backlash_")]
    turn_joints(model, data, addresses, np.radians(turns_deg * factors), passive)
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        _stand(model, data, tilt_deg)
    qpos: NDArray[np.float64] = data.qpos.copy()
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
    pitch, roll = (math.radians(angle) / 2 for angle in tilt_deg)
    quaternion = np.empty(4)
    pitch_quaternion = np.array([math.cos(pitch), 0.0, math.sin(pitch), 0.0])
    mujoco.mju_mulQuat(quaternion, pitch_quaternion, np.array([math.cos(roll), math.sin(roll), 0.0, 0.0]))
    data.qpos[0:7] = (0.0, 0.0, 1.0, *quaternion)
    mujoco.mj_kinematics(model, data)
    drawn = np.flatnonzero((model.body_weldid[model.geom_bodyid] != 0) & (model.geom_group != SHAPE_GROUP))
    middle, half = model.geom_aabb[drawn, :3], model.geom_aabb[drawn, 3:]
    frames = data.geom_xmat[drawn].reshape(-1, 3, 3)
    lowest = data.geom_xpos[drawn, 2] + (frames[:, 2] * middle).sum(1) - (np.abs(frames[:, 2]) * half).sum(1)
    data.qpos[2] -= float(lowest.min())
