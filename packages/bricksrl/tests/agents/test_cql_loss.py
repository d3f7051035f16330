"""CQL's losses and gradients against TorchRL's, and the drawn gradient of the soft maximum."""

from __future__ import annotations

from typing import Any

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
    moved,
    their_gaussian,
    their_loss,
)
from torch import Tensor, nn
from torchrl.objectives import CQLLoss as TorchRLCQLLoss

from bricksrl.agents.actor_critic import Batch
from bricksrl.agents.offline.cql import CQLLoss, CQLSettings, draw_indices


def make(**changes: Any) -> CQLLoss:
    kind = {key: changes.pop(key) for key in ("norm", "hidden") if key in changes}
    settings = CQLSettings(gamma=GAMMA, alpha_init=0.3, **changes)
    loss: CQLLoss = moved(CQLLoss(nn.Identity(), actor(2 * ACTION), critics(**kind), settings))
    return loss


class Noise:
    """Equal draws for both losses, in each one's order."""

    def __init__(self) -> None:
        self.of_target, self.of_actor, self.here, self.later = torch.randn(4, N, ACTION).unbind()
        self.uniform = torch.rand(N, ACTION) * 2 - 1

    def for_ours(self, patched: pytest.MonkeyPatch) -> None:
        order = iter((self.of_target, torch.cat((self.here, self.later))[None], self.of_actor))
        patched.setattr(torch, "randn", lambda *shape, **_: next(order))
        patched.setattr(torch, "rand", lambda *shape, **_: (self.uniform[None] + 1) / 2)

    def for_theirs(self, patched: pytest.MonkeyPatch) -> None:
        order = iter((self.of_target, self.here, self.later, self.of_actor, self.of_actor))
        patched.setattr(
            torch.distributions.normal, "_standard_normal", lambda *args, **kw: next(order)
        )
        patched.setattr(Tensor, "uniform_", lambda it, *_: it.copy_(self.uniform))


def oracle_of(loss: CQLLoss) -> TorchRLCQLLoss:
    options = {
        "deterministic_backup": False,
        "num_random": 1,
        "with_lagrange": True,
        "lagrange_thresh": 5.0,
        "alpha_init": 0.3,
    }
    weight = loss.settings.min_q_weight
    oracle, _ = their_loss(
        TorchRLCQLLoss, loss, their_gaussian(loss.actor, 0.1), min_q_weight=weight, **options
    )
    oracle.log_alpha_prime.data.copy_(loss.log_factor.data)
    return oracle


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize(("imitating", "pressing"), [(True, False), (False, False), (False, True)])
def test_losses_and_gradients_equal_torchrl(
    monkeypatch: pytest.MonkeyPatch, imitating: bool, pressing: bool
) -> None:
    weight = 0.7 if pressing else 0.0
    loss = make(
        min_q_weight=weight,
        sampled_actions=1,
        drawn_actions=0,
        lagrange_threshold=5.0,
        imitation_updates=int(imitating),
    )
    loss.log_factor.data.fill_(0.3)
    data = batch(N)
    # TorchRL values the next step's actions in the next state, its paper and we in this one
    if pressing:
        data["next", "observation"] = data["observation"].clone()
    noise, oracle = Noise(), oracle_of(loss)
    with monkeypatch.context() as patched:
        noise.for_ours(patched)
        ours = loss(data)
    assert set(ours.keys()) == set(loss.out_keys)
    with monkeypatch.context() as patched:
        noise.for_theirs(patched)
        of_critic, _ = oracle.q_loss(data)
        of_pressure, _ = oracle.cql_loss(data)
        of_factor, _ = oracle.alpha_prime_loss(data)
        of_policy, found = oracle.actor_bc_loss(data) if imitating else oracle.actor_loss(data)
    assert_close([ours["loss_qvalue"], ours["loss_actor"]], [of_critic, of_policy])
    total = of_critic + oracle.log_alpha_prime.exp().detach() * of_pressure
    mine = ours["loss_qvalue"] + ours["loss_cql"]
    assert_same_gradients(loss, oracle, (mine, total), (ours["loss_actor"], of_policy))
    if pressing:
        assert_close([ours["loss_lagrange"]], [of_factor])
        one = torch.autograd.grad(ours["loss_lagrange"], loss.log_factor)
        assert_close(one, torch.autograd.grad(of_factor, oracle.log_alpha_prime))
    if not imitating:
        assert_close([ours["entropy"]], [-found["_log_prob"].mean()])
        one = torch.autograd.grad(ours["loss_alpha"], loss.log_alpha)
        assert_close(one, torch.autograd.grad(oracle.alpha_loss(found)[0], oracle.log_alpha))


