"""Learner: order and number of updates, source of batches."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from small import (
    ENV,
    LEARNING,
    REPLAYING,
    dataset,
    learned,
    make,
    same,
    settings,
    steps,
    taught,
    weights,
)
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import LazyTensorStorage, SamplerWithoutReplacement, TensorDictReplayBuffer
from torchrl.objectives.common import LossModule

import bricksrl
from bricksrl.agents.features.observed import ENOUGH, reward_unit
from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.learner import Learner
from bricksrl.agents.on_policy import OnPolicyLearner
from bricksrl.agents.replay.buffer import TransitionReplayBuffer, make_replay_buffer
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.agents.td3 import TD3Loss
from bricksrl.errors import RunError


class Counting(LossModule):  # type: ignore[misc]
    """A loss with one weight each for critics and actor, which logs calls."""

    out_keys = ("loss_qvalue", "loss_actor", "loss_extra", "told")

    def __init__(self, log: list[str]) -> None:
        super().__init__()
        self.critic, self.actor = nn.Parameter(torch.ones(())), nn.Parameter(torch.ones(()))
        self.log = log
        self.seen: list[Tensor] = []

    def forward(self, tensordict: TensorDict) -> TensorDict:
        self.log.append("loss")
        self.seen.append(tensordict["observation"].flatten())
        critic, actor = self.critic * 1.0, self.actor * 1.0
        return TensorDict(
            {
                "loss_qvalue": critic,
                "loss_actor": actor,
                "loss_extra": self.critic * 100.0,
                "told": critic.detach(),
            }
        )


class Target:
    def __init__(self, log: list[str]) -> None:
        self.log = log

    def step(self) -> None:
        self.log.append("target")


class Descent(torch.optim.SGD):
    def __init__(self, loss: nn.Module, log: list[str]) -> None:
        super().__init__(loss.parameters(), lr=1.0)
        self.log = log

    def step(self, closure: None = None) -> None:  # type: ignore[override]
        self.log.append("optimizer")
        super().step()


def acting() -> TensorDictModule:
    return TensorDictModule(nn.Linear(8, 4), in_keys=["observation"], out_keys=["action"])


def counted(**changes: Any) -> GradientDescent:
    log: list[str] = []
    loss = Counting(log)
    usual = {"minimised": ("loss_qvalue", "loss_actor"), **changes}
    return GradientDescent(loss, Descent(loss, log), Target(log), **usual)


def counting(updates_per_step: float = 1.0, **changes: Any) -> tuple[ReplayLearner, Counting, Any]:
    descent = counted(**changes)
    memory = TransitionReplayBuffer(100, 4, ("observation",))
    learner = ReplayLearner(acting(), descent, memory, updates_per_step)
    return learner, descent.loss, descent.loss.log


def test_update_order_is_losses_optimizer_targets() -> None:
    learner, loss, log = counting()
    learner.remember(steps(8))
    told = learner.make_updates(2)
    assert log == ["loss", "optimizer", "target"] * 2
    assert learner.updates == 2
    assert (float(loss.critic.detach()), float(loss.actor.detach())) == (-1.0, -1.0)
    assert {name: float(value) for name, value in told.items()} == {
        "loss_qvalue": 0.5,
        "loss_actor": 0.5,
        "loss_extra": 50.0,
        "told": 0.5,
    }
    assert loss.critic.grad is None or float(loss.critic.grad) == 0.0


def test_only_selected_losses_are_minimised() -> None:
    for minimised, expected in ((("loss_actor",), (1.0, 0.0)), (None, (-100.0, 0.0))):
        learner, loss, _ = counting(minimised=minimised)
        learner.remember(steps(8))
        learner.make_updates(1)
        assert (float(loss.critic.detach()), float(loss.actor.detach())) == expected


def test_actor_and_targets_are_delayed() -> None:
    learner, loss, log = counting(actor_delay=3, target_delay=2)
    learner.remember(steps(8))
    found = []
    for _ in range(6):
        learner.make_updates(1)
        found.append((float(loss.critic.detach()), float(loss.actor.detach()), log.count("target")))
    assert found == [
        (0.0, 1.0, 0),
        (-1.0, 1.0, 1),
        (-2.0, 0.0, 1),
        (-3.0, 0.0, 2),
        (-4.0, 0.0, 2),
        (-5.0, -1.0, 3),
    ]


def test_gradient_norm_is_clipped() -> None:
    learner, loss, _ = counting(clip_norm=0.5, minimised=None)
    learner.remember(steps(8))
    learner.make_updates(1)
    change = torch.stack((1.0 - loss.critic.detach(), 1.0 - loss.actor.detach()))
    assert float(change.norm()) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("rate", "expected"), [(0.25, [0, 0, 0, 1, 0]), (1.0, [1] * 5), (2.5, [2, 3, 2, 3, 2])]
)
def test_fractional_updates_accumulate(rate: float, expected: list[int]) -> None:
    learner, loss, log = counting(updates_per_step=rate)
    learner.remember(steps(8))
    made = []
    for _ in range(5):
        before = learner.updates
        learner.learn()
        made.append(learner.updates - before)
    assert made == expected
    assert log.count("loss") == sum(expected)
    learner.learn(4)
    assert learner.updates == int(rate * 9)
    assert loss is learner.loss


def test_due_updates_are_in_state() -> None:
    one, other = counting(updates_per_step=0.75)[0], counting(updates_per_step=0.75)[0]
    for _ in range(3):
        one.learn()
    other.load_state_dict(one.state_dict())
    assert other.due == one.due == pytest.approx(0.25)


def test_empty_memory_makes_no_update() -> None:
    learner, _, log = counting()
    assert learner.make_updates(3) == {}
    assert log == []
    assert learner.updates == 0


def on_policy(passes: int, rows: int) -> tuple[OnPolicyLearner, Any]:
    memory = TensorDictReplayBuffer(
        storage=LazyTensorStorage(rows),
        sampler=SamplerWithoutReplacement(),
        batch_size=min(4, rows),
    )
    descent = counted()
    return OnPolicyLearner(acting(), descent, memory, passes=passes), descent.loss


@pytest.mark.parametrize(
    ("passes", "rows", "batches"), [(1, 8, 2), (3, 8, 6), (2, 10, 6), (1, 3, 1)]
)
def test_on_policy_passes_use_each_row_once(passes: int, rows: int, batches: int) -> None:
    learner, loss = on_policy(passes, rows)
    for round_ in range(2):
        frames = steps(rows)
        frames["observation"] = torch.arange(rows).float()[:, None] + 100.0 * round_
        learner.remember(frames)
        loss.seen.clear()
        learner.learn(rows)
        assert len(loss.seen) == batches
        counts = torch.cat(loss.seen).long().bincount(minlength=100 * round_ + rows)[100 * round_ :]
        assert counts.tolist() == [passes] * rows
        assert len(learner.memory) == 0


def test_half_of_each_batch_comes_from_the_dataset() -> None:
    learner = make("sac", hindsight=0.0, new_goals=0.0, batch_size=11)
    frames = steps(40)
    frames["next", "reward"] = torch.full((40, 1), 7.0)
    learner.dataset = dataset(frames, batch_size=11)
    assert all(
        (batch["next", "reward"] == 7.0).all() and len(batch) == 11 for batch in learner.batches(3)
    )
    learner.remember(steps(30))
    for batch in learner.batches(3):
        assert (batch["next", "reward"][:, 0] == 7.0).tolist() == [False] * 6 + [True] * 5


def test_batch_of_one_is_of_the_memory() -> None:
    learner = make("sac", batch_size=1)
    frames = steps(40)
    frames["next", "reward"] = torch.full((40, 1), 7.0)
    learner.dataset = dataset(frames, batch_size=1)
    learner.remember(steps(30))
    assert [float(batch["next", "reward"]) == 7.0 for batch in learner.batches(3)] == [False] * 3


@pytest.mark.parametrize("batch_size", [12, 13])
def test_goals_are_replaced_beside_a_dataset(batch_size: int) -> None:
    learner = make("sac", hindsight=0.5, new_goals=0.5, batch_size=batch_size)
    collected, known = steps(30), steps(40)
    learner.remember(collected)
    learner.dataset = learner.memory.empty_like(40)
    learner.dataset.extend(known)
    goals = {
        tuple(row) for frames in (collected, known) for row in frames["observation"][:, 4:].tolist()
    }
    for count in (1, 2, 3):
        batches = list(learner.batches(count))
        assert [len(batch) for batch in batches] == [batch_size] * count
        assert not [
            row
            for batch in batches
            for row in batch["observation"][:, 4:].tolist()
            if tuple(row) in goals
        ]


def test_shift_is_ignored_without_images() -> None:
    learner = taught(make("sac", shift_px=2))
    assert learner.updates == 3


def test_batches_drawn_together_are_complete() -> None:
    learner = make("sac", batch_size=256, hindsight=0.0, new_goals=0.0)
    learner.remember(steps(300, length=50))
    batches = list(learner.batches(70))
    assert [len(batch) for batch in batches] == [256] * 70
    assert not torch.equal(batches[0]["observation"], batches[1]["observation"])


def test_dataset_equals_same_experience() -> None:
    one, other = make("sac"), make("sac")
    one.remember(steps(40))
    memory = make_replay_buffer(ENV, settings("sac"), "cpu")
    memory.extend(steps(40))
    other.dataset = memory
    other.see(steps(40))
    for each in (one, other):
        torch.manual_seed(1)
        each.make_updates(3)
    assert same(weights(one), weights(other))


@pytest.mark.parametrize("agent", LEARNING)
def test_update_metrics_are_declared_by_loss(agent: str) -> None:
    learner = make(agent)
    told: dict[str, Tensor] = {}
    step = learner.descent.step
    learner.descent.step = lambda batch: told.update(found := step(batch)) or found
    taught(learner)
    assert told
    assert all(
        value.numel() == 1 and not value.requires_grad and value.isfinite()
        for value in told.values()
    )
    assert any(name.startswith("loss") for name in told)


@pytest.mark.parametrize("agent", REPLAYING)
def test_actor_updates_every_nth(agent: str) -> None:
    learner = make(agent, actor_delay=3, imitation_updates=0)
    before = [value.clone() for value in learner.policy.parameters()]
    taught(learner, 2)
    assert same(before, list(learner.policy.parameters()))
    learner.make_updates(1)
    assert not any(
        torch.equal(one, other)
        for one, other in zip(before, learner.policy.parameters(), strict=True)
    )


@pytest.mark.parametrize("delay", [1, 2])
def test_targets_move_by_tau(delay: int) -> None:
    learner = make("td3", tau=0.25, actor_delay=delay)
    taught(learner, 1)
    loss = learner.loss
    assert loss is not None
    pairs = ((loss.critics, loss.target_critics), (loss.actor, loss.target_actor))
    for _ in range(2):
        before = [[value.clone() for value in target.parameters()] for _, target in pairs]
        learner.make_updates(1)
        share = 0.25 if learner.updates % delay == 0 else 0.0
        for (network, target), old in zip(pairs, before, strict=True):
            for now, was, goal in zip(target.parameters(), old, network.parameters(), strict=True):
                torch.testing.assert_close(now, was + share * (goal - was))


def test_imitator_ignores_own_frames() -> None:
    learner = make("bc")
    learner.remember(steps(20))
    assert learner.make_updates(3) == {}
    learner.dataset = dataset()
    assert "loss_bc" in learner.make_updates(3)


@pytest.mark.parametrize("agent", ["ppo", "random"])
def test_what_learns_from_no_dataset_refuses_one(agent: str) -> None:
    learner = make(agent)
    assert not learner.uses_dataset
    with pytest.raises(RunError, match="cannot use a dataset; choose another agent"):
        learner.use_dataset(steps(5))


def test_frames_with_lost_link_are_not_stored() -> None:
    learner, _, _ = counting()
    learner.memory = TensorDictReplayBuffer(storage=LazyTensorStorage(50), batch_size=4)
    frames = steps(10)
    frames["next", "link_lost"] = torch.zeros(10, 1, dtype=torch.bool)
    frames["next", "link_lost"][4] = True
    learner.remember(frames)
    assert len(learner.memory) == 9
    learner.remember(frames[4:5])
    assert len(learner.memory) == 9
    learner.end_episodes()


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
def test_learns_rewarded_action(agent: str) -> None:
    learner = make(
        agent, gamma=0.0, learning_rate=1e-2, batch_size=32, hindsight=0.0, new_goals=0.0
    )
    frames = steps(200)
    frames["next", "reward"] = frames["action"][:, :1] - frames["action"][:, 1:2]
    frames["next", "terminated"] = torch.zeros(200, 1, dtype=torch.bool)
    learner.remember(frames)
    learner.make_updates(60)
    best = learner.exploit(frames)["action"]
    assert best[:, 0].mean() > 0.6
    assert best[:, 1].mean() < -0.6


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq", "tqc"])
def test_small_rewards_are_learned_like_ordinary_ones(agent: str) -> None:
    def learner_after(size: float, **changes: object) -> Learner:
        learner, frames = make(agent, hindsight=0.0, new_goals=0.0, **changes), steps(40)
        frames["next", "reward"] *= size
        learner.remember(frames)
        torch.manual_seed(3)
        learner.learn(4)
        return learner

    ordinary, small, as_given = (
        learner_after(1.0),
        learner_after(1e-3),
        learner_after(1e-3, scale_rewards=False),
    )
    assert (ordinary.reward_unit, small.reward_unit, as_given.reward_unit) == (1.0, 1e-3, 1.0)
    pairs = [zip(weights(ordinary), weights(other), strict=True) for other in (small, as_given)]
    assert [all(torch.allclose(a, b, rtol=1e-3, atol=1e-4) for a, b in pair) for pair in pairs] == [
        True,
        False,
    ]
    resumed = make(agent, hindsight=0.0, new_goals=0.0)
    resumed.load_state_dict(small.state_dict())
    assert resumed.reward_unit == 1e-3


def test_few_greater_or_no_rewards_are_learned_as_they_are() -> None:
    unit = torch.full((ENOUGH,), 0.2)
    assert reward_unit(unit) == pytest.approx(0.1)
    # what is seldom paid is no less
    assert reward_unit(torch.cat((unit / 2, torch.zeros(500)))) == pytest.approx(0.1)
    assert [reward_unit(one) for one in (unit[1:], unit * 300.0, unit * 0.0)] == [1.0] * 3


@pytest.mark.parametrize("agent", ["sac", "td3", "crossq"])
@pytest.mark.parametrize("terminated", [False, True])
def test_values_bootstrap_at_truncation_not_termination(agent: str, terminated: bool) -> None:
    changes = {
        "gamma": 0.5,
        "learning_rate": 1e-2,
        "start_value": False,
        "hindsight": 0.0,
        "new_goals": 0.0,
        "batch_size": 32,
        "tau": 0.5,
    }
    learner = make(agent, **changes, momentum=0.1, alpha_init=1e-4)
    frames = steps(30)
    after = frames["next"]
    after["reward"] = torch.ones(30, 1)
    after["terminated"] = torch.full((30, 1), terminated)
    after["truncated"], after["done"] = (
        torch.full((30, 1), not terminated),
        torch.ones(30, 1, dtype=torch.bool),
    )
    learner.remember(frames)
    learner.make_updates(80 if agent == "crossq" else 30)  # CrossQ's values come slower
    loss = learner.loss
    assert loss is not None
    with torch.no_grad():
        values = loss.critics(loss.encoder(frames["observation"]), frames["action"]).mean(0)
    if terminated:
        assert (values - 1.0).abs().mean() < 0.3
    else:
        assert values.mean() > 1.5  # on the way to 2; without bootstrapping it is 1


def test_learning_leaves_no_gradients() -> None:
    learner = learned("sac")
    assert all(parameter.grad is None for parameter in learner.loss.parameters())


def first_values(*, terminated: bool = False, **changes: object) -> Tensor:
    """Values of TD3's critics and target critics after transitions of reward -2 and a first, tiny
    update."""
    learner, frames = make("td3", learning_rate=1e-12, gamma=0.9, **changes), steps(40)
    frames["next", "reward"] = torch.full_like(frames["next", "reward"], -2.0)
    frames["next", "terminated"] = torch.full_like(frames["next", "terminated"], terminated)
    learner.remember(frames)
    learner.make_updates(1)
    loss = learner.loss
    assert isinstance(loss, TD3Loss)
    batch = loss.encode(frames)
    return torch.cat(
        [
            critics(batch.features, batch.action).detach()
            for critics in (loss.critics, loss.target_critics)
        ]
    )


def test_critics_start_at_mean_value() -> None:
    assert first_values().mean(-1).tolist() == pytest.approx([-2.0 / (1.0 - 0.9)] * 4, abs=1.0)
    assert first_values(terminated=True).mean(-1).tolist() == pytest.approx([-2.0] * 4, abs=1.0)
    assert first_values(start_value=False).mean(-1).tolist() == pytest.approx([0.0] * 4, abs=1.0)


def test_critics_start_only_once() -> None:
    learner = learned("td3", learning_rate=1e-12)
    assert isinstance(learner.loss, TD3Loss)
    bias, frames = learner.loss.critics[0][-1].bias, steps(40)
    before = bias.item()
    assert before < -1.0
    frames["next", "reward"] += 100.0
    learner.remember(frames)
    learner.make_updates(1)
    assert bias.item() == pytest.approx(before, abs=1e-6)


def test_policy_of_an_environment_without_a_device_acts_on_the_cpu() -> None:
    policy = acting()
    elsewhere = torch.optim.SGD([nn.Parameter(torch.zeros(1, device="meta"))])
    memory = TransitionReplayBuffer(100, 4, ("observation",))
    learner = ReplayLearner(policy, GradientDescent(Counting([]), elsewhere), memory)
    assert learner.device.type == "meta"
    learner.act_on(bricksrl.make("RunAway-v0").device)
    assert learner.acting is not policy and learner.acting.module.weight.device.type == "cpu"


@pytest.mark.parametrize("agent", ["sac", "td3"])
def test_networks_start_anew_with_the_replay_kept(agent: str) -> None:
    learner, plain = (make(agent, reset_every=count) for count in (3, 0))
    for one in (learner, plain):
        one.remember(steps(40))
        torch.manual_seed(0)
        one.make_updates(3)
    before = dict(plain.policy.named_parameters())
    assert all(
        (value != before[name]).any()
        for name, value in learner.policy.named_parameters()
        if value.ndim == 2
    )
    assert len(learner.memory) == 40 and not learner.descent.optimizer.state
    critics, targets = learner.loss.critics.parameters(), learner.loss.target_critics.parameters()
    assert all((one == other).all() for one, other in zip(critics, targets, strict=True))
    assert learner.make_updates(1) and learner.descent.optimizer.state


@pytest.mark.parametrize("agent", ["sac", "td3", "cql"])
def test_smooth_errors_are_linear_beyond_one(agent: str) -> None:
    smooth = make(agent, critic_loss="smooth-l1").loss.errors
    squared = make(agent).loss.errors
    values, target = torch.tensor([[0.5, 3.0], [0.0, 0.0]]), torch.zeros(2)
    assert (float(smooth(values, target)), float(squared(values, target))) == (
        (0.125 + 2.5) / 2,
        (0.25 + 9.0) / 2,
    )


def test_dropout_of_the_actor_trains_it_and_does_not_act() -> None:
    learner = make("sac", actor_dropout=0.5)
    features = torch.zeros(4, learner.loss.encoder.size)
    actor = learner.loss.actor
    assert (actor(features)[0] != actor(features)[1]).any()
    acted = [learner.exploit(ENV.reset().clone())["action"] for _ in range(2)]
    assert len(acted) == 2 and not learner.policy.training
