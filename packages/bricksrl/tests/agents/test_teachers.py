"""Teachers: a base, demonstrations, and the anchor."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small import ENV, learned, make, same, saved, steps, weights
from torch import Tensor, nn

from bricksrl.agents.actor_critic import ActorCriticLoss
from bricksrl.agents.anchor import REACH, REACH_ON_BASE, PolicyAnchor
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.teachers import ALPHA, Base, Scripted, add_base, imitate
from bricksrl.errors import RunError
from bricksrl.policies.policy import Policy

TAUGHT = ("sac", "droq", "td3", "crossq", "cql")


def of(learner: GradientLearner) -> ActorCriticLoss:
    assert isinstance(learner.loss, ActorCriticLoss)
    return learner.loss


def shown(count: int = 30) -> Tensor:
    """What a demonstrator does in these steps of the arm: it turns towards the goal."""
    angle, goal = steps(count)["observation"].split(4, -1)
    return ((goal - angle) / 200.0).clamp(-1.0, 1.0)


def acts(learner: GradientLearner) -> Tensor:
    found: Tensor = learner.exploit(steps(30))["action"]
    return found


def of_base(agent: str = "sac", before: str = "td3") -> tuple[GradientLearner, GradientLearner]:
    """A learner on the policy of another one, and that one."""
    one, other = learned(before), make(agent, seed=5)
    add_base(other, Base(one.policy))
    return other, one


@pytest.mark.parametrize("agent", TAUGHT)
def test_demonstrations_are_imitated(agent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bricksrl.agents.teachers.UPDATES", 250)
    learner = make(agent, seed=5, hidden=(64,))
    imitate(learner, steps(30), shown())
    assert float((acts(learner) - shown()).abs().mean()) < 0.05
    explored = torch.stack([learner.explore(steps(1)[0])["action"] for _ in range(50)])
    assert 0.01 < explored.std(0).max() < 0.5
    if agent == "td3":
        assert same(
            list(of(learner).actor.parameters()), list(of(learner).target_actor.parameters())
        )
    else:
        assert float(of(learner).alpha) <= ALPHA * 1.0001


def test_imitation_moves_the_statistics_of_an_actor_that_normalises() -> None:
    """CrossQ's actor is in evaluation mode otherwise, and stays so afterwards."""
    learner = make("crossq", seed=5, hidden=(16,))
    actor = of(learner).actor
    before = [buffer.clone() for buffer in actor.buffers()]
    was_training = actor.training
    imitate(learner, steps(30), shown())
    assert before and not same(before, list(actor.buffers()))
    assert actor.training == was_training


@pytest.mark.parametrize("agent", TAUGHT)
def test_a_base_acts_alone_at_first_and_stays_as_it_is(agent: str) -> None:
    learner, base = of_base(agent)
    torch.testing.assert_close(acts(learner), acts(base))
    frozen, before = [part.clone() for part in base.policy.parameters()], acts(learner)
    learner.remember(steps(30))
    learner.make_updates(20)
    assert not torch.equal(acts(learner), before) and bool((acts(learner).abs() <= 1.0).all())
    assert same(frozen, list(base.policy.parameters()))
    learner.see(steps(30).apply(lambda value: value * 10.0))
    torch.testing.assert_close(of(learner).base(steps(30)), acts(base))  # type: ignore[misc]


def test_losses_are_of_the_action_on_the_base() -> None:
    """With a base that acts, the critics value what the robot does: an actor that adds nothing is
    worth what the base is."""
    learner, base = of_base("td3")
    loss, batch = of(learner), of(learner).encode(steps(30))
    torch.testing.assert_close(batch.base, acts(base))
    worth = -loss.critics(batch.features, acts(base))[0].mean()
    torch.testing.assert_close(loss.actor_loss(batch)["loss_actor"], worth)


def test_residual_policies_are_saved_whole() -> None:
    one, _ = of_base()
    one.remember(steps(30))
    one.make_updates(3)
    other = make("sac", seed=8)
    add_base(other, Base(learned("td3", updates=7).policy))
    other.load_state_dict(saved(one))
    assert same(weights(one), weights(other))
    torch.testing.assert_close(acts(other), acts(one))
    assert of(other).anchor.get_extra_state() == {"made": 3}  # type: ignore[union-attr]
    for each in (one, other):
        torch.manual_seed(1)
        each.make_updates(3)
    assert same(weights(one), weights(other))


def test_controllers_act_in_any_batch() -> None:
    base = Base(Scripted(lambda state: np.tanh(state["observation"][4:]), ["observation"]))
    seen = steps(6)
    torch.testing.assert_close(base(seen), seen["observation"][:, 4:].tanh())
    torch.testing.assert_close(base(seen[0]), seen["observation"][0, 4:].tanh())
    learner = make("sac", seed=5)
    add_base(learner, base)
    observation = seen["observation"][0].numpy()
    np.testing.assert_allclose(
        Policy(learner.policy, ENV).act(observation), np.tanh(observation[4:]), atol=1e-6
    )


@pytest.mark.parametrize("agent", ["tqc", "ppo", "iql", "bc", "random"])
def test_other_agents_cannot_be_taught(agent: str) -> None:
    says = "^only sac, droq, redq, td3, crossq and cql can be taught; choose one of them$"
    with pytest.raises(RunError, match=says):
        imitate(make(agent), steps(5), shown(5))
    with pytest.raises(RunError, match=says):
        add_base(make(agent), Base(make("td3").policy))


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
    # a step goes 0.05
    assert all(far <= may + 0.06 for far, may in zip(away, allowed, strict=True))
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


def test_taught_policy_does_not_collapse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an anchor the policy is lost within a few updates."""
    monkeypatch.setattr("bricksrl.agents.teachers.UPDATES", 150)
    distances = []
    for held in (True, False):
        learner = make("sac", seed=5)
        imitate(learner, steps(30), shown())
        before = acts(learner)
        if not held:
            of(learner).anchor = None
        learner.remember(steps(30))
        torch.manual_seed(1)
        learner.make_updates(30)
        distances.append(float((acts(learner) - before).square().mean().sqrt()))
    assert distances[0] < 0.5 * distances[1]


def test_anchor_holds_what_acts_on_a_base_more_loosely() -> None:
    """It may move by a share of the range on its own, and less where a base acts already."""
    alone, (on_base, _) = make("sac", seed=5), of_base()
    of(alone).anchor_actor()
    of(on_base).anchor_actor()
    reaches = [of(learner).anchor._reach for learner in (alone, on_base)]  # type: ignore[union-attr]
    assert reaches == [REACH, REACH_ON_BASE] and REACH != REACH_ON_BASE


def test_anchor_counts_only_what_is_learned() -> None:
    actor = nn.Linear(3, 2)
    hold = PolicyAnchor(actor, 2, updates=2)
    features = torch.randn(4, 3)
    with torch.no_grad():
        out = actor(features)
        assert hold(features, out) is out
    assert hold.updates_made == 0
    for _ in range(4):
        hold(features, actor(features))
    assert hold.updates_made == 2, "after them nothing is held, nor counted"


def test_numbers_of_a_controller_are_those_of_networks() -> None:
    """NumPy's own are twice as long."""
    base = Base(Scripted(lambda state: np.zeros(4, np.float64), ["observation"]))
    assert base(steps(2)).dtype == torch.float32
