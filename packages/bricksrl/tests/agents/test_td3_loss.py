"""TD3's losses, gradients and whole updates against TorchRL's."""

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
    assert_same_parameters,
    batch,
    critics,
    moved,
    their_deterministic,
    their_loss,
)
from torch import nn
from torchrl.objectives import SoftUpdate
from torchrl.objectives import TD3Loss as TorchRLTD3Loss

from bricksrl.agents.actor_critic import PolyakUpdate
from bricksrl.agents.gradient_descent import GradientDescent
from bricksrl.agents.td3 import TD3Loss, TD3Settings

pytestmark = pytest.mark.usefixtures("double")


def make() -> TD3Loss:
    settings = TD3Settings(gamma=GAMMA, target_noise=0.5, target_noise_clip=0.4)
    loss: TD3Loss = moved(TD3Loss(nn.Identity(), actor(ACTION), critics(norm="layer"), settings))
    return loss


def oracle_of(loss: TD3Loss, tau: float = 0.5) -> tuple[TorchRLTD3Loss, SoftUpdate]:
    options = {"policy_noise": 0.5, "noise_clip": 0.4, "deactivate_vmap": True}
    return their_loss(TorchRLTD3Loss, loss, their_deterministic(loss.actor), tau, **options)


@pytest.mark.parametrize("steps", [False, True])
def test_losses_and_gradients_equal_torchrl(steps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    loss, data, noise = make(), batch(N, steps=steps), torch.randn(N, ACTION)
    assert (noise.abs() > 0.8).any()
    monkeypatch.setattr(torch, "randn_like", lambda like: noise.clone())
    oracle, _ = oracle_of(loss)
    ours = loss(data)
    their_critics, _ = oracle.value_loss(data)
    their_actor, _ = oracle.actor_loss(data)
    assert set(ours.keys()) == set(loss.out_keys)
    assert_close([ours["loss_qvalue"], ours["loss_actor"]], [their_critics, their_actor])
    assert_same_gradients(
        loss, oracle, (ours["loss_qvalue"], their_critics), (ours["loss_actor"], their_actor)
    )


def test_whole_updates_equal_torchrl(monkeypatch: pytest.MonkeyPatch) -> None:
    loss = make()
    oracle, targets = oracle_of(loss, tau=0.2)
    descent = GradientDescent(
        loss=loss,
        optimizer=torch.optim.Adam(
            [one for one in loss.parameters() if one.requires_grad], lr=3e-3, fused=True
        ),
        target=PolyakUpdate(
            (loss.critics, loss.target_critics), (loss.actor, loss.target_actor), tau=0.2
        ),
        actor_delay=2,
        target_delay=2,
    )
    for_critics = torch.optim.Adam(
        list(oracle.qvalue_network_params.flatten_keys().values()), lr=3e-3
    )
    for_actor = torch.optim.Adam(list(oracle.actor_network_params.flatten_keys().values()), lr=3e-3)
    for number in range(1, 7):
        data, noise = batch(N), torch.randn(N, ACTION)
        monkeypatch.setattr(torch, "randn_like", lambda like, noise=noise: noise.clone())
        descent.step(data)
        losses = (
            [oracle.value_loss(data)[0]]
            if number % 2
            else [oracle.value_loss(data)[0], oracle.actor_loss(data)[0]]
        )
        for optimizer, one in zip((for_critics, for_actor), losses, strict=False):
            optimizer.zero_grad()
            one.backward(retain_graph=True)
        for optimizer, _ in zip((for_critics, for_actor), losses, strict=False):
            optimizer.step()
        if number % 2 == 0:
            targets.step()
    names = ("actor_network_params", "qvalue_network_params")
    assert_same_parameters(
        oracle_of(loss)[0], oracle, *names, *(f"target_{name}" for name in names)
    )


def test_target_noise_is_clipped(monkeypatch: pytest.MonkeyPatch) -> None:
    loss, data = make(), batch(N)
    encoded = loss.encode(data)
    monkeypatch.setattr(torch, "randn_like", lambda like: torch.full_like(like, 100.0))
    action = (loss.target_actor(encoded.next_features).tanh() + 0.4).clamp(max=1.0)
    value = loss.target_critics(encoded.next_features, action).amin(0)
    assert_close([loss.target_qvalue(encoded)], [encoded.reward + encoded.discount * value])
