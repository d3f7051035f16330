"""Poses on the floor, and dead reckoning of a target, by geometry."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from brickhub.errors import DescriptionError
from brickhub.hub.interface import DriveSpeed, Interface, MotorAngle, Wait
from bricksrl.envs.odometry import (
    FloorPose,
    Target,
    TargetTracker,
    TrueOdometer,
    start_pose,
    wheels,
)
from bricktwin.robots import ROBO_ARM, TWO_WHEELER
from bricktwin.twin.scene import Scene
from bricktwin.twin.standing import Pose

INTERFACE = Interface(
    (DriveSpeed(-100, 100),), (MotorAngle("right"), MotorAngle("left")), Wait(200)
)
BASE = TWO_WHEELER.drive_base
assert BASE is not None


def drawn(rng: random.Random) -> FloorPose:
    return FloorPose(rng.uniform(-500, 500), rng.uniform(-500, 500), rng.uniform(-400, 400))


def placed(robot: FloorPose, ahead_mm: float, left_mm: float) -> tuple[float, float]:
    """A place in the robot's frame, on the floor: headings are clockwise, y is to the left."""
    heading = -math.radians(robot.heading_deg)
    x_mm = robot.x_mm + ahead_mm * math.cos(heading) - left_mm * math.sin(heading)
    y_mm = robot.y_mm + ahead_mm * math.sin(heading) + left_mm * math.cos(heading)
    return x_mm, y_mm


@pytest.mark.parametrize("seed", range(5))
def test_what_is_seen_from_a_robot_is_there(seed: int) -> None:
    rng = random.Random(seed)
    robot, other = drawn(rng), drawn(rng)
    ahead_mm, left_mm, turn_deg = other.seen_from(robot)
    assert placed(robot, ahead_mm, left_mm) == pytest.approx((other.x_mm, other.y_mm))
    assert -180.0 <= turn_deg < 180.0
    turned = math.radians(robot.heading_deg + turn_deg - other.heading_deg)
    assert math.cos(turned) == pytest.approx(1.0)


def test_an_arc_is_many_short_straight_ways() -> None:
    start = FloorPose(10.0, 20.0, 30.0)
    whole = start.driven(200.0, 80.0)
    pieces = start
    for _ in range(2000):
        pieces = pieces.driven(0.1, 0.0).driven(0.0, 0.04)
    assert (pieces.x_mm, pieces.y_mm) == pytest.approx((whole.x_mm, whole.y_mm), abs=0.1)
    assert whole.heading_deg == pytest.approx(110.0)
    straight = FloorPose().driven(5.0, 0.0)
    assert (straight.x_mm, straight.y_mm) == (5.0, 0.0)
    # A full circle ends where it begins; a quarter to the right ends ahead and to the right.
    circle = FloorPose().driven(100.0, 360.0)
    assert (circle.x_mm, circle.y_mm) == pytest.approx((0.0, 0.0), abs=1e-9)
    quarter = FloorPose().driven(math.pi / 2 * 100.0, 90.0)
    assert (quarter.x_mm, quarter.y_mm) == pytest.approx((100.0, -100.0))


def tracker(true_pose=None, pose: FloorPose = FloorPose()) -> TargetTracker:  # noqa: B008
    target = Target(FloorPose(300.0, 100.0, 90.0))
    return TargetTracker(target, TWO_WHEELER, INTERFACE, true_pose, pose, [350.0, 10.0])


def test_wheels_that_turn_alike_drive_ahead_across_whole_turns() -> None:
    seen = tracker()
    assert seen.entries() == pytest.approx((300.0, 100.0, 90.0, 0.0, 0.0))
    seen.follow([10.0, 30.0])
    way_mm = 20.0 / 360 * math.pi * BASE.wheel_diameter_mm
    assert seen.entries() == pytest.approx((300.0 - way_mm, 100.0, 90.0, way_mm, 0.0))
    seen.follow([350.0, 10.0])
    assert seen.entries() == pytest.approx((300.0, 100.0, 90.0, -way_mm, 0.0))


