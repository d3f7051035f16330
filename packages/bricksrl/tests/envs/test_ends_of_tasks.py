"""Rewards, ends and successes of the tasks at the limits that their pages name."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from brickhub.errors import DescriptionError
from brickhub.robot.line_edge import LineEdge
from bricksrl.envs.tasks import line_follow, park, robo_arm, run_away, spinning, walker
from bricksrl.envs.tasks.walker_forward import forward_task

DOWN, UP = -math.inf, math.inf


def beside(value: float, towards: float) -> float:
    """The next float32."""
    return torch.nextafter(torch.tensor(value), torch.tensor(towards)).item()


def episode(*rows: list[float]) -> Tensor:
    """An episode ``[steps, n]``."""
    return torch.tensor(rows)


def run_away_at(*distances_mm: float) -> Tensor:
    return episode(*([0.0, 0.0, 3.0, 0.0, distance_mm] for distance_mm in distances_mm))


def test_run_away_ends_at_the_sensor_s_limits() -> None:
    ends, open_wall = run_away.RUN_AWAY.terminated, run_away.run_away(ends_at_wall=False).terminated
    assert ends is not None and open_wall is not None
    places = run_away_at(beside(2000, DOWN), 2000.0, 40.0, beside(40, UP), 1000.0)
    assert ends(places)[..., 0].tolist() == [False, True, True, False, False]
    assert open_wall(places)[..., 0].tolist() == [False, True, False, False, False]


def test_run_away_rewards_the_direction_alone() -> None:
    before = run_away_at(100.0, 100.0, 100.0, 100.0, 41.0)
    after = run_away_at(101.0, 99.0, 100.0, 1000.0, 40.0)
    action = torch.zeros(5, 1)
    assert run_away.RUN_AWAY.reward(before, action, after)[..., 0].tolist() == [1, -1, 0, 1, 0]
    paper = run_away.run_away(ends_at_wall=False).reward
    assert paper(before, action, after)[..., 0].tolist() == [1, -1, 0, 1, -1]


def test_run_away_succeeds_a_metre_from_the_wall() -> None:
    assert run_away.success(run_away_at(50.0, 1000.0))
    assert not run_away.success(run_away_at(1500.0, beside(1000, DOWN)))
    tilted = run_away_at(100.0, 200.0)
    tilted[0, 2] = -7.0
    assert run_away.metrics(tilted) == {"final_distance_mm": 200.0, "largest_pitch_deg": 7.0}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: run_away.run_away(ends_at_wall=1), "ends_at_wall is 1; give True or False"),  # type: ignore[arg-type]
        (lambda: walker.timed("W-v0", 2.5), "step_ms is 2.5; give a whole number"),  # type: ignore[arg-type]
        (lambda: walker.walker("W-v0", max_steps=2.5), "max_steps is 2.5; give a whole number"),  # type: ignore[arg-type]
    ],
)
def test_options_of_another_type_are_named(make: Callable[[], object], says: str) -> None:
    with pytest.raises(DescriptionError, match=says):
        make()


@pytest.mark.parametrize(("direction", "sign"), [(0.0, 1.0), (1.0, -1.0)])
def test_spinning_counts_the_mean_rate_in_its_direction(direction: float, sign: float) -> None:
    def spun(*rates_deg_s: float) -> Tensor:
        return episode(*([0.0, 0.0, 0.0, 0.0, sign * rate, direction] for rate in rates_deg_s))

    assert spinning.success(spun(50.0, 150.0))
    assert not spinning.success(spun(50.0, 149.0)) and not spinning.success(spun(-200.0, -200.0))
    assert spinning.metrics(spun(50.0, -20.0))["mean_yaw_rate_deg_s"] == 15.0
    rewards = spinning.reward(spun(0.0), torch.zeros(1, 2), spun(30.0))
    assert rewards.tolist() == [[30.0]]


PARKED = [0.0, 0.0, 0.0, 15.0, 4.0, 3.0, 2.0]


@pytest.mark.parametrize(
    ("place", "limit"), [(3, 15.0), (3, -15.0), (4, -4.0), (5, 3.0), (5, -3.0), (6, -2.0)]
)
def test_parked_is_within_all_limits(place: int, limit: float) -> None:
    row = list(PARKED)
    row[place] = limit
    assert park.parked(torch.tensor(row)).tolist() == [True]
    row[place] = beside(limit, math.copysign(math.inf, limit))
    assert park.parked(torch.tensor(row)).tolist() == [False]


def test_park_succeeds_within_wider_limits_at_the_end() -> None:
    far = [0.0, 0.0, 90.0, 0.0, 0.0, 0.0, 0.0]
    assert park.success(episode(far, [0.0, 0.0, 20.0, 0.0, -5.0, 0.0, 0.0]))
    assert not park.success(episode(PARKED, far))
    assert not park.success(episode(far, [0.0, 0.0, 20.1, 0.0, 0.0, 0.0, 0.0]))
    assert not park.success(episode(far, [0.0, 0.0, 0.0, 0.0, 5.1, 0.0, 0.0]))
    assert park.metrics(episode(PARKED, [0.0, 0.0, 3.0, 4.0, -2.0, 0.0, 0.0])) == {
        "final_error_mm": 5.0,
        "final_error_deg": 2.0,
    }


def test_the_cost_of_parking_is_that_of_its_page() -> None:
    """1 for each 100 mm and for each 60 degrees of the two turns, forwards or backwards."""

    def cost(ahead_mm: float, left_mm: float, turn_deg: float) -> float:
        share = 1 / (1 + (25.0 / math.hypot(ahead_mm, left_mm)) ** 4)
        turns = []
        for back in (0.0, 180.0):
            first = -math.degrees(math.atan2(left_mm, ahead_mm)) + back
            both = (math.remainder(first, 360.0), math.remainder(turn_deg - first, 360.0))
            turns.append(sum(map(abs, both)))
        detour = min(turns) - abs(turn_deg)
        return math.hypot(ahead_mm, left_mm) / 100 + (abs(turn_deg) + share * detour) / 60

    drawn = torch.rand((40, 3), generator=torch.Generator().manual_seed(1)) * 2 - 1
    poses = drawn * torch.tensor([100.0, 100.0, 30.0])
    observations = torch.zeros(40, 7)
    observations[:, 2:5] = poses
    costs = park.cost(observations)[:, 0]
    assert costs.tolist() == pytest.approx([cost(*pose) for pose in poses.tolist()], rel=1e-4)
    rewards = park.reward(observations, torch.zeros(40, 2), observations.roll(1, 0))[:, 0]
    expected = 5 * (costs - costs.roll(1)) - 0.6
    assert rewards.tolist() == pytest.approx(expected.tolist(), abs=1e-4)


def legs(*degrees: float, tilt: tuple[float, float] = (0.0, 0.0), mm: float = 500.0) -> list[float]:
    return [*degrees, *tilt, mm]


TROT = (0.0, 180.0, 180.0, 0.0)


def test_the_gait_reward_is_0_for_a_trot_and_counts_half_turns() -> None:
    """Legs of an axle half a turn apart, diagonal ones together."""
    rows = episode(legs(*TROT), legs(359.0, 180.0, 180.0, 0.0), legs(0.0, 0.0, 0.0, 0.0))
    rewards = walker.gait_reward(rows)[..., 0].tolist()
    assert rewards == pytest.approx([0.0, -2 / 180, -2.0], abs=1e-5)
    actions = torch.tensor([[-1.0] * 4, [0.0] * 4, [1.0] * 4])
    together = walker.reward(rows, actions, rows)[..., 0].tolist()
    assert together == pytest.approx([0.1, -2 / 180, -2.1], abs=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_walker_has_fallen_beyond_60_degrees(axis: int, sign: float) -> None:
    tilt = [0.0, 0.0]
    fallen = []
    for angle in (60.0, beside(60.0, UP)):
        tilt[axis] = sign * angle
        fallen.append(walker.terminated(torch.tensor(legs(*TROT, tilt=(tilt[0], tilt[1])))).item())
    assert fallen == [False, True]


def test_a_walker_s_mean_turn_is_forwards_across_whole_turns() -> None:
    rows = episode(legs(10.0, 200.0, 5.0, 180.0), legs(350.0, 180.0, 345.0, 160.0))
    assert walker.mean_turn_deg(rows) == pytest.approx(20.0)
    assert walker.mean_turn_deg(rows.flip(0)) == pytest.approx(-20.0)
    assert walker.mean_turn_deg(rows[:1]) == 0.0
    assert walker.shortest_angle_deg(torch.tensor(359.0), torch.tensor(1.0)) == 2.0


def trotting(step_deg: float, steps: int, **last: object) -> Tensor:
    rows = [legs(*((angle - step_deg * n) % 360.0 for angle in TROT)) for n in range(steps)]
    rows[-1] = legs(*rows[-1][:4], **last)  # type: ignore[arg-type]
    return torch.tensor(rows, dtype=torch.float64)


def test_a_walker_succeeds_by_a_trot_of_90_degrees_a_second() -> None:
    success = walker.walker("Walker-v0").success
    assert success is not None
    assert success(trotting(22.5, 10))
    assert not success(trotting(22.4, 10)) and not success(trotting(-30.0, 10))
    assert not success(trotting(30.0, 10, tilt=(0.0, 61.0)))
    half = walker.walker("Walker-v0", step_ms=125).success
    assert half is not None
    assert half(trotting(11.25, 10)) and not half(trotting(11.2, 10))
    # Two legs deviate by 20 degrees on average: 80 degrees of all four pairs.
    for apart_deg, succeeds in ((39.9, True), (40.1, False)):
        rows = trotting(30.0, 10)
        rows[:, 0] = (rows[:, 0] + apart_deg) % 360.0
        assert bool(success(rows)) is succeeds


@pytest.mark.parametrize(
    ("options", "fits"),
    [
        ({"blocked_at_mm": 0.0}, True),
        ({"blocked_at_mm": -0.1}, False),
        ({"step_ms": 1}, True),
        ({"step_ms": 25_000}, True),
        ({"step_ms": 0}, False),
        ({"step_ms": 25_001}, False),
        ({"max_steps": 1}, True),
        ({"max_steps": 0}, False),
        ({"safe_tilt_deg": 0.1}, True),
        ({"safe_tilt_deg": 180.0}, True),
        ({"safe_tilt_deg": 0.0}, False),
        ({"safe_tilt_deg": 180.1}, False),
    ],
)
def test_options_of_the_walker(options: dict[str, float], fits: bool) -> None:
    make: Callable[..., object] = walker.walker
    if fits:
        assert make("Walker-v0", **options)
        return
    with pytest.raises(DescriptionError, match=f"Walker-v0: {next(iter(options))} is"):
        make("Walker-v0", **options)


def test_steps_of_the_walker_fill_25_seconds() -> None:
    steps = [walker.walker("W-v0", step_ms=ms).max_steps for ms in (250, 300, 25_000)]
    assert steps == [100, 83, 1]
    assert walker.walker("W-v0", max_steps=7).max_steps == 7
    task = walker.walker("W-v0", blocked_at_mm=50.0)
    assert task.blocked is not None
    near = torch.tensor([legs(*TROT, mm=50.0), legs(*TROT, mm=beside(50.0, UP))])
    assert task.blocked(near)[..., 0].tolist() == [True, False]


def test_walking_forward_counts_millimetres_alone() -> None:
    interface, steps = walker.timed("Walker-v1", 250)
    task = forward_task("Walker-v1", "", interface, steps, 20.0)
    assert task.success is not None and task.metrics is not None
    slow, fast = ([[*legs(*TROT), mm] for mm in way] for way in ((5.0, 14.9), (5.0, 15.0)))
    assert task.success(torch.tensor(fast)) and not task.success(torch.tensor(slow))
    assert task.metrics(torch.tensor(fast))["mean_step_mm"] == 10.0
    fallen = torch.tensor(fast)
    fallen[0, 4] = 61.0
    assert not task.success(fallen)
    rewards = task.reward(torch.tensor(slow), torch.zeros(2, 4), torch.tensor(fast))
    assert rewards.tolist() == [[0.25], [0.75]]


def test_a_robot_arm_reaches_its_goal_under_the_threshold() -> None:
    row = [0.0, 350.0, 20.0, 30.0, 1.0, 10.0, 25.0, 30.0]
    observation = torch.tensor(row)
    assert robo_arm.error_deg(observation).tolist() == [26.0]
    at, above = (robo_arm.robo_arm("Arm-v0", threshold_deg=deg) for deg in (26.0, 26.1))
    assert at.terminated is not None and above.terminated is not None
    assert not at.terminated(observation) and above.terminated(observation)
    assert not at.success(observation[None]) and above.success(observation[None])
    assert above.reward(observation, observation, observation).tolist() == [pytest.approx(-0.26)]
    sparse = robo_arm.robo_arm("Arm-v0", sparse=True, threshold_deg=26.1)
    assert sparse.reward(observation, observation, observation).tolist() == [1.0]
    for degrees in (0.0, -1.0, math.nan):
        with pytest.raises(DescriptionError, match="is never reached; give a positive one"):
            robo_arm.robo_arm("Arm-v0", threshold_deg=degrees)


LINE_EDGE = LineEdge(10.0, 70.0)
EDGE = line_follow.FollowedEdge(LINE_EDGE)


def test_a_line_is_lost_where_only_it_or_the_floor_is_seen() -> None:
    assert (LINE_EDGE.edge_pct, LINE_EDGE.bare_pct) == (40.0, 28.0)
    seen = torch.tensor([[40.0], [54.0], [26.0], [68.0], [12.0], [80.0]])
    ahead, right = torch.tensor([[1.0, 0.0]] * 6), torch.tensor([[1.0, 1.0]] * 6)
    straight = EDGE.reward(seen, ahead, seen)[:, 0].tolist()
    assert straight == pytest.approx([1.0, 0.5, 0.5, -0.5, -0.5, -0.5])
    turning = EDGE.reward(seen, right, seen)[:, 0].tolist()
    assert turning == pytest.approx([1.0, 0.5, 0.5, -0.25, -0.75, -0.25])
    slow = EDGE.reward(seen, -ahead, seen)[:, 0].tolist()
    assert slow == pytest.approx([0.5, 0.25, 0.25, -0.5, -0.5, -0.5])


def test_a_line_is_followed_for_95_of_100_steps() -> None:
    readings = torch.full((100, 1), 45.0)
    readings[:5] = 68.0
    assert EDGE.success(readings)
    assert EDGE.metrics(readings)["on_line_share"] == pytest.approx(0.95)
    assert EDGE.metrics(readings)["mean_off_pct"] == pytest.approx(0.95 * 5 + 0.05 * 28)
    readings[5] = 12.0
    assert not EDGE.success(readings)


def test_the_course_is_closed_runs_clockwise_and_begins_along_x() -> None:
    points = line_follow.course()
    radii = [math.hypot(x, y + 530.0 + 15.0) for x, y in points]
    assert (max(radii), min(radii)) == pytest.approx((530.0, 370.0))
    assert points[0] == pytest.approx((0.0, -15.0)) and points[1][0] > 0 > points[-1][0]
    doubled = 0.0
    for (x, y), (next_x, next_y) in zip(points, (*points[1:], points[0]), strict=True):
        doubled += x * next_y - next_x * y
    assert doubled < 0, "clockwise"
