"""Turns of a hub, summed up."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from brickhub.robot import Mount, UltrasonicSensor
from bricktwin.robots import ROBO_ARM, WALKER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Wall
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.senses import Turns


def test_turns_about_two_axes_of_the_hub() -> None:
    turns, orientation = Turns(), np.array([1.0, 0.0, 0.0, 0.0])
    for axis in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)):
        for _ in range(18):
            mujoco.mju_quatIntegrate(orientation, np.array(axis), np.radians(5.0))
            turns.update(tuple(orientation.tolist()))
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


def test_sensor_on_the_base_of_an_arm_does_not_turn_with_the_hub() -> None:
    robot = replace(
        ROBO_ARM, sensors=(UltrasonicSensor("eyes", "F", Mount((100.0, 0.0, 50.0), "ahead")),)
    )
    quiet = Physics(distance_noise_mm=0, distance_noise_ratio=0)
    # A wall whose top is 4 mm below the sensor, whose rays are level, and another one behind it.
    scene = Scene(
        objects=(Wall((300, -500), (300, 500), height_mm=46.0), Wall((400, -500), (400, 500)))
    )
    body = MujocoBody(robot, scene, quiet, 0)
    assert body.distance_mm("F") == pytest.approx(292, abs=1)
    body.set_voltage("B", 6000)
    body.advance_to(1500)
    assert abs(body.heading_deg()) > 90.0
    assert body.distance_mm("F") == pytest.approx(292, abs=1)
    assert (body.pose().x_m, body.pose().y_m) == (0.0, 0.0)