def test_imitation_ends_after_its_updates() -> None:
    loss, data = make(imitation_updates=2), batch(N)
    encoded = loss.encode(data)
    imitated = []
    for _ in range(3):
        torch.manual_seed(1)
        imitated.append(float(loss.actor_loss(encoded)["loss_actor"].detach()))
    assert imitated[0] == imitated[1] != imitated[2]
    other = make(imitation_updates=2)
    other.load_state_dict(loss.state_dict())
    torch.manual_seed(1)
    assert float(other.actor_loss(encoded)["loss_actor"].detach()) == imitated[2]


def pressure_gradient(loss: CQLLoss, data: Batch) -> Tensor:
    """Gradient of the penalty for the critics."""
    parts = torch.autograd.grad(loss.qvalue_loss(data)["loss_cql"], list(loss.critics.parameters()))
    return torch.cat([part.flatten() for part in parts])


def encoded(loss: CQLLoss, n: int) -> Batch:
    return loss.encode(batch(n))


@pytest.mark.usefixtures("double")
def test_soft_maximum_is_over_all_sampled_actions() -> None:
    loss = make(sampled_actions=3, drawn_actions=0, min_q_weight=0.5)
    data = encoded(loss, 5)
    actions, densities = loss.sample_actions(data)
    assert actions.shape == (9, 5, ACTION)
    assert torch.equal(densities[:3], torch.full((3, 5), ACTION * torch.tensor(0.5).log().item()))
    loss.sample_actions = lambda _: (actions, densities)  # type: ignore[method-assign]
    expected = torch.zeros(())
    for k in range(2):
        for i in range(5):
            here = data.features[i : i + 1]
            scores = [
                loss.critics(here, actions[j, i : i + 1])[k, 0] - densities[j, i] for j in range(9)
            ]
            expected = (
                expected
                + 0.5
                * (
                    torch.stack(scores).exp().sum().log()
                    - loss.critics(here, data.action[i : i + 1])[k, 0]
                )
                / 5
            )
    torch.testing.assert_close(loss.qvalue_loss(data)["gap"], expected.detach() / 2)
    theirs = torch.autograd.grad(expected, list(loss.critics.parameters()))
    torch.testing.assert_close(
        pressure_gradient(loss, data), torch.cat([part.flatten() for part in theirs])
    )


def test_drawn_gradient_is_unbiased() -> None:
    full, drawn = (make(sampled_actions=4, drawn_actions=count, hidden=(8,)) for count in (0, 2))
    with torch.no_grad():
        for body in full.critics:
            body[-1].weight.mul_(20.0)  # so that the weights of actions differ
    drawn.load_state_dict(full.state_dict())
    data = encoded(full, 8)
    found = full.sample_actions(data)
    for loss in (full, drawn):
        loss.sample_actions = lambda _: found  # type: ignore[method-assign]
    exact = pressure_gradient(full, data)
    many = torch.stack([pressure_gradient(drawn, data) for _ in range(500)])
    error = (many.mean(0) - exact).norm()
    spread = many.std(0).norm() / 500**0.5
    assert spread < 0.05 * exact.norm()
    assert error < 2.0 * spread
    assert many.std(0).norm() > 0.05 * exact.norm()  # it does vary: the test can fail


@pytest.mark.parametrize("sampled", [1, 2, 100])
def test_scores_equal_critic_values(sampled: int) -> None:
    loss = make(sampled_actions=sampled, norm="layer")
    data = encoded(loss, 8)
    actions, _ = loss.sample_actions(data)
    expected = [loss.critics(data.features, action) for action in actions]
    torch.testing.assert_close(
        loss.scores(data.features, actions), torch.stack(expected, 1).detach(), rtol=1e-5, atol=1e-5
    )


def test_penalty_factor_grows_with_gap() -> None:
    loss = make(lagrange_threshold=-100.0, sampled_actions=2)
    found = loss.qvalue_loss(encoded(loss, 8))
    (slope,) = torch.autograd.grad(found["loss_lagrange"], loss.log_factor)
    assert found["gap"] > -100.0
    assert slope < 0.0
    fixed = make(sampled_actions=2)
    assert not fixed.log_factor.requires_grad
    assert "loss_lagrange" not in fixed.qvalue_loss(encoded(fixed, 8))


def test_draws_follow_weights() -> None:
    weights = torch.tensor([0.5, 0.0, 0.3, 0.2])[None, :, None].repeat(2, 1, 3)
    found = torch.cat([draw_indices(weights, 4) for _ in range(2000)], 1)
    assert found.shape == (2, 8000, 3)
    shares = torch.stack([(found == place).float().mean(1) for place in range(4)])
    torch.testing.assert_close(shares, weights[0, :, :1, None].expand(4, 2, 3), rtol=0.0, atol=0.02)
    assert not (found == 1).any()