def test_wheels_that_turn_apart_turn_the_robot_clockwise() -> None:
    seen = tracker()
    seen.follow([320.0, 40.0])
    rolled_mm = 30.0 / 360 * math.pi * BASE.wheel_diameter_mm
    turn_deg = math.degrees(2 * rolled_mm / BASE.axle_track_mm)
    assert seen.entries()[2:] == pytest.approx((90.0 - turn_deg, 0.0, turn_deg))
    assert seen.metrics() == {}
    assert seen.truth() == seen.entries()


def test_errors_are_those_to_the_true_pose() -> None:
    seen = tracker(lambda: Pose(0.003, -0.004, 7.0))
    assert seen.metrics() == pytest.approx({"reckoning_error_mm": 5.0, "reckoning_error_deg": 7.0})
    ahead_mm, left_mm, turn_deg = FloorPose(300.0, 100.0, 90.0).seen_from(FloorPose(3.0, -4.0, 7.0))
    assert seen.truth() == pytest.approx((ahead_mm, left_mm, turn_deg, 0.0, 0.0))
    assert seen.entries()[:2] == (300.0, 100.0)


def test_a_target_s_entries_have_its_ranges() -> None:
    entries = Target(range_mm=1.0, range_deg=2.0, step_mm=3.0, step_deg=4.0).entries
    assert [(entry.name, entry.low, entry.high, entry.unit) for entry in entries] == [
        ("target_ahead", -1.0, 1.0, "mm"),
        ("target_left", -1.0, 1.0, "mm"),
        ("target_turn", -2.0, 2.0, "deg"),
        ("moved", -3.0, 3.0, "mm"),
        ("turned", -4.0, 4.0, "deg"),
    ]
    limits = {entry.unit: entry.limits for entry in entries}
    assert limits == {"mm": (-1e5, 1e5), "deg": (-180.0, 180.0)}


def test_wheels_are_found_by_name_and_missing_ones_refused() -> None:
    assert wheels(TWO_WHEELER, INTERFACE) == (1, 0)
    only_left = Interface((DriveSpeed(-1, 1),), (MotorAngle("left"),), Wait(200))
    for robot, interface in ((TWO_WHEELER, only_left), (ROBO_ARM, INTERFACE)):
        with pytest.raises(DescriptionError, match="cannot tell where its target is"):
            wheels(robot, interface)


def test_a_real_robot_s_start_is_drawn_and_told(caplog: pytest.LogCaptureFixture) -> None:
    scene = Scene(start_mm=((-300.0, -200.0), (50.0, 150.0)), heading_deg=(10.0, 20.0))
    for seed in range(20):
        start = start_pose(scene, "Park-v0", None, np.random.default_rng(seed))
        assert -300 <= start.x_mm <= -200 and 50 <= start.y_mm <= 150
        assert 10 <= start.heading_deg <= 20
    assert len(caplog.records) == 20
    assert caplog.records[-1].getMessage() == (
        f"Park-v0: put the robot at x = {start.x_mm:.0f} mm, y = {start.y_mm:.0f} mm, turned by "
        f"{start.heading_deg:.0f} degrees clockwise"
    )
    real = start_pose(scene, "", lambda: Pose(0.1, -0.2, 30.0), np.random.default_rng(0))
    assert real == FloorPose(100.0, -200.0, 30.0)


def test_before_the_first_step_nothing_is_measured() -> None:
    odometer = TrueOdometer(lambda: Pose(1.0, 2.0, 3.0), 5.0)
    nothing = {"forward_m": 0.0, "forward_speed_m_s": 0.0, "straightness": 0.0, "turned_deg": 0.0}
    assert odometer.metrics() == nothing
    assert odometer.forward_mm(5.0, ()) == 0.0
    assert odometer.metrics() == nothing
