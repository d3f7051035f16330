"""Dead reckoning, and its two tasks with scripted controllers."""

from __future__ import annotations

import dataclasses
import logging
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import bricksrl
from benchmarks.scripted import CONTROLLERS
from brickhub.hub.interface import DriveSpeed, Interface, MotorAngle, RunAngle, Wait, YawRate
from brickhub.hub.link.profiles import LinkProfile
from brickhub.robot import SensorKind
from brickhub.robot.line_edge import LINE_EDGES
from bricksrl.envs.odometry import FloorPose, Target, TargetTracker, start_pose
from bricksrl.envs.tasks.line_follow import LINE_FOLLOW
from bricksrl.envs.tasks.park import PARK, cost, reward
from bricksrl.errors import DescriptionError
from bricktwin.robots import TWO_WHEELER, WALKER
from bricktwin.twin.physics import Physics


def test_place_in_robot_frame() -> None:
    bay = FloorPose(100.0, 0.0, 30.0)
    assert bay.seen_from(FloorPose()) == pytest.approx((100.0, 0.0, 30.0))
    assert bay.seen_from(FloorPose(heading_deg=90.0)) == pytest.approx((0.0, 100.0, -60.0)), (
        "it looks along -y"
    )
    assert FloorPose(heading_deg=-170.0).seen_from(FloorPose(heading_deg=170.0))[
        2
    ] == pytest.approx(20.0), "the shorter way"


def test_arc_end_position() -> None:
    end = FloorPose().driven(math.pi * 100.0, 180.0)
    assert (end.x_mm, end.y_mm, end.heading_deg) == pytest.approx((0.0, -200.0, 180.0), abs=1e-9)
    assert FloorPose(5.0, 5.0, 90.0).driven(10.0, 0.0) == FloorPose(
        pytest.approx(5.0), pytest.approx(-5.0), 90.0
    )


def test_wheel_angles_are_unwrapped() -> None:
    interface = Interface(
        (DriveSpeed(-1, 1),), (MotorAngle("left"), MotorAngle("right")), Wait(100)
    )
    values = np.array([350.0, 10.0], np.float32)
    tracker = TargetTracker(
        Target(FloorPose(500.0)), TWO_WHEELER, interface, None, FloorPose(), values
    )
    assert tracker.entries() == pytest.approx((500.0, 0.0, 0.0, 0.0, 0.0))
    tracker.follow(np.array([10.0, 30.0], np.float32))
    ahead_mm, left_mm, turn_deg, moved_mm, turned_deg = tracker.entries()
    way_mm = 20 * math.pi * 56 / 360
    assert (500.0 - ahead_mm, left_mm, turn_deg) == pytest.approx((way_mm, 0.0, 0.0), abs=1e-3)
    assert (moved_mm, turned_deg) == pytest.approx((way_mm, 0.0), abs=1e-3)
    tracker.follow(np.array([0.0, 40.0], np.float32))
    assert tracker.entries()[3:] == pytest.approx((0.0, math.degrees(-way_mm / 130)), abs=1e-3), (
        "back with the left wheel"
    )
    assert tracker.metrics() == {}, "of a real robot the truth is not known"


def test_agent_does_not_observe_wheel_angles() -> None:
    assert PARK.observed_channels == () and LINE_FOLLOW.observed_channels == (0, 1)
    assert [entry.name for entry in PARK.entries][2:] == [
        "target_ahead",
        "target_left",
        "target_turn",
        "moved",
        "turned",
    ]
    interface = dataclasses.replace(
        PARK.interface, channels=(MotorAngle("left"), YawRate(), MotorAngle("right"))
    )
    assert [entry.name for entry in dataclasses.replace(PARK, interface=interface).entries][
        :4:3
    ] == ["yaw_rate", "target_ahead"]


def test_last_commands_are_observed() -> None:
    assert [(entry.name, entry.low, entry.high) for entry in PARK.entries[:2]] == [
        ("last_drive_speed", -100, 100),
        ("last_turn_rate", -60, 60),
    ]
    env = bricksrl.make("Park-v0", seed=3)
    state = env.reset()
    assert state["observation"][:2].tolist() == [0, 0]
    state = env.step(state.set("action", torch.tensor([0.5, -1.0])))["next"]
    assert state["observation"][:2].tolist() == [50, -60]
    assert env.reset()["observation"][:2].tolist() == [0, 0]
    env.close()


