"""SAC's losses, gradients and whole updates against TorchRL's."""

from __future__ import annotations

import copy
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
import torch
from oracle import (
    as_theirs,
    assert_close,
    copy_critics,
    frozen,
    of_actor,
    of_critics,
    separate,
    to_torchrl,
    written,
    written_for_critics,
)
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import Bounded
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate

from bricksrl.agents import SACSettings, make_agent, sac
from bricksrl.agents.agent import Transition
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import make_policy
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.sac import SACAgent
from bricksrl.agents.soft import sample_action

LAYOUT = ObservationLayout((0.0, -1.0, 0.0), (360.0, 1.0, 2000.0), (True, False, False))
SMALL = SACSettings(hidden=(16, 16), batch_size=8, updates_per_step=1)


def transitions(count: int, *, reward: float | None = None, terminated: bool = False) -> list[Transition]:
    generator = torch.Generator().manual_seed(5)

    def observation() -> Tensor:
        return torch.rand(3, generator=generator) * torch.tensor([360.0, 2.0, 2000.0]) - torch.tensor([0.0, 1.0, 0.0])

    def transition() -> Transition:
        action = torch.rand(2, generator=generator) * 2 - 1
        value = float(action[0]) if reward is None else reward
        return Transition(observation(), action, value, observation(), terminated)

    return [transition() for _ in range(count)]


def learned(settings: SACSettings, updates: int = 3) -> SACAgent:
    torch.manual_seed(11)
    agent = SACAgent(LAYOUT, 2, settings)
    for transition in transitions(20):
        agent.remember(transition)
    for _ in range(updates):
        agent.update()
    return agent


POLICY = ("module", "0", "module")


def critic_of(agent: SACAgent) -> nn.Sequential:
    sizes = (agent.encoder.size + 2, *agent.settings.hidden)
    layers: list[nn.Module] = []
    for a, b in pairwise(sizes):
        layers += [nn.Linear(a, b), *([nn.LayerNorm(b)] if agent.settings.layer_norm else []), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1))


