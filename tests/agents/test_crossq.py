"""CrossQ's losses and gradients against TorchRL's."""

from __future__ import annotations

import copy
from collections.abc import Iterator

import pytest
import torch
from learning import fresh, learned, small
from oracle import batch_of, copy_critics, gradients_of, separate, to_torchrl
from torch import nn
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import CrossQLoss

from bricksrl.agents.crossq import CrossQAgent
from bricksrl.agents.networks import make_policy
from bricksrl.training.reproducible import reproducible


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    with reproducible(3):
        yield


def norm(size: int) -> nn.BatchNorm1d:
    return nn.BatchNorm1d(size, eps=1e-3, momentum=0.01)


def critic(size: int) -> nn.Sequential:
    layers = (norm(size), nn.Linear(size, 16), nn.ReLU(), norm(16), nn.Linear(16, 16), nn.ReLU(), norm(16), nn.Linear(16, 1))
    return nn.Sequential(*layers)


def test_losses_and_gradients_equal_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learned("crossq", small("crossq"), updates=4)
    assert isinstance(agent, CrossQAgent)
    raw = batch_of(agent, 64)
    oracle = CrossQLoss(
        make_policy(copy.deepcopy(agent.actor), 4, in_key="features"),  # a copy: running statistics move with each loss
        ValueOperator(separate(critic(agent.encoder.size + 4)), in_keys=["features", "action"]),
        num_qvalue_nets=2,
        loss_function="l2",
        action_spec=Bounded(-1.0, 1.0, (4,)),
        alpha_init=float(agent.temperature.alpha()),
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    before = {name: value.clone() for name, value in agent.critics.named_buffers()}

    noise = torch.randn(64, 4)
    monkeypatch.setattr(torch, "randn_like", lambda like: noise)
    critic_loss = agent.critic_loss(raw)
    actor_loss, entropy = agent.actor_loss(raw)
    alpha_loss = agent.temperature.loss(entropy)
    ours = torch.autograd.grad(actor_loss, list(agent.actor.parameters()))
    monkeypatch.undo()

    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: noise)
    monkeypatch.setattr(torch, "normal", lambda loc, scale: loc + scale * noise)
    oracle.train()
    oracle.actor_network.eval()  # as the authors of CrossQ have it; TorchRL leaves it to the caller
    of_critics, _ = oracle.qvalue_loss(to_torchrl(raw))
    oracle.actor_network.train()
    of_actor, found = oracle.actor_loss(to_torchrl(raw))
    torch.testing.assert_close(critic_loss, of_critics, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(actor_loss, of_actor, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(alpha_loss, oracle.alpha_loss(found["log_prob"]), rtol=1e-5, atol=1e-5)
    mine, theirs = gradients_of(agent.critics, critic_loss, oracle.qvalue_network_params, of_critics)
    torch.testing.assert_close(mine, theirs, rtol=1e-4, atol=1e-5)
    names = [name for name, _ in agent.actor.named_parameters()]
    of_theirs = [oracle.actor_network_params.get(("module", "0", "module", *name.split("."))) for name in names]
    torch.testing.assert_close(ours, torch.autograd.grad(of_actor, of_theirs), rtol=1e-4, atol=1e-5)
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
