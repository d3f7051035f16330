"""Losses and gradients of the offline agents against TorchRL's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
import torch
from learning import LAYOUT, fresh
from oracle import (
    assert_close,
    batch_of,
    copy_critics,
    frozen,
    gradients_of,
    of_actor,
    of_critics,
    separate,
    to_torchrl,
    written,
    written_for_critics,
)
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Bounded
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import BCLoss, CQLLoss, IQLLoss, SoftUpdate, TD3BCLoss

from bricksrl.agents import preset
from bricksrl.agents.networks import make_policy
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.offline_bc import BCAgent
from bricksrl.agents.offline_cql import CQLAgent, draw_places
from bricksrl.agents.offline_iql import IQLAgent
from bricksrl.agents.offline_td3bc import TD3BCAgent

CLOSE = {"rtol": 1e-5, "atol": 1e-5}


def learner(name: str, **changes: Any) -> Any:
    """An agent whose targets differ from its networks."""
    usual = {"hidden": (16, 16), "batch_size": 16}
    agent = fresh(name, replace(preset("paper", name), **{**usual, **changes}))
    for _ in range(3):
        agent._updates += 1
        agent.learn(batch_of(agent, agent.settings.batch_size), actor=True)
    return agent


def layers(sizes: tuple[int, ...]) -> nn.Sequential:
    made: list[nn.Module] = []
    for a, b in pairwise(sizes):
        made += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*made, nn.Linear(sizes[-1], 1))


def critic_of(agent: Any) -> ValueOperator:
    return ValueOperator(separate(layers((agent.encoder.size + 4, 16, 16))), in_keys=["features", "action"])


def assert_same_gradients(module: nn.Module, ours: Tensor, theirs: Tensor, params: Any, prefix: tuple[str, ...] = ()) -> None:
    names = [name for name, _ in module.named_parameters()]
    one = torch.autograd.grad(ours, [value for _, value in module.named_parameters()], retain_graph=True)
    other = torch.autograd.grad(theirs, [params.get((*prefix, *name.split("."))) for name in names], retain_graph=True)
    torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


@pytest.mark.filterwarnings("ignore:The name target_actor_network_params:UserWarning")  # TorchRL's own
def test_bc_equals_torchrls() -> None:
    agent = learner("bc", dropout=0.0)
    assert isinstance(agent, BCAgent)
    batch = batch_of(agent, 64)
    oracle = BCLoss(TensorDictModule(agent.actor, ["features"], ["action"]), loss_function="l2")
    theirs = oracle(to_torchrl(batch))["loss_bc"]
    torch.testing.assert_close(agent.actor_loss(batch), theirs, **CLOSE)
    assert_same_gradients(agent.actor, agent.actor_loss(batch), theirs, oracle.actor_network_params, ("module",))


class Normal(nn.Module):
    """An actor of ours as TorchRL's normal wants it: location and scale."""

    def __init__(self, actor: Any) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        loc = self.actor(features)
        return loc, self.actor.scale().expand_as(loc)


