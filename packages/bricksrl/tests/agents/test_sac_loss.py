"""SAC's losses, gradients and whole updates against TorchRL's; DroQ and REDQ are settings of it."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from oracle import (
    ACTION,
    GAMMA,
    Draws,
    N,
    actor,
    assert_close,
    assert_same_critic_gradients,
    assert_same_gradients,
    assert_same_parameters,
    batch,
    critics,
    draws,
    moved,
    their_gaussian,
    their_loss,
)
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.modules import TanhNormal
from torchrl.objectives import REDQLoss, SoftUpdate
from torchrl.objectives import SACLoss as TorchRLSACLoss

from bricksrl.agents.actor_critic import PolyakUpdate
from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.networks import Dropout
from bricksrl.agents.offline.cql import log_prob
from bricksrl.agents.sac import SACLoss, SACSettings, location_and_scale

pytestmark = pytest.mark.usefixtures("double")


def make(**changes: Any) -> SACLoss:
    kind = {
        key: changes.pop(key) for key in ("norm", "dropout", "hidden", "count") if key in changes
    }
    settings = SACSettings(gamma=GAMMA, alpha_init=0.3, num_qs=kind.get("count", 2), **changes)
    loss: SACLoss = moved(SACLoss(nn.Identity(), actor(2 * ACTION), critics(**kind), settings))
    return loss


def oracle_of(loss: SACLoss, tau: float = 0.5) -> tuple[TorchRLSACLoss, SoftUpdate]:
    policy, count = their_gaussian(loss.actor, loss.settings.min_scale), len(loss.critics)
    return their_loss(
        TorchRLSACLoss,
        loss,
        policy,
        tau,
        num_qvalue_nets=count,
        alpha_init=0.3,
        deactivate_vmap=True,
    )


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"norm": "layer"},
        {"count": 3, "num_min_qs": 3},
        {"count": 1, "num_min_qs": 1},
        {"hidden": (8,), "min_scale": 0.8},
        {"hidden": (12, 10, 8), "norm": "layer"},
    ],
)
@pytest.mark.parametrize("steps", [False, True])
def test_losses_and_gradients_equal_torchrl(
    options: dict[str, Any], steps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss, data, noise = make(**options), batch(N, steps=steps), draws()
    assert (data["next", "done"] & ~data["next", "terminated"]).any()
    oracle, _ = oracle_of(loss)
    noise.for_ours(monkeypatch, "after", "now")
    ours = loss(data)
    noise.for_theirs(monkeypatch, "after", "now")
    theirs = oracle(data)
    names = ("loss_qvalue", "loss_actor", "loss_alpha", "alpha", "entropy")
    assert set(ours.keys()) == set(names) == set(loss.out_keys)
    assert_close([ours[name] for name in names], [theirs[name] for name in names])
    of_critics, of_actor = ((ours[name], theirs[name]) for name in ("loss_qvalue", "loss_actor"))
    assert_same_gradients(loss, oracle, of_critics, of_actor)
    one, other = (
        torch.autograd.grad(ours["loss_alpha"], loss.log_alpha),
        torch.autograd.grad(theirs["loss_alpha"], oracle.log_alpha),
    )
    assert_close(one, other)


def masked(layer: Dropout, x: Tensor) -> Tensor:
    """Equal dropout masks in all networks."""
    kept = (torch.arange(x[0].numel()) * 7 + torch.arange(len(x))[:, None]) % 5 > 0
    return x * kept.view(x.shape) / (1.0 - layer.p) if layer.training else x


def test_droq_equals_torchrls_with_dropout(monkeypatch: pytest.MonkeyPatch) -> None:
    loss, data, noise = make(dropout=0.2, norm="layer"), batch(N), draws()
    oracle, _ = oracle_of(loss)
    plain, _ = oracle_of(make(norm="layer"))
    monkeypatch.setattr(Dropout, "forward", masked)
    noise.for_ours(monkeypatch, "after", "now")
    ours = loss(data)
    noise.for_theirs(monkeypatch, "after", "now")
    theirs = oracle(data)
    assert_close(
        [ours["loss_qvalue"], ours["loss_actor"]], [theirs["loss_qvalue"], theirs["loss_actor"]]
    )
    assert_same_critic_gradients(
        loss.critics, ours["loss_qvalue"], oracle.qvalue_network_params, theirs["loss_qvalue"]
    )
    noise.for_theirs(monkeypatch, "after", "now")
    assert not torch.allclose(plain(data)["loss_qvalue"], theirs["loss_qvalue"])


def test_redq_equals_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    """In TorchRL the temperature also learns from the next step's actions."""
    loss, data, noise = make(count=5, num_min_qs=2, actor_q="mean"), batch(N), draws()
    options = {
        "num_qvalue_nets": 5,
        "sub_sample_len": 2,
        "alpha_init": 0.3,
        "min_alpha": 1e-4,
        "deactivate_vmap": True,
    }
    oracle, _ = their_loss(
        REDQLoss, loss, their_gaussian(loss.actor, loss.settings.min_scale), **options
    )
    monkeypatch.setattr(torch, "randperm", lambda k: torch.tensor([3, 1, 0, 4, 2]))
    noise.for_ours(monkeypatch, "after", "now")
    ours = loss(data)
    both = Draws(both=torch.stack((noise.by_name["now"], noise.by_name["after"])))
    both.for_theirs(monkeypatch, "both")
    theirs = oracle(data)
    total = 5 * theirs["loss_qvalue"]  # the mean over the critics there, their sum here
    assert_close([ours["loss_actor"], ours["loss_qvalue"]], [theirs["loss_actor"], total])
    assert_same_gradients(
        loss, oracle, (ours["loss_qvalue"], total), (ours["loss_actor"], theirs["loss_actor"])
    )


