"""Goal relabelling with rewards and terminations."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from small import ENV, LAYOUT, TASK, make, settings, steps
from tensordict import TensorDict
from torch import Tensor

from bricksrl.agents.replay.buffer import HORIZON, TransitionReplayBuffer, make_replay_buffer
from bricksrl.agents.replay.goals import GoalRelabelling

GOALS = GoalRelabelling(TASK, LAYOUT, 0.5, 0.5)


def buffer(
    frames: TensorDict, batch_size: int = 100, capacity: int = 1000, **shares: float
) -> TransitionReplayBuffer:
    changes = {"hindsight": 0.0, "new_goals": 0.0, **shares}
    found = make_replay_buffer(
        ENV, settings("sac", batch_size=batch_size, buffer_size=capacity, **changes), "cpu"
    )
    found.extend(frames)
    return found


def test_arm_goals_belong_to_joints() -> None:
    names = [entry.name for entry in TASK.entries]
    assert [(names[goal], names[reached]) for goal, reached in LAYOUT.goals] == [
        (f"{joint}_goal", f"{joint}_angle") for joint in ("rotation", "low", "high", "grab")
    ]


def errors_deg(goals: Tensor, joints: Tensor) -> Tensor:
    around = (goals - joints)[:, 0].remainder(360.0)
    return torch.minimum(around, 360.0 - around) + (goals - joints)[:, 1:].abs().sum(-1)


def test_relabelled_reward_equals_task_reward() -> None:
    rows = steps(40)[None].clone()
    joints, before = (
        rows["next", "observation"][0, :, :4].clone(),
        rows["observation"][0, :, :4].clone(),
    )
    goals = GOALS.draw(40, device=torch.device("cpu"))
    GOALS.relabel(rows, goals)
    assert torch.equal(rows["next", "observation"][0, :, :4], joints)
    assert torch.equal(rows["observation"][0, :, :4], before)
    assert torch.equal(rows["observation"][0, :, 4:], goals)
    assert torch.equal(rows["next", "observation"][0, :, 4:], goals)
    error_deg = errors_deg(goals, joints)
    torch.testing.assert_close(rows["next", "reward"][0, :, 0], -error_deg / 100.0)
    assert torch.equal(rows["next", "terminated"][0, :, 0], error_deg < 50.0)


def test_new_goals_are_in_range() -> None:
    goals = GOALS.draw(2, 500, device=torch.device("cpu"))
    low, high = torch.tensor(LAYOUT.low)[4:], torch.tensor(LAYOUT.high)[4:]
    assert goals.shape == (2, 500, 4)
    assert ((goals >= low) & (goals <= high)).all()
    spread = (goals.flatten(0, 1).amax(0) - goals.flatten(0, 1).amin(0)) / (high - low)
    assert (spread > 0.95).all()


def test_reached_goal_terminates() -> None:
    rows = steps(10)[None].clone()
    GOALS.relabel(rows, rows["next", "observation"][0, :, :4].clone())
    assert rows["next", "terminated"].all()
    assert rows["next", "reward"].abs().max() < 1e-6


def test_relabelled_shares_follow_settings() -> None:
    frames = steps(50)
    known = {tuple(row) for row in frames["observation"][:, 4:].tolist()}
    reached = {tuple(row) for row in frames["next", "observation"][:, :4].tolist()}
    batch = buffer(frames, hindsight=0.2, new_goals=0.3).sample(300).view(3, 100)
    for part in batch:
        goals = [tuple(row) for row in part["observation"][:, 4:].tolist()]
        assert all(goal in reached for goal in goals[:20])
        assert not any(goal in known or goal in reached for goal in goals[20:50])
        assert all(goal in known for goal in goals[50:])
        assert torch.equal(part["next", "observation"][:, 4:], part["observation"][:, 4:])
        error_deg = errors_deg(
            part["next", "observation"][:, 4:], part["next", "observation"][:, :4]
        )
        torch.testing.assert_close(part["next", "reward"][:, 0], -error_deg / 100.0)
        assert torch.equal(part["next", "terminated"][:, 0], error_deg < 50.0)


def test_buffer_keeps_original_goals() -> None:
    frames = steps(50)
    found = buffer(frames, hindsight=0.5, new_goals=0.5)
    for _ in range(3):
        found.sample()
    assert torch.equal(found[:]["observation"], frames["observation"])
    assert torch.equal(found[:]["next", "reward"], frames["next", "reward"])


@pytest.mark.parametrize("capacity", [1000, 43])
@pytest.mark.parametrize("copies", [1, 2])
def test_hindsight_stays_within_episode_and_horizon(capacity: int, copies: int) -> None:
    """Joint angles encode episode and step."""
    count, length = 60 // copies, 7
    frames = steps(count).expand(copies, count).clone()
    for copy in range(copies):
        for step in range(count):
            stamp = torch.tensor([float(copy), float(step // length), float(step % length), 0.0])
            frames["next", "observation"][copy, step, :4] = stamp
            frames["observation"][copy, step, :3] = stamp[:3]
            frames["next", "done"][copy, step] = step % length == length - 1
            frames["next", "terminated"][copy, step] = False
    found = buffer(frames[:, : count // 2], hindsight=1.0, capacity=capacity)
    found.extend(frames[:, count // 2 :])
    batch = found.sample(4000)
    goal, at = batch["observation"][:, 4:7], batch["observation"][:, :3]
    assert torch.equal(goal[:, :2], at[:, :2])
    ahead = goal[:, 2] - at[:, 2]
    assert set(ahead.int().tolist()) == set(range(HORIZON + 1))
    last = (at[:, 2] >= length - HORIZON) | (at[:, 1] * length + at[:, 2] >= count - HORIZON)
    assert (ahead[~last] > 0).all()


def test_hindsight_stops_at_lost_link() -> None:
    frames = steps(10, length=100)
    frames["next", "done"][:] = False
    frames["next", "link_lost"] = torch.zeros(10, 1, dtype=torch.bool)
    frames["next", "link_lost"][5] = True
    early = {tuple(row) for row in frames["next", "observation"][:5, :4].tolist()}
    batch = buffer(frames, hindsight=1.0).sample(500)
    first = torch.stack(
        [
            (row == frames["observation"][:5, :4]).all(-1).any()
            for row in batch["observation"][:, :4]
        ]
    )
    from_early = torch.tensor([tuple(row) in early for row in batch["observation"][:, 4:].tolist()])
    assert torch.equal(first, from_early)


def test_n_step_sums_use_relabelled_goal() -> None:
    frames = steps(30)
    found = make_replay_buffer(
        ENV,
        settings("sac", batch_size=64, new_goals=1.0, hindsight=0.0, n_step=3, gamma=0.9),
        "cpu",
    )
    found.extend(frames)
    places = {
        tuple(row): number for number, row in enumerate(frames["observation"][:, :4].tolist())
    }
    for row in found.sample():
        place, goal, count = (
            places[tuple(row["observation"][:4].tolist())],
            row["observation"][4:],
            int(row["steps_to_next_obs"]),
        )
        joints = frames["next", "observation"][place : place + count, :4]
        error_deg = errors_deg(goal.expand(count, -1), joints)
        reward = float((-error_deg / 100.0 * 0.9 ** torch.arange(count)).sum())
        assert float(row["next", "reward"]) == pytest.approx(reward, rel=1e-4)
        assert torch.equal(row["next", "observation"], torch.cat((joints[-1], goal)))
        ends = [bool(one) for one in error_deg < 50.0]
        assert not any(ends[:-1])
        assert bool(row["next", "terminated"]) == ends[-1]
        assert count == 3 or ends[-1] or place % 5 + count == 5


def test_goals_unchanged_without_task_or_shares() -> None:
    frames = steps(20)
    known = {tuple(row) for row in frames["observation"].tolist()}
    assert all(tuple(row) in known for row in buffer(frames).sample()["observation"].tolist())
    found = make("sac").memory
    assert isinstance(found, TransitionReplayBuffer)
    assert found._goals == replace(GOALS, hindsight=0.3, new_goals=0.3)
