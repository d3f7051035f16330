from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import Bounded
from torchrl.modules import ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate

from bricksrl.agents import SACSettings, make_agent
from bricksrl.agents.agent import Transition
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import make_policy
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.sac import SACAgent, sample_action
from bricksrl.errors import CheckpointError
from bricksrl.training.reproducible import reproducible

LAYOUT = ObservationLayout((0.0, -1.0, 0.0), (360.0, 1.0, 2000.0), (True, False, False))
SMALL = SACSettings(hidden=(16, 16), batch_size=8, updates_per_step=1)


@pytest.fixture(autouse=True)
def seeded() -> Iterator[None]:
    with reproducible(3):
        yield


def transitions(count: int, *, reward: float | None = None, terminated: bool = False) -> list[Transition]:
    generator = torch.Generator().manual_seed(5)

    def observation() -> Tensor:
        return torch.rand(3, generator=generator) * torch.tensor([360.0, 2.0, 2000.0]) - torch.tensor([0.0, 1.0, 0.0])

    def transition() -> Transition:
        action = torch.rand(2, generator=generator) * 2 - 1
        value = float(action[0]) if reward is None else reward
        return Transition(observation(), action, value, observation(), terminated)

    return [transition() for _ in range(count)]


def learned(settings: SACSettings, updates: int = 3) -> SACAgent:
    torch.manual_seed(11)
    agent = SACAgent(LAYOUT, 2, settings)
    for transition in transitions(20):
        agent.remember(transition)
    for _ in range(updates):
        agent.update()
    return agent


def weights(agent: SACAgent) -> list[Tensor]:
    state = agent.state_dict()
    return [value for key in ("actor", "critics", "target_critics", "temperature") for value in state[key].values()]


class SeparateCritic(nn.Module):
    """A critic of ordinary layers, as TorchRL's loss wants it."""

    def __init__(self, agent: SACAgent) -> None:
        super().__init__()
        sizes = (agent.encoder.size + 2, *agent.settings.hidden)
        layers: list[nn.Module] = []
        for a, b in pairwise(sizes):
            layers += [nn.Linear(a, b), nn.LayerNorm(b), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(sizes[-1], 1))

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        value: Tensor = self.layers(torch.cat((features, action), -1))
        return value


def oracle_of(agent: SACAgent) -> SACLoss:
    """TorchRL's SACLoss with the agent's own weights."""
    oracle = SACLoss(
        make_policy(agent.actor, 2, in_key="features"),
        ValueOperator(SeparateCritic(agent), in_keys=["features", "action"]),
        num_qvalue_nets=2,
        loss_function="l2",
        alpha_init=agent.settings.initial_alpha,
        action_spec=Bounded(-1.0, 1.0, (2,)),
    )
    oracle.make_value_estimator(gamma=agent.settings.gamma)
    SoftUpdate(oracle, tau=agent.settings.tau)
    for params, critics in (
        (oracle.qvalue_network_params, agent.critics),
        (oracle.target_qvalue_network_params, agent.target_critics),
    ):
        for name, value in critics.named_parameters():
            stacked = value.detach().squeeze(1) if name.endswith("bias") or value.shape[1] == 1 else value.detach().mT
            params.get(("module", *name.split("."))).data.copy_(stacked)
    return oracle


