from __future__ import annotations

import pytest
import torch
from learning import LAYOUT, TASK, fresh, small, transitions

from bricksrl.agents import make_agent
from bricksrl.agents.hindsight import HORIZON, GoalExchange
from bricksrl.agents.off_policy import OffPolicyAgent
from bricksrl.agents.replay import ReplayRing


def test_goals_of_the_arm_belong_to_its_joints() -> None:
    names = [entry.name for entry in TASK.entries]
    assert [(names[goal], names[reached]) for goal, reached in LAYOUT.goals] == [
        (f"{joint}_goal", f"{joint}_angle") for joint in ("rotation", "low", "high", "grab")
    ]


def test_an_exchanged_goal_pays_what_the_task_pays_for_it() -> None:
    exchange = GoalExchange(LAYOUT, TASK)
    steps = transitions(40)
    observation, following = (torch.stack([getattr(one, name) for one in steps]) for name in ("observation", "next_observation"))
    action = torch.stack([one.action for one in steps])
    goals = exchange.drawn(40)
    assert (goals >= torch.tensor(LAYOUT.low)[4:]).all()
    assert (goals <= torch.tensor(LAYOUT.high)[4:]).all()
    joints = following[:, :4].clone()
    reward, terminated = exchange.exchange(observation, action, following, goals)
    assert torch.equal(following[:, :4], joints)
    assert torch.equal(observation[:, 4:], goals)
    assert torch.equal(following[:, 4:], goals)
    error_deg = torch.cat(((goals - joints)[:, :1].remainder(360.0), (goals - joints)[:, 1:].abs()), 1)
    error_deg[:, 0] = torch.minimum(error_deg[:, 0], 360.0 - error_deg[:, 0])
    torch.testing.assert_close(reward, -error_deg.sum(-1) / 100.0)
    assert torch.equal(terminated, error_deg.sum(-1) < 50.0)


def test_what_was_reached_at_once_ends_the_episode_there() -> None:
    exchange = GoalExchange(LAYOUT, TASK)
    following = torch.stack([one.next_observation for one in transitions(10)])
    reward, terminated = exchange.exchange(following.clone(), torch.zeros(10, 4), following, exchange.reached(following))
    assert terminated.all()
    assert reward.abs().max() < 1e-6


def test_batches_hold_exchanged_goals_in_the_shares_of_the_settings() -> None:
    made = fresh("sac", small("sac", batch_size=100, hindsight=0.2, new_goals=0.3, goals="plain", angles="raw"))
    for one in transitions(50):
        made.remember(one)
    known = {tuple(made.encoder(one.observation)[4:].tolist()) for one in transitions(50)}
    reached = [one.next_observation[:4] for one in transitions(50)]
    as_goals = {tuple(made.encoder(torch.cat((joints, joints)))[4:].tolist()) for joints in reached}
    batch = made.draw_batches(1)[0]
    goals = [tuple(row[4:].tolist()) for row in batch.features]
    assert all(goal in as_goals for goal in goals[:20])
    assert not any(goal in known or goal in as_goals for goal in goals[20:50])
    assert all(goal in known for goal in goals[50:])
    assert batch.terminated[:20].any()


def test_without_a_task_goals_stay_as_they_are() -> None:
    made = make_agent("sac", LAYOUT, 4, small("sac", goals="plain", angles="raw"))
    assert isinstance(made, OffPolicyAgent)
    for one in transitions(20):
        made.remember(one)
    known = {tuple(made.encoder(one.observation)[4:].tolist()) for one in transitions(20)}
    assert all(tuple(row[4:].tolist()) in known for row in made.draw_batches(1)[0].features)


@pytest.mark.parametrize("capacity", [100, 23])
def test_a_later_place_is_one_of_the_same_episode(capacity: int) -> None:
    ring = ReplayRing(capacity, 2)
    for step in range(60):
        ring.add((torch.tensor([float(step // 7)]), torch.tensor([float(step)])), last=step % 7 == 6)
    places = ring.draw(3000)
    now, then = ring.rows(places), ring.rows(ring.later(places, HORIZON))
    ahead = then[:, 1] - now[:, 1]
    assert torch.equal(now[:, 0], then[:, 0])
    assert set(ahead.tolist()) == set(range(HORIZON + 1))
    assert ((ahead > 0) | (now[:, 1] % 7 >= 6 - HORIZON + 1) | (now[:, 1] > 59 - HORIZON)).all()


def test_a_ring_forgets_the_oldest_first() -> None:
    ring = ReplayRing(5, 1)
    for step in range(8):
        ring.add((torch.tensor([float(step)]),), last=False)
    assert len(ring) == 5
    assert set(ring.rows(ring.draw(200))[:, 0].tolist()) == {3.0, 4.0, 5.0, 6.0, 7.0}
