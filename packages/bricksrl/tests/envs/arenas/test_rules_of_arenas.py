"""Rules of the arenas: distances, rewards and ends at their limits, and which way scripts steer."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from bricksrl.envs.abilities import balancing
from bricksrl.envs.arenas import carry, guide, tag
from bricksrl.envs.arenas.arena_task import ArenaState, own_pose, seen_from, steer_towards

Pose = tuple[float, float, float]


def state(*poses: Pose) -> ArenaState:
    return ArenaState(torch.tensor(poses, dtype=torch.float64), torch.zeros(2, 2))


def apart(metres: float) -> ArenaState:
    return state((-0.3, 0.1, 0.0), (-0.3 + metres, 0.1, 1.0))


def test_a_runner_is_caught_from_20_cm_on() -> None:
    near, far = apart(0.5 * tag.CAUGHT_M), apart(1.001 * tag.CAUGHT_M)
    on_it = state((0.0, 0.0, 0.0), (0.0, tag.CAUGHT_M, 0.0))
    assert [tag.caught(one).item() for one in (near, on_it, far)] == [True, True, False]
    slanted = state((0.1, 0.2, 0.0), (0.4, 0.6, 3.0))
    assert tag.distance_m(slanted).item() == pytest.approx(0.5)


def test_a_metre_nearer_is_10_and_a_catch_5() -> None:
    rewards = tag.reward(apart(0.7), apart(0.4))
    assert rewards[..., 0].tolist() == pytest.approx([3.0, -3.0])
    rewards = tag.reward(apart(0.3), apart(0.1))
    assert rewards[..., 0].tolist() == pytest.approx([7.0, -7.0])


def test_a_beam_arrives_by_its_place_and_ends_by_its_turn() -> None:
    def beam(x_m: float, turn: float) -> ArenaState:
        return state((0.0, 0.2, 0.0), (0.0, -0.2, 0.0), (x_m, 0.0, turn))

    places = [beam(carry.GOAL_M, 0.0), beam(carry.GOAL_M - 1e-6, 0.0), beam(0.2, 0.0)]
    assert [carry.arrived(one).item() for one in places] == [True, False, False]
    assert [carry.terminated(one).item() for one in places] == [True, False, False]
    for sign in (1, -1):
        turned = [beam(0.2, sign * share * carry.MAX_TURN) for share in (1.0, 1.0001)]
        assert [carry.terminated(one).item() for one in turned] == [False, True]
    rewards = carry.reward(beam(0.1, -0.2), beam(0.3, 0.1))
    assert rewards[..., 0].tolist() == pytest.approx([2.2, 2.2])
    assert carry.reward(places[1], places[0])[0].item() == pytest.approx(5.0, abs=1e-4)


def test_poses_in_a_robot_s_frame() -> None:
    poses = torch.tensor([(1.0, 2.0, math.pi / 2), (1.0, 5.0, math.pi), (0.0, 2.0, 0.0)])
    assert seen_from(poses, 0, 1).tolist() == pytest.approx([3.0, 0.0, 0.0, 1.0], abs=1e-6)
    assert seen_from(poses, 0, 2).tolist() == pytest.approx([0.0, 1.0, 0.0, -1.0], abs=1e-6)
    assert own_pose(poses, 0).tolist() == pytest.approx([1.0, 2.0, 0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize(
    ("ahead", "left", "wheels"),
    [
        (1.0, 0.0, (1.0, 1.0)),
        (0.0, 1.0, (-0.6, 0.6)),
        (0.0, -1.0, (0.6, -0.6)),
        (-1.0, 0.001, (-0.6, 0.6)),
        # A little to the left: 0.9 rad/s of turning for a radian, and no wheel above its range.
        (math.cos(0.2), math.sin(0.2), ((math.cos(0.2) - 0.18) / (math.cos(0.2) + 0.18), 1.0)),
    ],
)
def test_a_robot_turns_to_where_it_steers(
    ahead: float, left: float, wheels: tuple[float, float]
) -> None:
    action = steer_towards(torch.tensor(ahead), torch.tensor(left))
    assert action.tolist() == pytest.approx(wheels, abs=2e-3)
    half = steer_towards(torch.tensor(1.0), torch.tensor(0.0), speed=0.5)
    assert half.tolist() == [0.5, 0.5]


def flight(runner: Pose, catcher: Pose, steps: int = 1) -> Tensor:
    observation = tag.observe(state(catcher, runner))[tag.RUNNER].float()
    return tag.flee(observation)


def test_a_runner_flees_into_the_open() -> None:
    assert flight((0.0, 0.0, 0.0), (-0.3, 0.0, 0.0)).tolist() == pytest.approx([1.0, 1.0])
    left, right = flight((0.0, 0.0, 0.0), (0.0, -0.3, 0.0)).tolist()
    assert right > left, "a catcher to the right: to the left"
    left, right = flight((0.0, 0.0, 0.0), (0.0, 0.3, 0.0)).tolist()
    assert left > right
    # In a corner before it, it turns around.
    left, right = flight((0.7, 0.7, math.pi / 4), (0.7, 0.1, 0.0)).tolist()
    assert (left, right) != pytest.approx((1.0, 1.0))


def test_a_catcher_drives_straight_at_the_runner() -> None:
    seen = tag.observe(state((0.0, 0.0, math.pi / 2), (0.0, 0.5, 0.0)))
    assert tag.chase(seen[tag.CATCHER].float()).tolist() == pytest.approx([1.0, 1.0], abs=1e-5)
    assert seen.shape == (2, 10)
    assert seen[tag.RUNNER, 4:6].tolist() == pytest.approx([0.0, -0.5])


def test_a_robot_before_the_beam_s_half_waits_for_its_mate() -> None:
    def pushed(turn: float) -> Tensor:
        poses = state((0.0, 0.2, 0.0), (0.0, -0.2, 0.0), (0.2, 0.0, turn))
        return carry.push(carry.observe(poses).float())

    straight = pushed(0.0)
    assert straight.tolist() == [pytest.approx([1.0, 1.0])] * 2
    # Its left end is ahead for a negative turn: the left robot slows down, the right one does not.
    turned = pushed(-0.1)
    assert turned[0].max() < 0.6 and turned[1].max() == pytest.approx(1.0)
    turned = pushed(0.1)
    assert turned[1].max() < 0.6 and turned[0].max() == pytest.approx(1.0)


def guided(
    x: float, y: float, heading: float, *, gate: float | None = None, heard: Pose = (0.0, 0.0, 0.0)
) -> list[float]:
    """Action of a robot at a place, which sees a gate or has heard two numbers."""
    sees = (0.0, 0.0) if gate is None else (1.0, gate)
    row = [x, y, math.cos(heading), math.sin(heading), *sees, *heard[:2], 0.3, 0.3]
    action: list[float] = guide.follow(torch.tensor(row)).tolist()
    return action


def test_who_sees_the_gate_tells_and_who_has_heard_drives() -> None:
    heard = (0.5, 1.0, 0.0)  # 25 cm to the left of the line's middle
    assert guided(0.1, 0.2, 0.3, gate=0.25, heard=heard) == [0.0, 0.0, 0.5, 1.0]
    assert guided(0.1, 0.2, 0.3, gate=-0.5) == [0.0, 0.0, -1.0, 1.0]
    for nothing in ((0.5, 0.0, 0.0), (0.5, 0.5, 0.0)):
        assert guided(0.1, 0.2, 0.3, heard=nothing) == [0.0] * 4
    assert guided(0.0, 0.25, 0.0, heard=heard) == pytest.approx([1.0, 1.0, 0.0, 0.0])
    # It aims 10 cm beyond the line, which is at 40 cm.
    assert guided(0.5, 0.0, 0.0, heard=heard) == pytest.approx([-0.6, 0.6, 0.0, 0.0], abs=1e-5)
    assert guided(0.5, 0.0, math.pi / 2, heard=heard)[:2] == pytest.approx([1.0, 1.0])
    assert guided(0.5, 0.5, 0.0, heard=heard)[:2] == pytest.approx([0.6, -0.6], abs=1e-5)
    diagonal = guided(0.25, 0.0, math.pi / 4, heard=heard)[:2]
    assert diagonal == pytest.approx([1.0, 1.0], abs=1e-5)


def pushed(y: float, heading: float, turn: float = 0.0) -> list[float]:
    """Action of the first robot, at this place behind a beam with a turn."""
    poses = state((0.0, y, heading), (0.0, -0.2, 0.0), (0.2, 0.0, turn))
    action: list[float] = carry.push(carry.observe(poses).float())[0].tolist()
    return action


def test_a_robot_pushes_along_x_and_keeps_to_its_half_of_the_beam() -> None:
    assert pushed(0.2, 0.0) == pytest.approx([1.0, 1.0])
    assert pushed(0.2, math.pi / 2) == pytest.approx([0.6, -0.6], abs=1e-5)
    for y, left in ((0.1, 0.2), (0.35, -0.3), (0.9, -0.6)):
        steered = steer_towards(torch.tensor(1.0), torch.tensor(left)).tolist()
        assert pushed(y, 0.0) == pytest.approx(steered, abs=1e-5)
    # Turned towards where it steers, it drives straight on.
    assert pushed(0.1, math.atan(0.2)) == pytest.approx([1.0, 1.0], abs=1e-5)
    for heading in (0.0, 0.4):
        whole = pushed(0.2, heading)
        slower = [(1 - 6 * math.sin(0.05)) * share for share in whole]
        assert pushed(0.2, heading, -0.05) == pytest.approx(slower, abs=1e-5)
        assert pushed(0.2, heading, -0.5) == pytest.approx([0.1 * share for share in whole])
        assert pushed(0.2, heading, 0.5) == pytest.approx(whole, abs=1e-5)


def test_balance_is_lost_beyond_its_limit_and_best_at_the_start() -> None:
    limit = balancing._FALLEN_DEG
    rows = torch.tensor([[limit, 0.0, 0.0], [-limit - 0.01, 0.0, 0.0], [limit + 0.01, 0.0, 0.0]])
    assert balancing._has_fallen(rows)[:, 0].tolist() == [False, True, True]
    near = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 360.0], [0.0, 0.0, -360.0]])
    rewards = balancing._nearness(near, near, near)[:, 0].tolist()
    assert rewards == pytest.approx([1.0, (1 + math.exp(-1)) / 2, (1 + math.exp(-1)) / 2])
