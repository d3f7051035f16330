"""Robots that are put down: where they stand, how they are held, and what is drawn for a start."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.robot import (
    Direction,
    DriveBase,
    HubKind,
    Motor,
    Mount,
    Robot,
    UltrasonicSensor,
)
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.objects import Block
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.standing import Pose, _choice_of

EYES_MM = (60.0, 25.0, 40.0)
CART = Robot(
    "cart",
    HubKind.PRIME,
    motors=(Motor("left", "A", direction=Direction.COUNTERCLOCKWISE), Motor("right", "B")),
    sensors=(UltrasonicSensor("eyes", "C", Mount(EYES_MM, "ahead")),),
    drive_base=DriveBase("left", "right", wheel_diameter_mm=56, axle_track_mm=130),
    needs_imu=True,
)
QUIET = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)


class Ends:
    """A generator that draws the lower or the upper end of each range, and keeps the ranges."""

    def __init__(self, *, upper: bool = False) -> None:
        self._upper = upper
        self.ranges: list[tuple[float, float]] = []

    def uniform(self, low: float, high: float) -> float:
        self.ranges.append((low, high))
        return high if self._upper else low


def cart(scene: Scene = OPEN_FLOOR, physics: Physics | RandomPhysics = QUIET) -> MujocoBody:
    return MujocoBody(CART, scene, physics, 0)


def ahead(body: MujocoBody) -> Any:
    """Where the front of the robot looks."""
    return body.data.body("chassis").xmat.reshape(3, 3)[:, 0]


def test_an_end_is_chosen_for_each_range_in_turn() -> None:
    choose = _choice_of((True, False, True))
    assert [choose(1.0, 2.0), choose(3.0, 4.0), choose(5.0, 6.0)] == [2.0, 3.0, 6.0]


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -45.0, 170.0])
def test_a_robot_is_put_where_it_is_said_with_its_heading_clockwise(heading_deg: float) -> None:
    body = cart()
    body.put(Pose(0.5, -0.25, heading_deg))
    body.engine.forward()
    heading = math.radians(heading_deg)
    assert ahead(body)[:2] == pytest.approx([math.cos(heading), -math.sin(heading)], abs=1e-3)
    x_m, y_m, z_m = body.data.body("chassis").xpos
    assert (x_m, y_m) == pytest.approx((0.5, -0.25))
    # On its wheels, that give way a little.
    assert z_m == pytest.approx(0.028, abs=1e-3)
    pose = body.pose()
    assert (pose.x_m, pose.y_m) == pytest.approx((0.5, -0.25))
    assert (pose.heading_deg - heading_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0, abs=0.2)


def test_a_start_draws_heading_place_and_wall_but_no_single_place() -> None:
    scene = Scene(heading_deg=(-20.0, 40.0), start_mm=((-300.0, 100.0), (50.0, 50.0)), objects=())
    body = cart(scene)
    for upper, heading_deg, x_m in ((False, -20.0, -0.3), (True, 40.0, 0.1)):
        rng = Ends(upper=upper)
        body.reset(rng)  # type: ignore[arg-type]
        assert rng.ranges == [(-20.0, 40.0), (-300.0, 100.0)]
        pose = body.pose()
        assert (pose.x_m, pose.y_m) == pytest.approx((x_m, 0.05), abs=1e-3)
        turned = (pose.heading_deg - heading_deg + 180.0) % 360.0 - 180.0
        assert turned == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize("heading_deg", [0.0, 25.0, -40.0])
@pytest.mark.parametrize("distance_mm", [150.0, 600.0])
def test_a_wall_is_as_far_from_the_sensor_as_it_is_said(
    heading_deg: float, distance_mm: float
) -> None:
    body = cart(Scene(wall_distance_mm=(100.0, 700.0)))
    body.face_wall(distance_mm, heading_deg)
    body.engine.forward()
    eyes = body.data.site("ultrasonic_C").xpos
    # Its face is at 35 cm, and the sensor in the middle before it.
    assert 1000 * (0.35 - eyes[0]) == pytest.approx(distance_mm, abs=0.5)
    assert eyes[1] == pytest.approx(0.0, abs=5e-4)
    if not heading_deg:
        assert body.distance_mm("C") == pytest.approx(distance_mm, abs=2.0)


def test_a_start_before_a_wall_draws_its_distance_last() -> None:
    body = cart(Scene(wall_distance_mm=(200.0, 300.0), heading_deg=(-10.0, 10.0)))
    rng = Ends()
    body.reset(rng)  # type: ignore[arg-type]
    assert rng.ranges == [(-10.0, 10.0), (200.0, 300.0)]
    assert body.data.site("ultrasonic_C").xpos[0] == pytest.approx(0.35 - 0.2, abs=1e-3)


@pytest.mark.parametrize("upper", [False, True])
def test_a_robot_that_falls_by_itself_is_held_at_its_pitch(upper: bool) -> None:
    """Nose down is positive."""
    body = cart(Scene(held_deg=(4.0, 12.0)))
    rng = Ends(upper=upper)
    body.reset(rng)  # type: ignore[arg-type]
    assert body.is_held and rng.ranges[-1] == (4.0, 12.0)
    pitch_deg = 12.0 if upper else 4.0
    assert ahead(body)[2] == pytest.approx(-math.sin(math.radians(pitch_deg)), abs=5e-3)
    # It is as high as on its wheels, about whose axle it was turned.
    assert body.data.body("chassis").xpos[2] == pytest.approx(0.028, abs=1.5e-3)
    assert not cart().is_held


def test_a_hand_turns_a_robot_back_and_stops_its_turning_alone() -> None:
    body = cart()
    body.data.qvel[:6] = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    body.hold((0.6, 0.0, 0.0, 0.8))
    assert body.data.qpos[3:7].tolist() == [0.6, 0.0, 0.0, 0.8]
    assert body.data.qvel[:6].tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]


def test_what_can_be_pushed_is_put_back_with_its_spread() -> None:
    fixed = Block((900.0, 0.0))
    alone = Block((500.0, 0.0), mass_g=50.0)
    spread = Block((0.0, 600.0), mass_g=50.0, spread_mm=(30.0, 10.0))
    body = cart(Scene(objects=(fixed, alone, spread)))
    start = {}
    for upper, sign in ((False, -1.0), (True, 1.0)):
        for number in (1, 2):
            body.data.joint(f"object_{number}").qpos[:3] = (3.0, 4.0, 5.0)
        rng = Ends(upper=upper)
        body.reset(rng)  # type: ignore[arg-type]
        # What has one place draws nothing.
        assert rng.ranges[:2] == [(-0.03, 0.03), (-0.01, 0.01)]
        assert body.data.joint("object_1").qpos[:2] == pytest.approx([0.5, 0.0], abs=1e-3)
        place = body.data.joint("object_2").qpos
        assert place[:2] == pytest.approx([sign * 0.03, 0.6 + sign * 0.01], abs=1e-3)
        assert place[3:] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-3)
        start[upper] = place[2]
    assert start[True] == pytest.approx(start[False], abs=1e-4)


def test_a_wall_that_was_moved_is_put_back() -> None:
    body = cart(Scene(wall_distance_mm=(200.0, 300.0)))
    before = body.data.mocap_pos.copy()
    body.data.mocap_pos[0] = (1.0, 2.0, 3.0)
    body.reset(np.random.default_rng(0))
    assert body.data.mocap_pos.tolist() == before.tolist()


def test_all_ends_of_a_start_must_be_free() -> None:
    # In the middle there is room, at one corner of the range there is a block.
    block = Block((400.0, 300.0), (60.0, 60.0, 60.0))
    wide = Scene(objects=(block,), start_mm=((0.0, 400.0), (-300.0, 300.0)))
    with pytest.raises(TwinError, match="would start inside of Block"):
        cart(wide)
    cart(replace(wide, start_mm=((0.0, 0.0), (-300.0, 300.0))))
    # So must all headings: turned around, its caster is where its front was.
    near = Block((150.0, 0.0), (100.0, 60.0, 60.0))
    cart(Scene(objects=(near,), heading_deg=(180.0, 180.0)))


def test_a_joint_with_less_play_is_within_its_limits() -> None:
    wide = replace(QUIET, backlash_deg=6.0)
    body = MujocoBody(CART, OPEN_FLOOR, wide, 0)
    joints = [body.model.joint(f"backlash_{port}") for port in "AB"]
    limits = [float(joint.range[1]) for joint in joints]
    assert all(limit > 0.01 for limit in limits)
    for joint, limit, sign in zip(joints, limits, (1.0, -1.0), strict=True):
        body.data.qpos[joint.qposadr[0]] = sign * limit
    body._apply(replace(QUIET, backlash_deg=2.0))
    for joint, limit, sign in zip(joints, limits, (1.0, -1.0), strict=True):
        now = float(body.data.qpos[joint.qposadr[0]])
        assert now == pytest.approx(sign * float(body.model.joint(joint.id).range[1]))
        assert 0.0 < abs(now) < 0.5 * limit


def test_wheels_begin_in_the_middle_of_their_play() -> None:
    body = MujocoBody(CART, OPEN_FLOOR, replace(QUIET, backlash_deg=6.0), 0)
    for port in "AB":
        assert body.angle_mdeg(port) == 0
        assert abs(float(body.data.joint(f"backlash_{port}").qpos[0])) < 0.06
