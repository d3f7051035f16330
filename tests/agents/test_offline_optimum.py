"""Offline agents on a task whose best and whose behaviour's values are known: bring a point on a line to its middle.

A point at ``x`` in -1..1 moves by 0.3 a step at most; the reward is minus the square of where it gets. The data was made by a
policy that goes the right way too timidly and with much noise. Values are computed by dynamic programming on a fine grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from bricksrl.agents import make_agent, preset
from bricksrl.agents.agent import Transitions
from bricksrl.agents.layout import ObservationLayout
from bricksrl.training.reproducible import reproducible

GAMMA, REACH, GAIN, NOISE = 0.8, 0.3, 0.5, 0.6
GRID = torch.linspace(-1.0, 1.0, 401)
STARTS = torch.linspace(-1.0, 1.0, 41)
QUANTILES = torch.distributions.Normal(0.0, 1.0).icdf((torch.arange(200) + 0.5) / 200)
LAYOUT = ObservationLayout((-1.0,), (1.0,), (False,))
SMALL = {"hidden": (32, 32), "batch_size": 128, "gamma": GAMMA, "learning_rate": 3e-3, "tau": 0.1, "sampled_actions": 4}


def move(x: Tensor, action: Tensor) -> Tensor:
    return (x + REACH * action).clamp(-1.0, 1.0)


def behaviour(x: Tensor, noise: Tensor) -> Tensor:
    return (NOISE * noise - GAIN * x).clamp(-1.0, 1.0)


def value_at(values: Tensor, x: Tensor) -> Tensor:
    """Values on the grid, linearly interpolated."""
    place = (x + 1.0) * 200.0
    low = place.floor().clamp(0, 399).long()
    share = place - low
    return values[low] * (1.0 - share) + values[low + 1] * share


def solve(actions: Tensor, reduce: Callable[[Tensor], Tensor]) -> Tensor:
    """Values ``[401]`` of choosing among ``actions`` ``[choices, 401]`` as ``reduce`` says."""
    after = move(GRID, actions)
    values = torch.zeros(401)
    for _ in range(100):
        values = reduce(-after.square() + GAMMA * value_at(values, after))
    return values


BEST = solve(torch.linspace(-1.0, 1.0, 201)[:, None].expand(-1, 401), lambda choices: choices.amax(0))
OF_BEHAVIOUR = solve(behaviour(GRID, QUANTILES[:, None]), lambda choices: choices.mean(0))


def made_data(count: int = 4000) -> Transitions:
    x = torch.rand(count) * 2.0 - 1.0
    action = behaviour(x, torch.randn(count))
    after = move(x, action)
    never = torch.zeros(count, dtype=torch.bool)
    return Transitions(x[:, None], action[:, None], -after.square(), after[:, None], never, ~never)


def regret(agent: Any) -> float:
    """How much less than the best the agent gets, from all starts."""
    x, total = STARTS, torch.zeros(41)
    for step in range(40):
        x = move(x, torch.cat([agent.act(one[None], explore=False) for one in x]))
        total -= GAMMA**step * x.square()
    return float((value_at(BEST, STARTS) - total).mean())


def learned(name: str, updates: int = 500, **changes: Any) -> Any:
    wanted = {**SMALL, **changes}
    usual = preset("default", name)
    agent: Any = make_agent(name, LAYOUT, 1, replace(usual, **{key: wanted[key] for key in wanted if hasattr(usual, key)}))
    agent.study(made_data())
    agent.update(updates)
    return agent


@pytest.fixture(scope="module")
def imitated() -> float:
    """The regret of imitation."""
    with reproducible(4):
        return regret(learned("bc", dropout=0.0))


def test_the_task_leaves_room_to_improve(imitated: float) -> None:
    class Middle:
        def act(self, observation: Tensor, *, explore: bool) -> Tensor:
            return (-observation / REACH).clamp(-1.0, 1.0)

    assert regret(Middle()) == pytest.approx(0.0, abs=2e-3)
    assert float((BEST - OF_BEHAVIOUR).mean()) > 0.2
    assert imitated > 0.1


def test_bc_finds_the_mean_of_the_behaviour() -> None:
    agent = learned("bc", dropout=0.0)
    mean = behaviour(STARTS, QUANTILES[:, None]).mean(0)
    torch.testing.assert_close(agent.act(STARTS[:, None], explore=False)[:, 0], mean, rtol=0.0, atol=0.12)


def test_iql_with_the_middle_expectile_finds_the_values_of_the_behaviour() -> None:
    agent = learned("iql", expectile=0.5)
    with torch.no_grad():
        found = agent.value_of(agent.encoder(STARTS[:, None]))
    best, usual = value_at(BEST, STARTS), value_at(OF_BEHAVIOUR, STARTS)
    assert (found - usual).abs().mean() < 0.12  # of values down to -1.7
    assert (found - best).mean() < -0.2


def test_iql_with_a_high_expectile_approaches_the_best_values() -> None:
    agent = learned("iql", expectile=0.95)
    with torch.no_grad():
        found = agent.value_of(agent.encoder(STARTS[:, None]))
    best, usual = value_at(BEST, STARTS), value_at(OF_BEHAVIOUR, STARTS)
    assert (best - found).abs().mean() < 0.4 * (best - usual).mean()


@pytest.mark.parametrize(
    ("agent", "share", "changes"), [("iql", 0.7, {"temperature": 10.0}), ("cql", 0.3, {}), ("td3bc", 0.5, {})]
)
def test_offline_agents_improve_on_the_data(imitated: float, agent: str, share: float, changes: dict[str, Any]) -> None:
    assert regret(learned(agent, **changes)) < share * imitated


def test_cql_believes_less_than_is_true_where_the_data_is_not() -> None:
    """Values of actions that the data never has are pressed down below those of the data, and below what they are worth."""
    agent, bold = learned("cql", 250, min_q_weight=2.0), learned("sac", 250)
    x = torch.full((1, 1), 0.9)
    features, away = agent.encoder(x), torch.ones(1, 1)  # to the right, where the behaviour hardly ever goes
    after = move(x[:, 0], away[:, 0])
    true = -after.square() + GAMMA * value_at(BEST, after)
    with torch.no_grad():
        careful, believed = (made.critics(features, away).amin() for made in (agent, bold))
    assert careful < true - 0.1
    assert careful < believed - 0.1