def test_losses_and_gradients_equal_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learned(replace(SMALL, initial_alpha=0.3, tau=0.5), updates=4)
    n = 64
    size = agent.encoder.size
    raw = Batch(torch.randn(n, size), torch.rand(n, 2) * 2 - 1, torch.randn(n), torch.randn(n, size), torch.rand(n) < 0.3)
    with torch.no_grad():
        agent.temperature.log_alpha.fill_(torch.tensor(0.3).log())
    noise = {"now": torch.randn(n, 2), "next": torch.randn(n, 2)}
    order = iter(("next", "now"))
    monkeypatch.setattr(torch, "randn_like", lambda like: noise[next(order)])
    critic_loss, actor_loss, alpha_loss, entropy = agent.losses(raw)
    actor_gradient = torch.autograd.grad(actor_loss, list(agent.actor.parameters()), retain_graph=True)
    critic_gradient = torch.autograd.grad(critic_loss, list(agent.critics.parameters()), retain_graph=True)
    monkeypatch.undo()

    oracle = oracle_of(agent)
    theirs_order = iter(("next", "now"))
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: noise[next(theirs_order)])
    done = raw.terminated[:, None]
    theirs = oracle(
        TensorDict(
            {
                "features": raw.features,
                "action": raw.action,
                "next": {
                    "features": raw.next_features,
                    "reward": raw.reward[:, None],
                    "terminated": done,
                    "done": done,
                },
            },
            [n],
        )
    )
    torch.testing.assert_close(critic_loss, theirs["loss_qvalue"], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(actor_loss, theirs["loss_actor"], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(alpha_loss, theirs["loss_alpha"], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(entropy, theirs["entropy"], rtol=1e-4, atol=1e-5)
    oracle.zero_grad()  # the actor is shared with the agent, which has learned before
    (theirs["loss_actor"] + theirs["loss_qvalue"]).backward()
    for (name, _), ours in zip(agent.actor.named_parameters(), actor_gradient, strict=True):
        their = oracle.actor_network_params.get(("module", "0", "module", *name.split("."))).grad
        torch.testing.assert_close(ours, their, rtol=1e-3, atol=1e-5)
    names = [name for name, _ in agent.critics.named_parameters()]
    for name, ours in zip(names, critic_gradient, strict=True):
        their = oracle.qvalue_network_params.get(("module", *name.split("."))).grad
        stacked = ours.squeeze(1) if name.endswith("bias") or ours.shape[1] == 1 else ours.mT
        torch.testing.assert_close(stacked, their, rtol=1e-3, atol=1e-5)


def test_log_probability_is_that_of_torchrls_tanh_normal() -> None:
    loc, scale = torch.randn(100, 3), torch.rand(100, 3) + 0.1
    action, log_prob = sample_action(loc, scale)
    policy = make_policy(nn.Sequential(nn.Identity()), 3)
    theirs = policy.build_dist_from_params(TensorDict({"loc": loc, "scale": scale}, [100])).log_prob(action)
    clear = action.abs().amax(-1) < 0.99
    torch.testing.assert_close(log_prob[clear], theirs[clear], rtol=1e-3, atol=1e-3)


def test_log_probability_stays_finite_where_tanh_saturates() -> None:
    _, log_prob = sample_action(torch.full((4, 1), 50.0), torch.ones(4, 1))
    assert log_prob.isfinite().all()


CHANGES: dict[str, Any] = {
    "hidden": (16,),
    "learning_rate": 1e-2,
    "adam_beta": 0.5,
    "actor_delay": 2,
    "critics": 3,
    "target_critics": 1,
    "actor_value": "mean",
    "batch_size": 9,
    "gamma": 0.5,
    "tau": 0.5,
    "updates_per_step": 3,
    "initial_alpha": 0.9,
    "min_scale": 2.0,
    "layer_norm": False,
    "dropout": 0.5,
    "angles": "raw",
    "replay_size": 10,
}


@pytest.mark.parametrize("name", [field.name for field in fields(SACSettings) if field.name != "prefill_episodes"])
def test_no_setting_is_dead(name: str) -> None:
    usual, changed = weights(learned(SMALL)), weights(learned(replace(SMALL, **{name: CHANGES[name]})))
    same = [a.shape == b.shape and torch.equal(a, b) for a, b in zip(usual, changed, strict=False)]
    assert not all(same)
    assert all(torch.equal(a, b) for a, b in zip(usual, weights(learned(SMALL)), strict=True))


def test_prefill_is_what_the_settings_say() -> None:
    assert make_agent("sac", LAYOUT, 2, replace(SMALL, prefill_episodes=7)).prefill_episodes == 7


def test_values_go_on_through_a_time_limit_and_end_at_a_termination() -> None:
    def value(*, terminated: bool) -> float:
        agent = SACAgent(LAYOUT, 2, replace(SMALL, gamma=0.9, tau=0.05, initial_alpha=1e-4, learning_rate=3e-3))
        for transition in transitions(30, reward=1.0, terminated=terminated):
            agent.remember(transition)
        for _ in range(400):
            agent.update()
        one = transitions(1)[0]
        return float(agent.critics(agent.encoder(one.observation)[None], one.action[None]).detach().mean())

    assert value(terminated=True) == pytest.approx(1.0, abs=0.2)
    assert value(terminated=False) > 4.0


def test_learns_the_action_that_pays() -> None:
    agent = learned(SMALL, updates=600)
    best = torch.stack([agent.act(t.observation, explore=False) for t in transitions(10)])
    assert best[:, 0].mean() > 0.8


def test_acts_within_bounds_and_explores_around_the_best() -> None:
    agent = learned(SMALL)
    observation = transitions(1)[0].observation
    best = agent.act(observation, explore=False)
    assert torch.equal(best, agent.act(observation, explore=False))
    drawn = torch.stack([agent.act(observation, explore=True) for _ in range(50)])
    assert drawn.std() > 0.05
    assert drawn.abs().max() <= 1.0


def test_without_experience_there_is_nothing_to_update() -> None:
    assert SACAgent(LAYOUT, 2, SMALL).update() == {}


@pytest.mark.parametrize("replay_size", [1000, 12])
def test_state_survives_a_file_and_learning_goes_on_bit_for_bit(replay_size: int) -> None:
    agent = learned(replace(SMALL, dropout=0.1, replay_size=replay_size))
    file = io.BytesIO()
    torch.save(agent.state_dict(), file)
    file.seek(0)
    other = SACAgent(LAYOUT, 2, agent.settings)
    other.load_state_dict(torch.load(file, weights_only=True))
    for one in (agent, other):
        torch.manual_seed(1)
        for transition in transitions(15):
            one.remember(transition)
            one.update()
    assert all(torch.equal(a, b) for a, b in zip(weights(agent), weights(other), strict=True))


def test_state_of_other_networks_is_refused() -> None:
    with pytest.raises(CheckpointError, match="does not fit this agent") as caught:
        SACAgent(LAYOUT, 2, replace(SMALL, hidden=(8,))).load_state_dict(learned(SMALL).state_dict())
    assert "\n" not in str(caught.value)


def test_random_agent_is_uniform_and_learns_nothing() -> None:
    agent = make_agent("random", LAYOUT, 2)
    actions = torch.stack([agent.act(torch.zeros(3), explore=False) for _ in range(2000)])
    assert actions.abs().max() <= 1.0
    assert actions.mean().abs() < 0.05
    assert actions.std() == pytest.approx(3**-0.5, abs=0.02)
    agent.remember(transitions(1)[0])
    assert agent.update() == {}
    agent.load_state_dict(agent.state_dict())


def test_policy_module_shares_the_actor() -> None:
    agent = learned(SMALL)
    policy = make_policy(agent.actor, 2, in_key="features")
    assert isinstance(policy.module[0], TensorDictModule)
    assert next(iter(policy.parameters())) is next(iter(agent.actor.parameters()))
