"""CrossQ's losses and gradients against TorchRL's."""

from __future__ import annotations

import copy

import pytest
import torch
from learning import fresh, learned, small
from oracle import (
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
from torch import nn
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import CrossQLoss

from bricksrl.agents.crossq import CrossQAgent
from bricksrl.agents.networks import make_policy


def norm(size: int) -> nn.BatchNorm1d:
    return nn.BatchNorm1d(size, eps=1e-3, momentum=0.01)


def critic(size: int) -> nn.Sequential:
    layers = (norm(size), nn.Linear(size, 16), nn.ReLU(), norm(16), nn.Linear(16, 16), nn.ReLU(), norm(16), nn.Linear(16, 1))
    return nn.Sequential(*layers)


def test_losses_and_gradients_equal_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    n = 64
    agent = learned("crossq", small("crossq", batch_size=n), updates=4)
    assert isinstance(agent, CrossQAgent)
    raw = batch_of(agent, n)
    oracle = CrossQLoss(
        make_policy(copy.deepcopy(agent.actor), 4, in_key="features"),
        ValueOperator(separate(critic(agent.encoder.size + 4)), in_keys=["features", "action"]),
        num_qvalue_nets=2,
        loss_function="l2",
        action_spec=Bounded(-1.0, 1.0, (4,)),
        alpha_init=float(agent.temperature.alpha()),
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    before = {name: value.clone() for name, value in agent.critics.named_buffers()}

    noise = torch.randn(2 * n, 4)
    with monkeypatch.context() as patched:
        frozen(patched)
        patched.setattr(torch, "randn", lambda *shape: noise)
        critic_loss, actor_loss, entropy, _ = agent.learn(raw, actor=True)

    order = iter(noise.split(n))
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: next(order))
    monkeypatch.setattr(torch, "normal", lambda loc, scale: loc + scale * next(order))
    oracle.train()
    oracle.actor_network.eval()  # as the authors of CrossQ have it; TorchRL leaves it to the caller
    of_values, _ = oracle.qvalue_loss(to_torchrl(raw))
    oracle.actor_network.train()
    climbed, found = oracle.actor_loss(to_torchrl(raw))
    of_alpha = oracle.alpha_loss(found["log_prob"])
    assert_close((critic_loss, actor_loss, entropy), (of_values, climbed, -found["log_prob"].mean()), rtol=1e-5)
    assert_close(written(agent.learned_actor, agent.temperature), torch.autograd.grad(of_alpha, [oracle.log_alpha]))
    params = of_critics(agent.critics, oracle.qvalue_network_params)
    assert_close(written_for_critics(agent.learned_critics, agent.critics), torch.autograd.grad(of_values, params))
    params = of_actor(agent.actor, oracle.actor_network_params, ("module", "0", "module"))
    assert_close(written(agent.learned_actor, agent.actor), torch.autograd.grad(climbed, params))
    for name, value in agent.critics.named_buffers():
        assert not torch.equal(value, before[name])
        their = oracle.qvalue_network_params.get(("module", *name.split(".")))
        torch.testing.assert_close(value.squeeze(1), their, rtol=1e-5, atol=1e-6)


def test_acting_moves_no_statistics() -> None:
    agent = learned("crossq")
    before = {name: value.clone() for name, value in agent.actor.named_buffers()}
    for _ in range(3):
        agent.act(torch.zeros(8), explore=True)
    assert all(torch.equal(value, before[name]) for name, value in agent.actor.named_buffers())
    untouched = dict(fresh("crossq").actor.named_buffers())
    assert not all(torch.equal(value, untouched[name]) for name, value in agent.actor.named_buffers())