def test_iql_equals_torchrls() -> None:
    agent = learner("iql", tau=0.4, expectile=0.8, temperature=2.0)
    assert isinstance(agent, IQLAgent)
    batch = batch_of(agent, 64)
    critic_loss, value_loss, actor_loss = agent.losses(batch)
    actor = ProbabilisticActor(
        TensorDictSequential(TensorDictModule(Normal(agent.actor), ["features"], ["loc", "scale"])),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        distribution_kwargs={"tanh_loc": False},
        spec=Bounded(-1.0, 1.0, (4,)),
    )
    value = ValueOperator(layers((agent.encoder.size, 16, 16)), in_keys=["features"])
    for (name, ours), other in zip(agent.value.layers.named_parameters(), value.module.parameters(), strict=True):
        other.data.copy_(ours[0].mT if name.endswith("weight") else ours[0, 0])
    oracle = IQLLoss(actor, critic_of(agent), value, loss_function="l2", temperature=2.0, expectile=0.8)
    oracle.make_value_estimator(gamma=0.99)
    SoftUpdate(oracle, tau=0.4)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    theirs = oracle(to_torchrl(batch))
    torch.testing.assert_close(critic_loss, theirs["loss_qvalue"], **CLOSE)
    torch.testing.assert_close(value_loss, theirs["loss_value"], **CLOSE)
    torch.testing.assert_close(actor_loss, theirs["loss_actor"], **CLOSE)
    ours, other = gradients_of(agent.critics, critic_loss, oracle.qvalue_network_params, theirs["loss_qvalue"])
    torch.testing.assert_close(ours, other, rtol=1e-4, atol=1e-5)
    ours = torch.autograd.grad(value_loss, list(agent.value.parameters()))
    other = torch.autograd.grad(theirs["loss_value"], list(oracle.value_network_params.flatten_keys().values()))
    for one, two in zip(sorted(ours, key=torch.numel), sorted(other, key=torch.numel), strict=True):
        torch.testing.assert_close(one.norm(), two.norm(), rtol=1e-4, atol=1e-5)
    prefix = ("module", "0", "module", "0", "module", "actor")
    assert_same_gradients(agent.actor, actor_loss, theirs["loss_actor"], oracle.actor_network_params, prefix)


