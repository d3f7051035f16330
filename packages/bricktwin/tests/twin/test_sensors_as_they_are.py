"""Biases and failures of a twin's sensors: what a program on the virtual hub reads."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest

from brickhub.virtual.run import run_file
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Block, Ramp, Wall
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.standing import Pose

QUIET = Physics(
    distance_noise_mm=0,
    distance_noise_ratio=0,
    tilt_noise_deg=0,
    gyro_noise_deg_s=0,
    acceleration_noise_mm_s2=0,
)
EYES = "C"


def body(scene: Scene = OPEN_FLOOR, **values: float) -> MujocoBody:
    return MujocoBody(TWO_WHEELER, scene, dataclasses.replace(QUIET, **values), 0)


def turn_by_hand(robot: MujocoBody, deg: int) -> None:
    for heading_deg in range(0, deg + 1, 10):
        robot.put(Pose(0.0, 0.0, heading_deg))
        robot.update_turns()


def test_gyroscope_scale_error_and_drift() -> None:
    robot = body(gyro_scale_error_pct=0.9, gyro_drift_deg_min=6.0)
    turn_by_hand(robot, 360)
    assert robot.heading_deg() == pytest.approx(360 * 1.009, abs=0.01)
    assert robot.rotation_deg()[2] == pytest.approx(-360 * 1.009, abs=0.01)
    assert robot.pose().heading_deg == pytest.approx(360, abs=0.01), "the truth is exact"
    robot.advance_to(10_000)
    assert robot.heading_deg() == pytest.approx(360 * 1.009 + 1.0, abs=0.03)
    assert robot.rotation_deg()[2] == pytest.approx(-360 * 1.009 - 1.0, abs=0.03)
    assert robot.angular_velocity_deg_s()[2] == pytest.approx(-0.1, abs=0.02), (
        "the drift is in the rate, too"
    )


def test_the_bias_of_the_accelerometer_tilts_the_hub(tmp_path: Path) -> None:
    biased = body(
        acceleration_bias_x_mm_s2=171.0,
        acceleration_bias_y_mm_s2=-86.0,
        acceleration_bias_z_mm_s2=50.0,
    )
    assert biased.acceleration_mm_s2() == pytest.approx((171, -86, 9860), abs=10), (
        "the robot leans by 0.05 degrees"
    )
    (tmp_path / "main.py").write_text(
        "from pybricks.hubs import PrimeHub\nprint(*PrimeHub().imu.tilt())\n"
    )
    out = io.BytesIO()
    assert run_file(tmp_path / "main.py", biased, stdout=out) == 0
    assert [float(word) for word in out.getvalue().split()] == pytest.approx((-1.0, -0.5), abs=0.06)


@pytest.mark.parametrize(
    ("angle_deg", "is_seen"), [(0, True), (30, True), (45, True), (50, False), (60, False)]
)
def test_a_hard_wall_mirrors_sound(angle_deg: float, is_seen: bool) -> None:
    scene = Scene(wall_distance_mm=(500, 500), heading_deg=(angle_deg, angle_deg))
    assert (body(scene).distance_mm(EYES) < 2000) is is_seen, (
        "the cone of 12 degrees and the limit of 35"
    )
    assert body(scene, echo_angle_deg=60.0).distance_mm(EYES) < 2000


@pytest.mark.parametrize(
    ("thing", "soft"),
    [
        (
            Wall((1600, -500), (1600, 500), height_mm=300),
            Wall((1600, -500), (1600, 500), height_mm=300, soft=True),
        ),
        (Block((1600, 0), (60, 600, 300)), Block((1600, 0), (60, 600, 300), soft=True)),
        (Ramp((1300, 0), 400, 600, 400), Ramp((1300, 0), 400, 600, 400, soft=True)),
    ],
)
def test_what_is_soft_is_seen_late(thing: Wall | Block | Ramp, soft: Wall | Block | Ramp) -> None:
    wide = {"echo_angle_deg": 90.0}
    hard_mm = body(Scene(objects=(thing,)), **wide).distance_mm(EYES)
    assert hard_mm < 1600
    for range_mm, seen_mm in ((hard_mm - 5.0, 2000), (hard_mm + 5.0, hard_mm)):
        assert (
            body(Scene(objects=(soft,)), soft_range_mm=range_mm, **wide).distance_mm(EYES)
            == seen_mm
        )
    oblique = Scene(objects=(Wall((300, -900), (1500, 900), height_mm=300, soft=True),))
    assert body(oblique, echo_angle_deg=1.0).distance_mm(EYES) < 2000, "it scatters sound"


def test_distance_bias_and_failures() -> None:
    wall = Scene(wall_distance_mm=(300, 300))
    assert body(wall, distance_bias_mm=-17.0).distance_mm(EYES) == 283
    failing = body(wall, distance_dropout_share=0.1)
    readings = [failing.distance_mm(EYES) for _ in range(3000)]
    assert set(readings) == {300, 2000}
    assert readings.count(2000) / 3000 == pytest.approx(0.1, abs=0.02)


def test_a_larger_left_wheel_curves_to_the_right() -> None:
    headings = []
    for difference_pct in (-1.0, 0.0, 1.0):
        robot = body(wheel_difference_pct=difference_pct)
        robot.set_voltage("E", -5000)
        robot.set_voltage("A", 5000)
        robot.advance_to(3000)
        headings.append(robot.pose().heading_deg)
    assert headings[0] < headings[1] - 3 and headings[2] > headings[1] + 3


@pytest.mark.parametrize("robot", [TWO_WHEELER, WALKER])
def test_biases_are_drawn_once_for_an_episode(robot) -> None:
    one, rng = MujocoBody(robot, OPEN_FLOOR, RandomPhysics(), 0), np.random.default_rng(1)
    names = (
        "gyro_scale_error_pct",
        "gyro_drift_deg_min",
        "acceleration_bias_x_mm_s2",
        "distance_bias_mm",
        "echo_angle_deg",
    )
    drawn = []
    for _ in range(2):
        one.reset(rng)
        before = one.physics
        one.advance_to(100 * (len(drawn) + 1))
        assert one.physics is before
        drawn.append([getattr(before, name) for name in names])
    assert all(first != second for first, second in zip(*drawn, strict=True))
