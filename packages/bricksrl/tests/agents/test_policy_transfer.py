"""Policy transfer between algorithms, and the anchor."""

from __future__ import annotations

import pytest
import torch
from small import SIGHT, learned, make, same, saved, steps, weights
from torch import nn

from bricksrl.agents.learner import Learner
from bricksrl.agents.policy_transfer import ALPHA, REACH, PolicyAnchor, PolicyFormError, anchor, restore, transfer_policy
from bricksrl.agents.sac import ActorCriticLoss


def of(learner: Learner) -> ActorCriticLoss:
    assert isinstance(learner.loss, ActorCriticLoss)
    return learner.loss


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("bc", "sac"),
        ("bc", "td3"),
        ("bc", "cql"),
        ("iql", "redq"),
        ("sac", "droq"),
        ("tqc", "sac"),
        ("td3", "sac"),
        ("sac", "td3"),
    ],
)
def test_transferred_policy_is_equal(before: str, after: str) -> None:
    one, seen = learned(before, updates=30, actor_layer_norm=False, dropout=0.0), steps(5)
    other = make(after, seed=5)
    transfer_policy(other, one)
    torch.testing.assert_close(other.exploit(seen)["action"], one.exploit(seen)["action"], rtol=1e-5, atol=1e-6)
    explored = torch.stack([other.explore(seen[0])["action"] for _ in range(50)])
    assert explored.std(0).max() > 0.01
    if after == "td3":
        assert same(list(of(other).actor.parameters()), list(of(other).target_actor.parameters()))
    elif before in ("bc", "iql", "td3"):
        assert float(of(other).alpha) <= ALPHA * 1.0001
    else:
        assert torch.equal(of(other).log_alpha, one.loss.log_alpha)  # type: ignore[union-attr]


def test_layer_normalisations_are_transferred() -> None:
    one = learned("bc", updates=30, actor_layer_norm=True, dropout=0.0)
    other = make("sac", seed=5, actor_layer_norm=True)
    transfer_policy(other, one)
    torch.testing.assert_close(other.exploit(steps(5))["action"], one.exploit(steps(5))["action"], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("before", "after", "changes", "says"),
    [
        ("sac", "td3", {"hidden": (32,)}, "its network is 14-16-16 units .*, not 14-32 units"),
        ("sac", "td3", {"angles": "raw"}, "its network is 14-16-16 units on 14 features, not 12-16-16 units on 12 features"),
        ("sac", "crossq", {}, "its network is 14-16-16 units on .* not 14-16-16 units with 3 normalisations"),
        ("act", "sac", {}, "a network from observations to single actions"),
        ("random", "sac", {}, "a network from observations to single actions"),
        ("sac", "bc", {}, "transfer needs critics"),
        ("sac", "ppo", {}, "transfer needs critics"),
    ],
)
def test_policy_of_other_form_raises(before: str, after: str, changes: dict[str, object], says: str) -> None:
    other = make(after, **changes)
    state = weights(other)
    with pytest.raises(PolicyFormError, match=says):
        transfer_policy(other, make(before))
    assert same(state, weights(other))


def test_policy_with_images_raises() -> None:
    with pytest.raises(PolicyFormError, match="observations"):
        transfer_policy(make("sac", env=SIGHT), make("bc"))


def test_anchor_equilibrium_is_allowed_distance() -> None:
    actor = nn.Linear(3, 2)
    hold = PolicyAnchor(actor, 2, updates=100)
    features, optimizer = torch.randn(64, 3), torch.optim.SGD(actor.parameters(), lr=0.1)
    away = []
    for _ in range(100):
        out = hold(features, actor(features))
        optimizer.zero_grad()
        (-out).mean().backward()  # pulls away for ever, with the same slope everywhere
        optimizer.step()
        with torch.no_grad():
            away.append(float((actor(features) - hold.policy(features)).square().mean().sqrt()))
    assert hold.get_extra_state() == {"made": 100}
    allowed = [REACH * (made + 1) / 100 for made in range(100)]
    assert all(far <= may + 0.06 for far, may in zip(away, allowed, strict=True))  # a step goes 0.05
    assert all(far > 0.65 * may for far, may in zip(away[20:], allowed[20:], strict=True))
    for _ in range(20):
        optimizer.zero_grad()
        (-hold(features, actor(features))).mean().backward()
        optimizer.step()
    assert (actor(features) - hold.policy(features)).square().mean().sqrt() > REACH + 0.3


def test_anchor_affects_mean_only() -> None:
    actor = nn.Linear(3, 4)
    hold = PolicyAnchor(actor, 2, updates=10)
    with torch.no_grad():
        actor.bias += 1.0
    features = torch.randn(8, 3)
    plain = actor(features).requires_grad_()
    plain.retain_grad()
    held = hold(features, actor(features))
    held.retain_grad()
    slope = torch.ones(8, 4) / 8
    (held * slope).sum().backward()
    (plain * slope).sum().backward()
    assert torch.equal(held.grad[:, 2:], slope[:, 2:])
    expected = slope[:, :2] + 1.0 * slope[:, :2].square().mean().sqrt() / (REACH / 10)
    torch.testing.assert_close(held.grad[:, :2], expected)


def test_anchor_state_is_restored() -> None:
    one = make("sac")
    transfer_policy(one, learned("td3"))
    one.remember(steps(30))
    one.make_updates(3)
    other = make("sac", seed=5)
    restore(other, saved(one))
    assert of(other).anchor is not None
    assert of(other).anchor.get_extra_state() == {"made": 3}  # type: ignore[union-attr]
    for each in (one, other):
        torch.manual_seed(1)
        each.make_updates(3)
    assert same(weights(one), weights(other))


def test_transferred_policy_does_not_collapse() -> None:
    """Without an anchor the policy is lost within a few updates."""
    source, seen = learned("bc", updates=100, dropout=0.0, actor_layer_norm=False), steps(30)
    distances = []
    for held in (True, False):
        learner = make("sac", seed=5)
        transfer_policy(learner, source)
        if not held:
            of(learner).anchor = None
        learner.remember(seen)
        torch.manual_seed(1)
        learner.make_updates(60)
        distances.append(float((learner.exploit(seen)["action"] - source.exploit(seen)["action"]).square().mean().sqrt()))
    assert distances[0] < 0.5 * distances[1]
    anchor(make("sac"))