def test_td3bc_equals_torchrls(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = learner("td3bc", tau=0.4, target_noise=0.5, value_weight=2.0, batch_size=64)
    assert isinstance(agent, TD3BCAgent)
    batch = batch_of(agent, 64)
    noise = torch.randn(64, 4)
    monkeypatch.setattr(torch, "randn_like", lambda like: noise)
    oracle = TD3BCLoss(
        TensorDictModule(agent.actor, ["features"], ["action"]),
        critic_of(agent),
        action_spec=Bounded(-1.0, 1.0, (4,)),
        policy_noise=0.5,
        loss_function="l2",
        alpha=2.0,
    )
    oracle.make_value_estimator(gamma=0.99)
    SoftUpdate(oracle, tau=0.4)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    for name, value in agent.target_actor.named_parameters():
        oracle.target_actor_network_params.get(("module", *name.split("."))).data.copy_(value)
    of_actor, _ = oracle.actor_loss(to_torchrl(batch))
    of_critics, _ = oracle.qvalue_loss(to_torchrl(batch))
    frozen(monkeypatch)
    critic_loss, actor_loss = agent.learn(batch, actor=True)
    torch.testing.assert_close(actor_loss, of_actor, **CLOSE)
    torch.testing.assert_close(critic_loss, of_critics, **CLOSE)
    params = [oracle.actor_network_params.get(("module", *name.split("."))) for name, _ in agent.actor.named_parameters()]
    assert_close(written(agent.learned_actor, agent.actor), torch.autograd.grad(of_actor, params))


class Noise:
    """The same draws for both, in the order in which each asks for them."""

    def __init__(self, batch: int) -> None:
        self.of_target, self.of_actor, self.here, self.later = torch.randn(4, batch, 4).unbind()
        self.uniform = torch.rand(batch, 4) * 2 - 1

    def for_ours(self, patched: pytest.MonkeyPatch) -> None:
        order = iter((torch.cat((self.of_target, self.of_actor)), torch.cat((self.here, self.later))))
        patched.setattr(torch, "randn", lambda *shape: next(order))
        patched.setattr(torch, "rand", lambda *shape: (self.uniform[None] + 1) / 2)

    def for_theirs(self, patched: pytest.MonkeyPatch) -> None:
        order = iter((self.of_target, self.here, self.later, self.of_actor, self.of_actor))
        patched.setattr(torch.distributions.normal, "_standard_normal", lambda *args, **kw: next(order))
        patched.setattr(Tensor, "uniform_", lambda it, *_: it.copy_(self.uniform))


def oracle_of(agent: CQLAgent) -> CQLLoss:
    oracle = CQLLoss(
        make_policy(agent.actor, 4, in_key="features"),
        critic_of(agent),
        loss_function="l2",
        alpha_init=float(agent.temperature.alpha()),
        action_spec=Bounded(-1.0, 1.0, (4,)),
        deterministic_backup=False,
        num_random=1,
        min_q_weight=agent.settings.min_q_weight,
        with_lagrange=True,
        lagrange_thresh=5.0,
    )
    oracle.make_value_estimator(gamma=0.99)
    SoftUpdate(oracle, tau=0.4)
    copy_critics(agent.critics, oracle.qvalue_network_params)
    copy_critics(agent.target_critics, oracle.target_qvalue_network_params)
    oracle.log_alpha_prime.data.copy_(agent.pressure.log_factor.data)
    return oracle


@pytest.fixture
def double() -> Iterator[None]:
    """TorchRL takes log-probabilities from actions that went through a tanh, where single precision loses digits."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize(("imitating", "pressing"), [(True, False), (False, False), (False, True)])
def test_cql_equals_torchrls(monkeypatch: pytest.MonkeyPatch, imitating: bool, pressing: bool) -> None:
    settings = {"tau": 0.4, "min_q_weight": 0.7 if pressing else 0.0, "sampled_actions": 1, "drawn_actions": 0, "batch_size": 64}
    agent = learner("cql", **settings, imitation_updates=100 if imitating else 0)
    assert isinstance(agent, CQLAgent)
    batch = replace(batch_of(agent, 64), action=batch_of(agent, 64).action * 0.99)
    if pressing:  # TorchRL values the next step's actions in the next state, its paper and we in this one
        batch = replace(batch, next_features=batch.features)
    noise, oracle, data = Noise(64), oracle_of(agent), to_torchrl(batch)
    with monkeypatch.context() as patched:
        frozen(patched)
        noise.for_ours(patched)
        critic, gap, actor, entropy, _ = agent.learn(batch, actor=True)
    with monkeypatch.context() as patched:
        noise.for_theirs(patched)
        of_critic, _ = oracle.q_loss(data)
        of_pressure, _ = oracle.cql_loss(data)
        of_factor, _ = oracle.alpha_prime_loss(data)
        of_policy, found = oracle.actor_bc_loss(data) if imitating else oracle.actor_loss(data)
    torch.testing.assert_close(critic, of_critic, **CLOSE)
    torch.testing.assert_close(actor, of_policy, **CLOSE)
    total = of_critic + oracle.log_alpha_prime.exp().detach() * of_pressure
    theirs = torch.autograd.grad(total, of_critics(agent.critics, oracle.qvalue_network_params))
    assert_close(written_for_critics(agent.learned_critics, agent.critics), theirs)
    params = of_actor(agent.actor, oracle.actor_network_params, ("module", "0", "module"))
    assert_close(written(agent.learned_actor, agent.actor), torch.autograd.grad(of_policy, params))
    if pressing:
        torch.testing.assert_close(agent.pressure.log_factor.exp() * (5.0 - gap), of_factor, **CLOSE)
        theirs = torch.autograd.grad(of_factor, [oracle.log_alpha_prime])
        assert_close(written(agent.learned_pressure, agent.pressure), theirs)
    if not imitating:
        torch.testing.assert_close(entropy, -found["_log_prob"].mean(), **CLOSE)
        theirs = torch.autograd.grad(oracle.alpha_loss(found)[0], [oracle.log_alpha])
        assert_close(written(agent.learned_actor, agent.temperature), theirs)


def pressure_gradient(agent: CQLAgent, batch: Batch) -> Tensor:
    """What the pressure adds to the gradient of the critics."""
    found = []
    for log_factor in (agent.pressure.log_factor.detach().clone(), torch.tensor(-torch.inf)):
        agent.pressure.log_factor.data.copy_(log_factor)
        with torch.no_grad():
            agent.descend_critics(batch, torch.zeros_like(batch.action), torch.zeros(len(batch.reward)))
        found.append(torch.cat([part.flatten() for part in written(agent.learned_critics, agent.critics)]))
    agent.pressure.log_factor.data.fill_(0.0)
    return found[0] - found[1]


def test_the_soft_maximum_is_over_all_sampled_actions() -> None:
    agent = learner("cql", sampled_actions=3, drawn_actions=0, batch_size=5, min_q_weight=0.5)
    batch = batch_of(agent, 5)
    actions, densities = agent.sampled(batch)
    assert actions.shape == (9, 5, 4)
    assert torch.equal(densities[:3], torch.full((3, 5), 4 * torch.tensor(0.5).log().item()))
    agent.sampled = lambda _: (actions, densities)
    agent.pressure.log_factor.data.fill_(0.0)
    expected = torch.zeros(())
    for k in range(2):
        for i in range(5):
            here = batch.features[i : i + 1]
            scores = [agent.critics(here, actions[j, i : i + 1])[k, 0] - densities[j, i] for j in range(9)]
            expected += 0.5 * (torch.stack(scores).exp().sum().log() - agent.critics(here, batch.action[i : i + 1])[k, 0]) / 5
    with torch.no_grad():
        _, gap = agent.descend_critics(batch, torch.zeros_like(batch.action), torch.zeros(5))
    torch.testing.assert_close(gap, expected.detach() / 2, **CLOSE)
    theirs = torch.autograd.grad(expected, list(agent.critics.parameters()))
    ours = pressure_gradient(agent, batch)
    torch.testing.assert_close(ours, torch.cat([part.flatten() for part in theirs]), rtol=1e-4, atol=1e-5)


def test_the_drawn_gradient_is_on_average_the_full_one() -> None:
    full, drawn = (learner("cql", sampled_actions=4, drawn_actions=d, hidden=(8,), batch_size=8) for d in (0, 2))
    with torch.no_grad():
        full.critics.layers[-1].weight.mul_(20.0)  # so that the weights of actions differ
    full.pressure.log_factor.data.fill_(0.0)
    drawn.load_state_dict(full.state_dict())
    batch = batch_of(full, 8)
    actions, densities = full.sampled(batch)
    full.sampled = drawn.sampled = lambda _: (actions, densities)
    exact = pressure_gradient(full, batch)
    many = torch.stack([pressure_gradient(drawn, batch) for _ in range(1000)])
    error = (many.mean(0) - exact).norm()
    spread = many.std(0).norm() / 1000**0.5
    assert spread < 0.05 * exact.norm()
    assert error < 2.0 * spread
    assert many.std(0).norm() > 0.05 * exact.norm()  # it does vary: the test can fail


@pytest.mark.parametrize("sampled", [1, 2])
def test_scores_are_the_critics_values(sampled: int) -> None:
    agent = learner("cql", sampled_actions=sampled, batch_size=8, layer_norm=True)
    batch = batch_of(agent, 8)
    actions, _ = agent.sampled(batch)
    expected = [agent.critics(batch.features, action) for action in actions]
    with torch.no_grad():
        torch.testing.assert_close(agent.scores(batch.features, actions), torch.stack(expected, 1), **CLOSE)


def test_places_come_up_by_their_weights() -> None:
    weights = torch.tensor([0.5, 0.0, 0.3, 0.2])[None, :, None].repeat(2, 1, 3)
    found = torch.cat([draw_places(weights, 4) for _ in range(2000)], 1)
    assert found.shape == (2, 8000, 3)
    shares = torch.stack([(found == place).float().mean(1) for place in range(4)])
    torch.testing.assert_close(shares, weights[0, :, :1, None].expand(4, 2, 3), rtol=0.0, atol=0.02)
    assert not (found == 1).any()
    assert LAYOUT.goals
