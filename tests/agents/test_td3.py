"""TD3's losses, gradients and whole updates against TorchRL's."""

from __future__ import annotations

import copy
from itertools import pairwise

import pytest
import torch
from learning import learned, small
from oracle import (
    as_theirs,
    assert_close,
    batch_of,
    copy_critics,
    frozen,
    of_actor,
    of_critics,
    separate,
    to_torchrl,
    written,
    written_for_critics,
)
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import SoftUpdate, TD3Loss

from bricksrl.agents.td3 import TD3Agent


def critic(sizes: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for a, b in pairwise(sizes):
        layers += [nn.Linear(a, b), nn.LayerNorm(b), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1))


def oracle_of(agent: TD3Agent) -> tuple[TD3Loss, SoftUpdate]:
    """TorchRL's TD3Loss with weights like the agent's."""
    oracle = TD3Loss(
        TensorDictModule(copy.deepcopy(agent.actor), ["features"], ["action"]),
        ValueOperator(separate(critic((agent.encoder.size + 4, 16, 16))), in_keys=["features", "action"]),
        action_spec=Bounded(-1.0, 1.0, (4,)),
        policy_noise=agent.settings.target_noise,
        loss_function="l2",
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    targets = SoftUpdate(oracle, tau=agent.settings.tau)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    for name, value in agent.target_actor.named_parameters():
        oracle.target_actor_network_params.get(("module", *name.split("."))).data.copy_(value)
    return oracle, targets


def test_losses_and_gradients_equal_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learned("td3", small("td3", tau=0.4, target_noise=0.5, batch_size=64), updates=4)
    assert isinstance(agent, TD3Agent)
    raw = batch_of(agent, 64)
    noise = torch.randn(64, 4)
    monkeypatch.setattr(torch, "randn_like", lambda like: noise)
    oracle, _ = oracle_of(agent)
    with monkeypatch.context() as patched:
        frozen(patched)
        losses = agent.learn(raw, actor=True)
    critic_loss, _ = oracle.value_loss(to_torchrl(raw))
    actor_loss, _ = oracle.actor_loss(to_torchrl(raw))
    assert_close(losses, (critic_loss, actor_loss), rtol=1e-5)
    params = of_critics(agent.critics, oracle.qvalue_network_params)
    assert_close(written_for_critics(agent.learned_critics, agent.critics), torch.autograd.grad(critic_loss, params))
    params = of_actor(agent.actor, oracle.actor_network_params, ("module",))
    assert_close(written(agent.learned_actor, agent.actor), torch.autograd.grad(actor_loss, params))


def test_whole_updates_end_where_torchrls_end(monkeypatch: pytest.MonkeyPatch) -> None:
    n, updates = 32, 6
    settings = small("td3", tau=0.2, batch_size=n, learning_rate=3e-3, actor_delay=2)
    agent = learned("td3", settings, updates=0)
    assert isinstance(agent, TD3Agent)
    oracle, targets = oracle_of(agent)
    for_critics = torch.optim.Adam(list(oracle.qvalue_network_params.flatten_keys().values()), lr=3e-3)
    for_actor = torch.optim.Adam(list(oracle.actor_network_params.flatten_keys().values()), lr=3e-3)
    batches, noise = [batch_of(agent, n) for _ in range(updates)], torch.randn(updates, n, 4)
    monkeypatch.setattr(agent, "draw_batches", lambda count: batches)
    with monkeypatch.context() as patched:
        turns = iter(noise.flatten(0, 1).split(2 * n))
        patched.setattr(torch, "randn_like", lambda like: next(turns))
        agent.update(updates)
    theirs = iter(noise)
    monkeypatch.setattr(torch, "randn_like", lambda like: next(theirs))
    for number, batch in enumerate(batches, 1):
        for_critics.zero_grad()
        oracle.value_loss(to_torchrl(batch))[0].backward()
        for_critics.step()
        if number % 2 == 0:
            for_actor.zero_grad()
            oracle.actor_loss(to_torchrl(batch))[0].backward()
            for_actor.step()
            targets.step()
    for actor, params in ((agent.actor, oracle.actor_network_params), (agent.target_actor, oracle.target_actor_network_params)):
        assert_close(actor.parameters(), of_actor(actor, params, ("module",)), atol=1e-4)
    for critics, params in (
        (agent.critics, oracle.qvalue_network_params),
        (agent.target_critics, oracle.target_qvalue_network_params),
    ):
        ours = [as_theirs(name, value) for name, value in critics.named_parameters()]
        assert_close(ours, of_critics(critics, params), atol=1e-4)


def test_targets_follow_when_the_actor_learns() -> None:
    agent = learned("td3", small("td3", tau=0.25, actor_delay=2), updates=1)
    assert isinstance(agent, TD3Agent)
    networks = [(agent.critics, agent.target_critics), (agent.actor, agent.target_actor)]
    before = [[value.clone() for value in target.parameters()] for _, target in networks]
    agent.update()
    for (network, target), old in zip(networks, before, strict=True):
        for now, was, goal in zip(target.parameters(), old, network.parameters(), strict=True):
            torch.testing.assert_close(now, was + 0.25 * (goal - was))
    after = [[value.clone() for value in target.parameters()] for _, target in networks]
    agent.update()
    assert all(
        torch.equal(a, b) for (_, t), old in zip(networks, after, strict=True) for a, b in zip(t.parameters(), old, strict=True)
    )