def test_real_robot_is_placed_at_start(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        start = start_pose(PARK.scene, PARK.id, None, np.random.default_rng(0))
    assert -550 <= start.x_mm <= -300 and abs(start.y_mm) <= 150 and abs(start.heading_deg) <= 40
    assert f"x = {start.x_mm:.0f} mm" in caplog.text


@pytest.mark.parametrize("robot", [TWO_WHEELER, WALKER])
def test_robot_without_odometry_raises(robot) -> None:
    interface = Interface(
        (RunAngle(robot.motors[0].name, 0, 9, 9),), (MotorAngle(robot.motors[0].name),), Wait(9)
    )
    with pytest.raises(DescriptionError, match="cannot tell where its target is"):
        type(PARK)(
            "Lost-v0",
            "A.",
            robot,
            interface,
            9,
            PARK.reward,
            PARK.success,
            PARK.metrics,
            target=Target(),
        )


def seen(
    ahead_mm: float, left_mm: float, turn_deg: float, moved_mm: float = 0.0, turned_deg: float = 0.0
) -> torch.Tensor:
    return torch.tensor([ahead_mm, left_mm, turn_deg, moved_mm, turned_deg], dtype=torch.float32)


def test_parking_reward_for_distance_and_heading() -> None:
    far, near, askew, there = seen(300, 0, 0), seen(200, 0, 0), seen(0, 0, 20), seen(0, 0, 0)
    assert reward(far, torch.zeros(2), near) > 0 > reward(near, torch.zeros(2), far)
    assert reward(askew, torch.zeros(2), there) > 0 > reward(there, torch.zeros(2), there)
    # half of the turn to face it, half of it there; the same backwards
    ahead, back = seen(100, 100, -90), seen(-100, 100, 90)
    assert cost(ahead).item() == pytest.approx(cost(back).item())
    assert cost(seen(100, 100, 0)).item() == pytest.approx(cost(ahead).item(), abs=0.01), (
        "there and back is as much to turn"
    )
    assert cost(seen(0, 50, 0)).item() > cost(seen(50, 0, 0)).item() + 1, "it cannot drive sideways"
    assert not torch.cat([cost(seen(0, 0, turn)) for turn in (-180.0, 0.0, 179.0)]).isnan().any()


STEPS = [
    (way_mm, turn_deg)
    for way_mm in (-20.0, 0.0, 20.0)
    for turn_deg in (-12.0, -2.0, 0.0, 2.0, 12.0)
]
"""Maximum drive and turn per step."""


@given(
    distance_mm=st.floats(32, 600),
    direction_deg=st.floats(-180, 180),
    heading_deg=st.floats(-180, 180),
)
def test_parking_cost_decreases_towards_bay(
    distance_mm: float, direction_deg: float, heading_deg: float
) -> None:
    direction = math.radians(direction_deg)
    robot = FloorPose(
        distance_mm * math.cos(direction), distance_mm * math.sin(direction), heading_deg
    )
    now, *after = [
        cost(seen(*FloorPose().seen_from(at))).item()
        for at in (robot, *(robot.driven(*step) for step in STEPS))
    ]
    assert min(after) < now - 0.01


@given(
    ahead_mm=st.floats(-10, 10),
    left_mm=st.floats(-10, 10),
    heading_deg=st.floats(-90, 90).filter(lambda deg: abs(deg) > 4),
)
def test_parking_reward_for_heading_in_bay(
    ahead_mm: float, left_mm: float, heading_deg: float
) -> None:
    robot = FloorPose(ahead_mm, left_mm, heading_deg)
    straighter = robot.driven(0.0, -math.copysign(2.0, heading_deg))
    assert cost(seen(*FloorPose().seen_from(straighter))) < cost(
        seen(*FloorPose().seen_from(robot))
    )


@pytest.mark.parametrize(
    ("last", "has_parked"),
    [
        (seen(12, 8, 4, -3, 2), True),
        (seen(-14, 0, -3.9, 2.9, -1.9), True),
        (seen(12, 10, 0), False),
        (seen(0, 0, -4.1), False),
        (seen(0, 0, 0, 3.1, 0), False),
        (seen(0, 0, 0, 0, -2.1), False),
    ],
)
def test_parked_condition(last: torch.Tensor, has_parked: bool) -> None:
    assert PARK.terminated(last).item() is has_parked


@pytest.mark.parametrize(
    ("last", "stands"),
    [
        (seen(19, 6, 4.9, -3, 2), True),
        (seen(19, 7, 0), False),
        (seen(0, 0, -5.1), False),
        (seen(0, 0, 0, 3.1, 0), False),
        (seen(0, 0, 0, 0, -2.1), False),
    ],
)
def test_parking_success_at_end(last: torch.Tensor, stands: bool) -> None:
    assert PARK.success(torch.stack([seen(100, 0, 0), last])).item() is stands
    assert not PARK.success(torch.stack([last, seen(100, 0, 0)]))


def test_two_wheeler_parks_by_dead_reckoning() -> None:
    # Over a slower link the true pose is further ahead of the observation.
    env = bricksrl.make("Park-v0", seed=3, physics=Physics().with_link(LinkProfile(15.0)))
    for _ in range(2):
        state, observations = env.reset(), []
        assert 300 <= state["observation"][2:4].norm() <= 600
        while not observations or not bool(state["done"]):
            state = env.step(CONTROLLERS["Park-v0"](state))["next"]
            observations.append(state["observation"])
        reckoned, truth = (
            torch.stack(observations),
            env.task_observations(torch.stack(observations)),
        )
        assert bool(state["terminated"]) and PARK.success(reckoned) and PARK.success(truth)
        assert not torch.equal(reckoned, truth) and torch.allclose(reckoned, truth, rtol=0, atol=10)
        errors = env.walk_metrics()
        assert 0 < errors["reckoning_error_mm"] < 10 and 0 < errors["reckoning_error_deg"] < 1
    env.close()


def test_success_uses_true_position_of_twin(monkeypatch: pytest.MonkeyPatch) -> None:
    env = bricksrl.make("Park-v0", seed=3)
    state = env.reset()
    assert env.twin is not None
    monkeypatch.setattr(TargetTracker, "entries", lambda _self: (1.0, 2.0, 3.0, 0.0, 0.0))
    monkeypatch.setattr(
        bricksrl.envs.odometry, "floor_pose", lambda _pose: FloorPose(30.0, 0.0, 0.0)
    )
    state = env.step(state.set("action", torch.zeros(2)))["next"]
    seen_by_it, truth = (
        state["observation"][None],
        env.task_observations(state["observation"][None]),
    )
    assert bool(state["terminated"]) and PARK.success(seen_by_it), "it takes itself for parked"
    assert truth[0, 2:5].tolist() == [-30.0, 0.0, 0.0] and not PARK.success(truth)
    env.close()


def test_lost_scout_reward_for_turning_back() -> None:
    right, left = torch.tensor([0.0, 1.0]), torch.tensor([0.0, -1.0])
    edge_pct = LINE_EDGES[SensorKind.COLOR].edge_pct
    floor, line, edge = (torch.tensor([brightness, 0.0]) for brightness in (71.0, 5.0, edge_pct))
    assert [LINE_FOLLOW.reward(edge, right, seen).item() for seen in (floor, line, edge)] == [
        -0.25,
        -0.75,
        0.75,
    ]
    assert [LINE_FOLLOW.reward(edge, left, seen).item() for seen in (floor, line, edge)] == [
        -0.75,
        -0.25,
        0.75,
    ]
    assert LINE_FOLLOW.reward(edge, torch.tensor([1.0, 0.0]), edge).item() == 1.0


@pytest.mark.parametrize("heading_deg", LINE_FOLLOW.scene.heading_deg)
def test_scout_driving_straight_loses_line_to_the_left(heading_deg: float) -> None:
    spots = [FloorPose(heading_deg=heading_deg).driven(way_mm, 0.0) for way_mm in range(60, 400, 5)]
    line = LINE_FOLLOW.scene.marks[0]
    assert all(line.beyond_mm(spot.x_mm, spot.y_mm) > 0.0 for spot in spots)


def test_scout_that_drives_straight_on_sees_the_bare_floor() -> None:
    env = bricksrl.make("LineFollow-v0", seed=1)
    steps = env.rollout(100, lambda tensordict: tensordict.set("action", torch.tensor([1.0, 0.0])))[
        "next"
    ]
    env.close()
    assert not LINE_FOLLOW.success(steps["observation"]) and LINE_FOLLOW.success(
        steps["observation"][:3]
    )
    assert (steps["reward"][-40:] < 0.0).all(), "it is lost"


def test_scripted_scout_follows_line() -> None:
    env = bricksrl.make("LineFollow-v0", seed=1)
    state, observations = env.reset(), []
    while not observations or not bool(state["done"]):
        state = env.step(CONTROLLERS["LineFollow-v0"](state))["next"]
        observations.append(state["observation"])
    assert LINE_FOLLOW.success(torch.stack(observations))
    assert not LINE_FOLLOW.success(torch.tensor([[71.0, 0.0]]).expand(60, 2)), "the bare floor"
    assert env.walk_metrics()["forward_m"] > 0.3
    env.close()
