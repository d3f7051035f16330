"""Pose of a robot from its sensors: joints from motor angles, while rods, gears and loops hold;
chassis from the tilt, feet or wheels on the floor. And that of a ghost at its goal."""

import math

import mujoco
import numpy as np

from bricktwin.plans.drawing.shapes import X_AXIS, Y_AXIS
from bricktwin.plans.geometry import Floats
from bricktwin.twin.engines.conventions import SHAPE_GROUP
from bricktwin.twin.models.linkage import turn_joints
from bricktwin.twin.models.mjcf import quaternion
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.scene import Goal
from bricktwin.twin.standing import Pose


def sensed_qpos(
    body: MujocoBody,
    angles_deg: dict[str, float],
    tilt_deg: tuple[float, float],
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
    # Angles are given at the outputs, so they are converted to the joints; the model counts the
    # shaft, clockwise positive.
    joint_per_output = []
    for motor in motors:
        actuator = model.actuator(f"motor_{motor.port}").id
        gear = float(model.actuator_gear[actuator, 0])
        shaft_per_output = motor.direction.value * 360.0 / motor.turn_deg
        joint_per_output.append(shaft_per_output / gear)
    factors = np.array(joint_per_output)
    sensed_deg = np.array([angles_deg[motor.name] for motor in motors])
    present_deg = np.degrees(data.qpos[addresses]) / factors
    # A sensor's whole turns say nothing about the robot, so each joint goes the shorter way round.
    turns_deg = (sensed_deg - present_deg + 180.0) % 360.0 - 180.0

    # Passive hinges follow the others: no sensor tells their angles, and they are no play of a
    # motor.
    driven = {int(joint.id) for joint in joints}
    passive = []
    for joint in range(model.njnt):
        is_hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        is_play = model.joint(joint).name.startswith("backlash_")
        if is_hinge and joint not in driven and not is_play:
            passive.append(joint)
    turn_joints(
        model,
        data,
        addresses,
        np.radians(turns_deg * factors),
        passive,
    )
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        _stand(model, data, tilt_deg)
    qpos: Floats = data.qpos.copy()
    return qpos


def pose_at(body: MujocoBody, goal: Goal) -> None:
    """Put a body that is drawn only at a goal."""
    if goal.angles_deg:
        level = (0.0, 0.0)
        body.data.qpos[:] = sensed_qpos(body, dict(goal.angles_deg), level)
    if goal.at_mm is not None:
        x_mm, y_mm = goal.at_mm
        body.put(Pose(x_mm / 1000, y_mm / 1000, goal.heading_deg))
    body.update_visuals()


def _stand(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    tilt_deg: tuple[float, float],
) -> None:
    """Tilt the chassis, and put the robot's lowest drawn point on the floor."""
    pitch, roll = map(math.radians, tilt_deg)
    data.qpos[0:3] = 0.0, 0.0, 1.0
    pitched = np.array(quaternion(Y_AXIS, pitch))
    rolled = np.array(quaternion(X_AXIS, roll))
    mujoco.mju_mulQuat(data.qpos[3:7], pitched, rolled)
    mujoco.mj_kinematics(model, data)

    # The robot stands on what can be seen of it, not on the shapes that collide.
    is_moving = model.body_weldid[model.geom_bodyid] != 0
    is_drawn = model.geom_group != SHAPE_GROUP
    drawn = np.flatnonzero(is_moving & is_drawn)
    # The lowest corner of each bounding box needs only the row of heights of its frame.
    middle_m = model.geom_aabb[drawn, :3]  # [n, 3]
    half_m = model.geom_aabb[drawn, 3:]  # [n, 3]
    frames = data.geom_xmat[drawn].reshape(-1, 3, 3)
    heights = frames[:, 2]  # [n, 3]
    raised_m = (heights * middle_m).sum(1)
    centres_m = data.geom_xpos[drawn, 2] + raised_m
    reach_m = (np.abs(heights) * half_m).sum(1)
    lowest_m = centres_m - reach_m
    data.qpos[2] -= float(lowest_m.min())
