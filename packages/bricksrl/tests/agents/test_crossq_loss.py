"""CrossQ's losses and gradients against TorchRL's."""

from __future__ import annotations

import pytest
import torch
from oracle import (
    ACTION,
    GAMMA,
    N,
    actor,
    assert_close,
    assert_same_gradients,
    batch,
    critics,
    draws,
    their_gaussian,
    their_loss,
)
from torch import nn
from torchrl.objectives import CrossQLoss as TorchRLCrossQLoss

from bricksrl.agents.actor_critic import Critics
from bricksrl.agents.crossq import CrossQLoss, CrossQSettings, batch_normalised

pytestmark = pytest.mark.usefixtures("double")


def make() -> CrossQLoss:
    """A loss with running statistics other than 0 and 1."""
    body, values = (
        batch_normalised(actor(2 * ACTION), 0.1),
        Critics(batch_normalised(one, 0.1) for one in critics()),
    )
    for _ in range(3):
        body(torch.randn(N, 5) * 2.0 + 1.0)
        values(torch.randn(N, 5) * 2.0 + 1.0, torch.rand(N, ACTION))
    return CrossQLoss(
        nn.Identity(), body.eval(), values.eval(), CrossQSettings(gamma=GAMMA, alpha_init=0.3)
    )


@pytest.mark.parametrize("steps", [False, True])
def test_losses_and_gradients_equal_torchrl(steps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    loss, data, noise = make(), batch(N, steps=steps), draws()
    oracle, _ = their_loss(
        TorchRLCrossQLoss, loss, their_gaussian(loss.actor, 0.1), num_qvalue_nets=2, alpha_init=0.3
    )
    before = [value.clone() for value in (*loss.critics.buffers(), *loss.actor.buffers())]

    noise.for_ours(monkeypatch, "after", "now")
    ours = loss(data)
    noise.for_theirs(monkeypatch, "after", "now")
    oracle.train()
    oracle.actor_network.eval()  # as the authors of CrossQ have it; TorchRL leaves it to the caller
    of_values, _ = oracle.qvalue_loss(data)
    oracle.actor_network.train()
    of_actor, found = oracle.actor_loss(data)
    of_alpha = oracle.alpha_loss(found["log_prob"])

    names = ("loss_qvalue", "loss_actor", "loss_alpha", "entropy")
    assert_close(
        [ours[name] for name in names], [of_values, of_actor, of_alpha, -found["log_prob"].mean()]
    )
    assert_same_gradients(
        loss, oracle, (ours["loss_qvalue"], of_values), (ours["loss_actor"], of_actor)
    )
    after = [*loss.critics.buffers(), *loss.actor.buffers()]
    assert not any(torch.equal(one, other) for one, other in zip(before, after, strict=True))
    for number, body in enumerate(loss.critics):
        for name, value in body.named_buffers():
            theirs = oracle.qvalue_network_params.get(("module", "body", *name.split(".")))[number]
            assert_close([value.to(theirs.dtype)], [theirs])


def test_only_losses_update_statistics() -> None:
    loss = make()
    assert not any(
        module.training for network in (loss.actor, loss.critics) for module in network.modules()
    )
    loss(batch(N))
    assert not any(
        module.training for network in (loss.actor, loss.critics) for module in network.modules()
    )
    before = [value.clone() for value in loss.critics.buffers()]
    loss.critics(torch.randn(N, 5), torch.rand(N, ACTION))
    assert all(
        torch.equal(one, other) for one, other in zip(before, loss.critics.buffers(), strict=True)
    )


def test_crossq_has_no_target_critics() -> None:
    assert not any("target" in name for name in make().state_dict())
