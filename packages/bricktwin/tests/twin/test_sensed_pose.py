"""Poses of a real robot from what its sensors say, and of a ghost at its goal."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from brickhub.robot import Robot
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER
from bricktwin.twin.make_body import make_body
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import Goal
from bricktwin.twin.sensed_pose import pose_at, sensed_qpos

VOLTAGES_MV = (3000, -2500, 2000, -3500)
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


def made(robot: Robot) -> MujocoBody:
    body = make_body(robot, physics=Physics(tilt_noise_deg=0.0))
    assert isinstance(body, MujocoBody)
    return body


def outputs_deg(body: MujocoBody) -> dict[str, float]:
    """Angles of the motors as a program with their gears reads them."""
    angles = {}
    for motor in body.robot.motors:
        shaft_deg = body.angle_mdeg(motor.port) / 1000
        angles[motor.name] = shaft_deg * motor.direction.value * motor.turn_deg / 360
    return angles


def hinges(body: MujocoBody) -> dict[str, int]:
    """Places of the positions of all hinges that are no play of a motor, by name."""
    model = body.model
    found = {}
    for number in range(model.njnt):
        joint = model.joint(number)
        if model.jnt_type[number] == _HINGE and "backlash" not in joint.name:
            found[joint.name] = int(joint.qposadr[0])
    return found


@pytest.mark.parametrize("robot", [WALKER, TWO_WHEELER, ROBO_ARM], ids=lambda robot: robot.name)
def test_joints_follow_the_motors_angles(robot: Robot) -> None:
    """The readings of one body turn another one, at rest, into its pose: driven joints, and those
    of linkages that no sensor sees."""
    body = made(robot)
    for motor, voltage_mv in zip(robot.motors, VOLTAGES_MV, strict=False):
        body.set_voltage(motor.port, voltage_mv)
    for time_ms in range(10, 600, 10):
        body.advance_to(time_ms)
    seen = sensed_qpos(made(robot), outputs_deg(body), body.tilt_deg())
    for name, address in hinges(body).items():
        apart = (seen[address] - body.data.qpos[address] + math.pi) % math.tau - math.pi
        # A rotation sensor tells whole degrees, and a crank has some play.
        assert abs(apart) < math.radians(7.0), name


@pytest.mark.parametrize("robot", [TWO_WHEELER, ROBO_ARM], ids=lambda robot: robot.name)
def test_whole_turns_say_nothing(robot: Robot) -> None:
    angles = {motor.name: 30.0 for motor in robot.motors}
    turned = {name: angle + 720.0 for name, angle in angles.items()}
    once, again = (sensed_qpos(made(robot), each, (0.0, 0.0)) for each in (angles, turned))
    assert np.allclose(once, again, atol=1e-9)


def test_tilt_turns_the_chassis_and_the_lowest_point_is_on_the_floor() -> None:
    heights = []
    for tilt_deg in ((0.0, 0.0), (20.0, 0.0), (0.0, 20.0)):
        body = made(TWO_WHEELER)
        body.data.qpos[:] = sensed_qpos(body, {}, tilt_deg)
        mujoco.mj_forward(body.model, body.data)
        assert body.tilt_deg() == pytest.approx(tilt_deg, abs=0.01)
        heights.append(float(body.data.qpos[2]))
    assert heights[0] < heights[1] and heights[0] < heights[2], "it stands on an edge"


def test_ghost_is_where_its_goal_says() -> None:
    body = made(TWO_WHEELER)
    pose_at(body, Goal(at_mm=(300.0, -200.0), heading_deg=90.0))
    pose = body.pose()
    assert (pose.x_m, pose.y_m, pose.heading_deg) == pytest.approx((0.3, -0.2, 90.0), abs=1e-3)
    arm = made(ROBO_ARM)
    wanted = {"rotation": 40.0, "low": -25.0}
    pose_at(arm, Goal(angles_deg=wanted))
    for name, angle_deg in wanted.items():
        assert outputs_deg(arm)[name] == pytest.approx(angle_deg, abs=1.5)
