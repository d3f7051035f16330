"""Turns of a hub, summed up."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from bricksrl.robots import WALKER
from bricksrl.twin.imu import Turns
from bricksrl.twin.mujoco_body import MujocoBody
from bricksrl.twin.physics import Physics
from bricksrl.twin.scene import OPEN_FLOOR


def test_turns_about_two_axes_of_the_hub() -> None:
    turns, orientation = Turns(), np.array([1.0, 0.0, 0.0, 0.0])
    for axis in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)):
        for _ in range(18):
            mujoco.mju_quatIntegrate(orientation, np.array(axis), np.radians(5.0))
            turns.update(orientation)
    assert np.degrees(turns.rotation_rad) == pytest.approx([90.0, 0.0, 90.0])
    assert turns.heading_deg == pytest.approx(-90.0)


def test_gyroscope_of_a_walking_robot_adds_up_to_its_rotation() -> None:
    body = MujocoBody(WALKER, OPEN_FLOOR, Physics(), seed=0)
    for motor, voltage_mv in zip(WALKER.motors, (4000, -3000, 2500, -5000), strict=True):
        body.set_voltage(motor.port, voltage_mv)
    total, way, before = np.zeros(3), np.zeros(3), np.array(body.rotation_deg())
    for step in range(1, 801):
        body.advance_to(step * 5 // 2 + 1)
        turned = np.degrees(body._base.angular_velocity()) * 0.0025
        total += turned
        way += abs(turned)
    assert way.min() > 5.0  # about every axis, to and fro
    assert np.array(body.rotation_deg()) - before == pytest.approx(total, abs=0.2)
