"""Networks: dropout of the critics, what it drops, its scale and its gradients; what a policy does
not import."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

import bricksrl
from bricksrl.agents import make_learner
from bricksrl.agents.networks import Dropout, mlp


@pytest.mark.parametrize("shape", [(256, 256), (7, 3), (1,), (0, 4)])
def test_kept_units_are_scaled_and_others_zero(shape: tuple[int, ...]) -> None:
    out = Dropout(0.25)(torch.ones(shape))
    assert out.shape == shape
    assert ((out == 0) | (out == 4.0 / 3.0)).all()


@pytest.mark.parametrize("rate", [0.0, 0.01, 0.5, 0.9])
def test_share_of_dropped_units(rate: float) -> None:
    torch.manual_seed(0)
    units = torch.cat([Dropout(rate)(torch.ones(1000, 1000)).flatten() for _ in range(2)])
    deviation = (rate * (1.0 - rate) / units.numel()) ** 0.5
    assert (units == 0).float().mean().item() == pytest.approx(rate, abs=4 * deviation + 2**-16)
    assert units.mean().item() == pytest.approx(1.0, abs=5 * deviation / (1.0 - rate) + 1e-5)


def test_units_are_dropped_independently() -> None:
    """No unit tells about its neighbour, about the one of the other half of its draw, or about the
    next row."""
    torch.manual_seed(0)
    dropped = (Dropout(0.5)(torch.ones(1024, 1024)) == 0).float() - 0.5
    flat = dropped.flatten()
    for distance in (1, 2, 4, 1024, len(flat) // 2):
        correlation = 4.0 * (flat[distance:] * flat[:-distance]).mean().item()
        assert abs(correlation) < 5.0 / (len(flat) - distance) ** 0.5


def test_gradient_passes_kept_units_only() -> None:
    x = torch.randn(64, 64, requires_grad=True)
    out = Dropout(0.3)(x)
    out.sum().backward()
    assert x.grad is not None
    torch.testing.assert_close(x.grad, (out / x).detach())


def test_seed_repeats_and_evaluation_drops_nothing() -> None:
    network, x = mlp(4, 2, (32,), dropout=0.5), torch.randn(8, 4)
    assert any(isinstance(layer, Dropout) for layer in network)
    torch.manual_seed(1)
    first = network(x)
    torch.manual_seed(1)
    assert torch.equal(network(x), first)
    assert not torch.equal(network(x), first)
    network.eval()
    assert torch.equal(network(x), network(x))


def test_nearly_everything_dropped_stays_finite() -> None:
    assert torch.isfinite(Dropout(1.0 - 1e-9)(torch.ones(1000))).all()


@pytest.mark.parametrize("agent", ["sac", "td3"])
def test_a_policy_does_not_ask_whether_tensors_are_tables(
    monkeypatch: pytest.MonkeyPatch, agent: str
) -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    learner, state = make_learner(agent, env), env.reset()
    monkeypatch.setattr(TensorDict, "from_any", None)  # it imports pandas
    assert learner.explore(state)["action"].shape == learner.exploit(state)["action"].shape == (4,)
