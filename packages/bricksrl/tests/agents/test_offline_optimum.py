"""Offline agents on a task with known values: move a point on a line to its middle.

A point at ``x`` in -1..1 moves by at most 0.3 a step; the reward is minus the square of the new
position. The data is from a noisy, too timid policy. Values are computed by dynamic programming on
a fine grid.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from bricksrl.agents import make_learner, preset
from bricksrl.agents.learner import Learner
from bricksrl.agents.replay.buffer import TransitionReplayBuffer

GAMMA, REACH, GAIN, NOISE = 0.8, 0.3, 0.5, 0.6
GRID = torch.linspace(-1.0, 1.0, 401)
STARTS = torch.linspace(-1.0, 1.0, 41)
QUANTILES = torch.distributions.Normal(0.0, 1.0).icdf((torch.arange(200) + 0.5) / 200)
SMALL = {
    "hidden": (32, 32),
    "batch_size": 128,
    "gamma": GAMMA,
    "learning_rate": 3e-3,
    "tau": 0.1,
    "sampled_actions": 4,
}
QUICK = {"hidden": (32,), "learning_rate": 1e-2}


class Line(EnvBase):
    """Specs of the task."""

    def __init__(self) -> None:
        super().__init__(batch_size=())
        self.observation_spec = Composite(observation=Bounded(-1.0, 1.0, (1,)))
        self.action_spec = Bounded(-1.0, 1.0, (1,))
        self.reward_spec = Unbounded((1,))

    def _reset(self, tensordict: Any = None, **_: Any) -> Any: ...
    def _step(self, tensordict: Any) -> Any: ...
    def _set_seed(self, seed: int | None) -> None: ...


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
    """Values ``[401]`` of ``actions`` ``[choices, 401]`` reduced by ``reduce``."""
    after = move(GRID, actions)
    values = torch.zeros(401)
    for _ in range(100):
        values = reduce(-after.square() + GAMMA * value_at(values, after))
    return values


BEST = solve(
    torch.linspace(-1.0, 1.0, 201)[:, None].expand(-1, 401), lambda choices: choices.amax(0)
)
OF_BEHAVIOUR = solve(behaviour(GRID, QUANTILES[:, None]), lambda choices: choices.mean(0))


def made_data(batch_size: int, count: int = 4000) -> TransitionReplayBuffer:
    x = torch.rand(count) * 2.0 - 1.0
    action = behaviour(x, torch.randn(count))
    after = move(x, action)[:, None]
    never = torch.zeros(count, 1, dtype=torch.bool)
    rows = {"observation": after, "reward": -after.square(), "terminated": never, "done": ~never}
    memory = TransitionReplayBuffer(count, batch_size, ("observation",))
    frames = {
        "observation": x[:, None],
        "action": action[:, None],
        "next": TensorDict(rows, [count]),
    }
    memory.extend(TensorDict(frames, [count]))
    return memory


def acted(learner: Any, x: Tensor) -> Tensor:
    action: Tensor = learner.exploit(TensorDict({"observation": x[:, None]}, [len(x)]))["action"][
        :, 0
    ]
    return action


def regret(learner: Any) -> float:
    """Mean difference to the best return over all starts."""
    x, total = STARTS, torch.zeros(41)
    for step in range(25):
        x = move(x, acted(learner, x))
        total -= GAMMA**step * x.square()
    return float((value_at(BEST, STARTS) - total).mean())


def learned(name: str, updates: int = 500, **changes: Any) -> Learner:
    wanted = {**SMALL, **changes}
    usual = preset("default", name)
    learner = make_learner(
        name, Line(), replace(usual, **{key: wanted[key] for key in wanted if hasattr(usual, key)})
    )
    learner.dataset = made_data(SMALL["batch_size"])
    learner.make_updates(updates)
    return learner


def values_of(learner: Learner, x: Tensor) -> Tensor:
    """IQL's values of states."""
    loss: Any = learner.loss
    with torch.no_grad(), loss.value_network_params.to_module(loss.value_network):
        found: Tensor = loss.value_network(TensorDict({"observation": x[:, None]}, [len(x)]))[
            "state_value"
        ][:, 0]
    return found


@pytest.fixture(scope="module")
def imitator() -> Learner:
    """A learner by imitation."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(4)
        return learned("bc", 200, hidden=(32,), dropout=0.0)


@pytest.fixture(scope="module")
def imitated(imitator: Learner) -> float:
    """Regret of imitation."""
    return regret(imitator)


def test_data_policy_is_not_optimal(imitated: float) -> None:
    class Middle:
        def exploit(self, state: TensorDict) -> TensorDict:
            return state.set("action", (-state["observation"] / REACH).clamp(-1.0, 1.0))

    assert regret(Middle()) == pytest.approx(0.0, abs=2e-3)
    assert float((BEST - OF_BEHAVIOUR).mean()) > 0.2
    assert imitated > 0.1


def test_bc_finds_mean_behaviour(imitator: Learner) -> None:
    mean = behaviour(STARTS, QUANTILES[:, None]).mean(0)
    torch.testing.assert_close(acted(imitator, STARTS), mean, rtol=0.0, atol=0.12)


@functools.cache
def bold_iql() -> Learner:
    return learned("iql", 150, **QUICK, expectile=0.95, temperature=10.0)


@pytest.mark.slow
def test_iql_with_middle_expectile_finds_behaviour_values() -> None:
    agent = learned("iql", 400, expectile=0.5)
    found = values_of(agent, STARTS)
    best, usual = value_at(BEST, STARTS), value_at(OF_BEHAVIOUR, STARTS)
    assert (found - usual).abs().mean() < 0.12  # of values down to -1.7
    assert (found - best).mean() < -0.2


def test_iql_with_high_expectile_approaches_best_values() -> None:
    agent = bold_iql()
    found = values_of(agent, STARTS)
    best, usual = value_at(BEST, STARTS), value_at(OF_BEHAVIOUR, STARTS)
    assert (best - found).abs().mean() < 0.4 * (best - usual).mean()


@pytest.mark.parametrize(("agent", "share"), [("iql", 0.7), ("cql", 0.3), ("td3bc", 0.5)])
def test_offline_agents_improve_on_the_data(imitated: float, agent: str, share: float) -> None:
    learner = bold_iql() if agent == "iql" else learned(agent, 150, **QUICK)
    assert regret(learner) < share * imitated


def test_cql_underestimates_outside_of_data() -> None:
    """Values of actions outside of the data are below their true values, and below what SAC
    believes. The means of many starts, and a weight whose effect is many times the luck of a
    training."""
    careful_one, bold = learned("cql", 250, min_q_weight=10.0), learned("sac", 250)
    x = torch.linspace(0.6, 1.0, 21)[:, None]
    away = torch.ones(21, 1)  # to the right, where the behaviour hardly ever goes
    after = move(x[:, 0], away[:, 0])
    true = (-after.square() + GAMMA * value_at(BEST, after)).mean()
    with torch.no_grad():
        losses: list[Any] = [careful_one.loss, bold.loss]
        careful, believed = (loss.critics(loss.encoder(x), away).amin(0).mean() for loss in losses)
    assert careful < true - 0.1
    assert careful < believed - 0.1