def oracle_of(agent: SACAgent) -> tuple[SACLoss, SoftUpdate]:
    """TorchRL's SACLoss with weights like the agent's."""
    oracle = SACLoss(
        make_policy(copy.deepcopy(agent.actor), 2, in_key="features"),
        ValueOperator(separate(critic_of(agent)), in_keys=["features", "action"]),
        num_qvalue_nets=agent.settings.critics,
        loss_function="l2",
        alpha_init=float(agent.temperature.alpha()),
        action_spec=Bounded(-1.0, 1.0, (2,)),
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    targets = SoftUpdate(oracle, tau=agent.settings.tau)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    return oracle, targets


def batch_for(agent: SACAgent, n: int) -> Batch:
    size = agent.encoder.size
    return Batch(torch.randn(n, size), torch.rand(n, 2) * 2 - 1, torch.randn(n), torch.randn(n, size), torch.rand(n) < 0.3)


OPTIONS: list[dict[str, Any]] = [
    {},
    {"layer_norm": False},
    {"critics": 3, "target_critics": 3},
    {"hidden": (8,), "min_scale": 0.8},
    {"hidden": (12, 10, 8)},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_losses_and_gradients_equal_torchrls(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    n = 64
    agent = learned(replace(SMALL, **{"initial_alpha": 0.3, "tau": 0.5, "batch_size": n, **options}), updates=4)
    batch, noise = batch_for(agent, n), torch.randn(2 * n, 2)
    oracle, _ = oracle_of(agent)
    with monkeypatch.context() as patched:
        frozen(patched)
        patched.setattr(torch, "randn", lambda *shape: noise)
        critic_loss, actor_loss, entropy, alpha = agent.learn(batch, actor=True)

    order = iter(noise.split(n))
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: next(order))
    theirs = oracle(to_torchrl(batch))
    names = ("loss_qvalue", "loss_actor", "entropy", "alpha")
    assert_close((critic_loss, actor_loss, entropy, alpha), [theirs[name] for name in names])
    of_alpha = torch.autograd.grad(theirs["loss_alpha"], [oracle.log_alpha])
    assert_close(written(agent.learned_actor, agent.temperature), of_alpha)
    params = of_actor(agent.actor, oracle.actor_network_params, POLICY)
    assert_close(written(agent.learned_actor, agent.actor), torch.autograd.grad(theirs["loss_actor"], params))
    params = of_critics(agent.critics, oracle.qvalue_network_params)
    assert_close(written_for_critics(agent.learned_critics, agent.critics), torch.autograd.grad(theirs["loss_qvalue"], params))


@pytest.mark.parametrize("delay", [1, 2, 3])
def test_whole_updates_end_where_torchrls_end(delay: int, monkeypatch: pytest.MonkeyPatch) -> None:
    n, updates = 32, 6
    agent = learned(replace(SMALL, tau=0.2, batch_size=n, learning_rate=3e-3, actor_delay=delay), updates=0)
    oracle, targets = oracle_of(agent)
    optimiser = torch.optim.Adam(oracle.parameters(), lr=3e-3)
    batches, noise = [batch_for(agent, n) for _ in range(updates)], torch.randn(updates, 2, n, 2)
    monkeypatch.setattr(agent, "draw_batches", lambda count: batches)
    turns = iter(range(0, updates, delay))

    def of_turn(rows: int, _: int) -> Tensor:
        first = next(turns)
        drawn = torch.cat((*noise[first : first + delay, 0], noise[first + delay - 1, 1]))
        assert len(drawn) == rows
        return drawn

    with monkeypatch.context() as patched:
        patched.setattr(torch, "randn", of_turn)
        agent.update(updates)

    order = iter(noise.flatten(0, 1))
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: next(order))
    for number, batch in enumerate(batches, 1):
        found = oracle(to_torchrl(batch))
        total = found["loss_qvalue"]
        if number % delay == 0:
            total = total + found["loss_actor"] + found["loss_alpha"]
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
        targets.step()
    assert_close(agent.actor.parameters(), of_actor(agent.actor, oracle.actor_network_params, POLICY), atol=1e-4)
    assert_close([agent.temperature.log_alpha], [oracle.log_alpha])
    for critics, params in (
        (agent.critics, oracle.qvalue_network_params),
        (agent.target_critics, oracle.target_qvalue_network_params),
    ):
        ours = [as_theirs(name, value) for name, value in critics.named_parameters()]
        assert_close(ours, of_critics(critics, params), atol=1e-4)


def value_of(values: Tensor, agent: SACAgent) -> Tensor:
    """What the actor climbs, of values ``[k, batch]``."""
    return values.amin(0) if agent.settings.actor_value == "min" else values.mean(0)


@pytest.mark.parametrize(
    "options", [{"actor_value": "mean", "critics": 4}, {"dropout": 0.2}, {"dropout": 0.2, "layer_norm": False}]
)
def test_what_torchrl_has_not_equals_autograds(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    n = 16
    agent = learned(replace(SMALL, batch_size=n, tau=0.5, **options), updates=3)
    batch = batch_for(agent, n)
    with monkeypatch.context() as patched:
        frozen(patched)
        torch.manual_seed(9)
        critic_loss, actor_loss, *_ = agent.learn(batch, actor=True)
    torch.manual_seed(9)
    noise = iter(torch.randn(2 * n, 2).split(n))
    monkeypatch.setattr(torch, "randn_like", lambda like: next(noise))
    alpha = agent.temperature.alpha()
    next_action, next_log_prob = sample_action(*agent.actor(batch.next_features))
    action, log_prob = sample_action(*agent.actor(batch.features))
    if agent.settings.target_critics < agent.settings.critics:
        chosen = torch.randperm(agent.settings.critics)[:2]
        next_values = agent.target_critics(batch.next_features, next_action)[chosen]
    else:
        next_values = agent.target_critics(batch.next_features, next_action)
    next_value = next_values.amin(0) - alpha * next_log_prob
    target = (batch.reward + agent.settings.gamma * torch.where(batch.terminated, 0.0, next_value)).detach()
    of_critics = (agent.critics(batch.features, batch.action) - target).square().mean(-1).sum()
    of_actor = (alpha * log_prob - value_of(agent.critics(batch.features, action), agent)).mean()
    assert_close((critic_loss, actor_loss), (of_critics, of_actor))
    for learner, module, loss in (
        (agent.learned_critics, agent.critics, of_critics),
        (agent.learned_actor, agent.actor, of_actor),
    ):
        assert_close(written(learner, module), torch.autograd.grad(loss, list(module.parameters()), retain_graph=True))


def test_bfloat16_learns_nearly_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sac, "working_type", lambda precision: getattr(torch, precision))
    one, other = (learned(replace(SMALL, precision=precision)) for precision in ("float32", "bfloat16"))
    for (name, mine), its in zip(one.critics.named_parameters(), other.critics.parameters(), strict=True):
        assert its.dtype is torch.float32, name
        assert not torch.equal(mine, its), name
        torch.testing.assert_close(mine, its, rtol=0, atol=0.02)


def test_log_probability_is_that_of_torchrls_tanh_normal() -> None:
    loc, scale = torch.randn(100, 3), torch.rand(100, 3) + 0.1
    action, log_prob = sample_action(loc, scale)
    policy = make_policy(nn.Sequential(nn.Identity()), 3)
    theirs = policy.build_dist_from_params(TensorDict({"loc": loc, "scale": scale}, [100])).log_prob(action)
    clear = action.abs().amax(-1) < 0.99
    torch.testing.assert_close(log_prob[clear], theirs[clear], rtol=1e-3, atol=1e-3)


def test_log_probability_stays_finite_where_tanh_saturates() -> None:
    _, log_prob = sample_action(torch.full((4, 1), 50.0), torch.ones(4, 1))
    assert log_prob.isfinite().all()


def test_random_agent_is_uniform_and_learns_nothing() -> None:
    agent = make_agent("random", LAYOUT, 2)
    actions = torch.stack([agent.act(torch.zeros(3), explore=False) for _ in range(2000)])
    assert actions.abs().max() <= 1.0
    assert actions.mean().abs() < 0.05
    assert actions.std() == pytest.approx(3**-0.5, abs=0.02)
    agent.remember(transitions(1)[0])
    assert agent.update() == {}
    agent.load_state_dict(agent.state_dict())


def test_policy_module_shares_the_actor() -> None:
    agent = learned(SMALL)
    policy = make_policy(agent.actor, 2, in_key="features")
    assert isinstance(policy.module[0], TensorDictModule)
    assert next(iter(policy.parameters())) is next(iter(agent.actor.parameters()))
    agent.update()
    observation = transitions(1)[0].observation
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        action = policy(TensorDict({"features": agent.encoder(observation)}))["action"]
    torch.testing.assert_close(action, agent.act(observation, explore=False))
