from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

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