def test_target_critics_are_redrawn_each_update() -> None:
    loss, data = make(count=4, num_min_qs=1), batch(N)
    encoded = loss.encode(data)
    found = {float(loss.next_qvalue(encoded, encoded.action).sum()) for _ in range(40)}
    each = {
        float(target(torch.cat((encoded.next_features, encoded.action), -1)).sum())
        for target in loss.target_critics
    }
    assert {round(value, 9) for value in found} == {round(value, 9) for value in each}


@pytest.mark.parametrize("delay", [1, 3])
def test_whole_updates_equal_torchrl(delay: int, monkeypatch: pytest.MonkeyPatch) -> None:
    loss = make(norm="layer")
    oracle, targets = oracle_of(loss, tau=0.2)
    descent = GradientDescent(
        loss=loss,
        optimizer=torch.optim.Adam(
            [one for one in loss.parameters() if one.requires_grad], lr=3e-3, fused=True
        ),
        target=PolyakUpdate((loss.critics, loss.target_critics), tau=0.2),
        actor_delay=delay,
    )
    optimizer = torch.optim.Adam(oracle.parameters(), lr=3e-3)
    for number in range(1, 7):
        data, noise = batch(N), draws()
        with monkeypatch.context() as patched:
            noise.for_ours(patched, "after", "now")
            told = descent.step(data)
        assert ("loss_actor" in told) == (number % delay == 0)
        with monkeypatch.context() as patched:
            noise.for_theirs(patched, "after", "now")
            found = oracle(data)
        total = found["loss_qvalue"]
        if number % delay == 0:
            total = total + found["loss_actor"] + found["loss_alpha"]
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
        targets.step()
    names = ("actor_network_params", "qvalue_network_params", "target_qvalue_network_params")
    assert_same_parameters(oracle_of(loss)[0], oracle, *names)
    assert_close([loss.log_alpha], [oracle.log_alpha])


def test_actor_loss_has_no_critic_gradient() -> None:
    loss = make()
    found = loss(batch(N))
    (found["loss_actor"] + found["loss_alpha"]).backward()
    assert all(parameter.grad is None for parameter in loss.critics.parameters())
    assert all(parameter.requires_grad for parameter in loss.critics.parameters())
    assert all(parameter.grad is None for parameter in loss.target_critics.parameters())
    assert loss.log_alpha.grad is not None


def test_critics_alone_train_encoder() -> None:
    encoder = nn.Linear(5, 5)
    loss = SACLoss(encoder, actor(2 * ACTION), critics(), SACSettings())
    found = loss(batch(N))
    found["loss_actor"].backward(retain_graph=True)
    assert encoder.weight.grad is None
    found["loss_qvalue"].backward()
    assert encoder.weight.grad is not None


def test_log_probability_equals_torchrl_tanh_normal() -> None:
    out = torch.randn(100, 6)
    action, density = make(min_scale=0.2).draw(out)
    loc, scale = location_and_scale(out, 0.2)
    theirs = TanhNormal(loc, scale)
    assert scale.min() == 0.2
    torch.testing.assert_close(density, theirs.log_prob(action), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(
        log_prob(out, 0.2, action.clamp(-0.99, 0.99)), theirs.log_prob(action.clamp(-0.99, 0.99))
    )


def test_log_probability_stays_finite_where_tanh_saturates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "randn", torch.ones)
    out = torch.tensor([[50.0, 0.0], [-50.0, 0.0]], dtype=torch.float32, requires_grad=True)
    action, density = make(min_scale=0.1).draw(out)
    assert action.detach().abs().tolist() == [[1.0], [1.0]]
    found = (
        density.sum() + log_prob(out, 0.1, torch.tensor([[1.0], [-1.0]], dtype=torch.float32)).sum()
    )
    found.backward()
    assert out.grad is not None
    assert found.isfinite() and out.grad.isfinite().all()


def test_loss_in_keys_are_complete() -> None:
    loss = make()
    needed = TensorDict({}, [N]).update(batch(N).select(*loss.in_keys))
    assert loss(needed)["loss_qvalue"].isfinite()
