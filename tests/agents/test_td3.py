"""TD3's losses and gradients against TorchRL's."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import pytest
import torch
from learning import learned, small
from oracle import batch_of, copy_critics, gradients_of, separate, to_torchrl
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import SoftUpdate, TD3Loss

from bricksrl.agents.td3 import TD3Agent
from bricksrl.training.reproducible import reproducible


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    with reproducible(3):
        yield


def critic(sizes: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for a, b in pairwise(sizes):
        layers += [nn.Linear(a, b), nn.LayerNorm(b), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1))


def test_losses_and_gradients_equal_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learned("td3", small("td3", tau=0.4, target_noise=0.5), updates=4)
    assert isinstance(agent, TD3Agent)
    raw = batch_of(agent, 64)
    noise = torch.randn(64, 4)
    monkeypatch.setattr(torch, "randn_like", lambda like: noise)
    critic_loss, actor_loss = agent.critic_loss(raw), agent.actor_loss(raw)

    oracle = TD3Loss(
        TensorDictModule(agent.actor, ["features"], ["action"]),
        ValueOperator(separate(critic((agent.encoder.size + 4, 16, 16))), in_keys=["features", "action"]),
        action_spec=Bounded(-1.0, 1.0, (4,)),
        policy_noise=0.5,
        loss_function="l2",
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    SoftUpdate(oracle, tau=0.4)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    for name, value in agent.target_actor.named_parameters():
        oracle.target_actor_network_params.get(("module", *name.split("."))).data.copy_(value)
    of_critics, _ = oracle.value_loss(to_torchrl(raw))
    of_actor, _ = oracle.actor_loss(to_torchrl(raw))
    torch.testing.assert_close(critic_loss, of_critics, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(actor_loss, of_actor, rtol=1e-5, atol=1e-5)
    ours, theirs = gradients_of(agent.critics, critic_loss, oracle.qvalue_network_params, of_critics)
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)
    parameters = list(agent.actor.named_parameters())
    ours = torch.autograd.grad(actor_loss, [value for _, value in parameters])
    theirs = torch.autograd.grad(
        of_actor, [oracle.actor_network_params.get(("module", *name.split("."))) for name, _ in parameters]
    )
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)


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
