"""Gradient descent: the optimiser, what it takes back from a file, and means of metrics."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch import nn
from torchrl.objectives.common import LossModule

from bricksrl.agents.gradient_descent import GradientDescent, adam, load_optimizer, means
from bricksrl.agents.settings import Settings


def stepped(learning_rate: float = 0.01) -> tuple[torch.optim.Optimizer, dict[str, Any]]:
    """Adam of three weights after a step, and its state."""
    weights = nn.Parameter(torch.ones(3))
    frozen = nn.Parameter(torch.ones(2), requires_grad=False)
    optimizer = adam([weights, frozen], Settings(learning_rate=learning_rate), weight_decay=0.5)
    weights.grad = torch.tensor([2.0, -0.1, 0.0])
    optimizer.step()
    return optimizer, copy.deepcopy(optimizer.state_dict())


def test_adam_steps_by_the_sign_at_first_and_decays_each_weight() -> None:
    optimizer, _ = stepped()
    (group,) = optimizer.param_groups
    (weights,) = group["params"]
    assert weights.tolist() == pytest.approx([1 - 0.005 - 0.01, 1 - 0.005 + 0.01, 1 - 0.005])
    assert group["betas"] == (0.9, 0.999)
    assert adam([weights], Settings(adam_beta=0.5)).param_groups[0]["betas"] == (0.5, 0.999)
    assert adam([weights], Settings()).param_groups[0]["weight_decay"] == 0.0


@pytest.mark.parametrize(
    ("group", "moments", "refused"),
    [
        ({}, {}, None),
        ({"lr": 1}, {}, None),
        ({"lr": "fast"}, {}, TypeError),
        ({"betas": [0.9, 0.999]}, {}, TypeError),
        ({"amsgrad": 0}, {}, TypeError),
        ({}, {"exp_avg": torch.zeros(4)}, ValueError),
        ({}, {"exp_avg_sq": torch.zeros(1)}, ValueError),
        ({}, {"step": torch.ones(3)}, ValueError),
    ],
)
def test_state_of_another_optimizer_is_refused(
    group: dict[str, Any], moments: dict[str, Any], refused: type[Exception] | None
) -> None:
    _, state = stepped()
    state["param_groups"][0] |= group
    state["state"][0] |= moments
    fresh, _ = stepped()
    if refused is not None:
        with pytest.raises(refused, match=r"its (options|moments) are of other"):
            load_optimizer(fresh, state)
        return
    load_optimizer(fresh, state)
    assert fresh.state_dict()["state"][0]["exp_avg"].tolist() == pytest.approx([0.2, -0.01, 0.0])


def test_metrics_are_means_over_the_updates_that_report_them() -> None:
    updates = [{"a": torch.tensor(1.0)}, {"a": torch.tensor(3.0), "b": torch.tensor(5.0)}, {}]
    found = {name: value.item() for name, value in means(updates).items()}
    assert found == {"a": 2.0, "b": 5.0}
    assert means([]) == {}


class Half(LossModule):  # type: ignore[misc]
    """A loss whose first layer learns its weights, and whose second one is frozen."""

    out_keys = ("loss_a", "loss_actor", "told", "many")

    def __init__(self) -> None:
        super().__init__()
        self.learned = nn.Linear(3, 2)
        self.learned.bias.requires_grad_(False)
        self.frozen = nn.Linear(3, 2).requires_grad_(False)

    def forward(self, tensordict: Any) -> TensorDict:
        total = self.learned.weight.sum()
        losses = {"loss_a": total, "loss_actor": 10.0 * total, "told": total.detach()}
        return TensorDict({**losses, "many": torch.ones(3)})


class Targets:
    """Networks that follow, and how often they did."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def step(self) -> None:
        self.done.append("step")

    def init_(self) -> None:
        self.done.append("init")


def test_only_what_is_learned_starts_anew() -> None:
    loss = Half()
    before = {name: value.clone() for name, value in loss.state_dict().items()}
    optimizer = torch.optim.Adam([loss.learned.weight], lr=0.1)
    target = Targets()
    descent = GradientDescent(loss, optimizer, target, reset_every=3, target_delay=2)
    batch = TensorDict({}, [])
    torch.manual_seed(0)
    for _ in range(2):
        descent.step(batch)
    assert optimizer.state and target.done == ["step"]
    descent.step(batch)
    assert not optimizer.state and target.done == ["step", "init"]
    changed = {
        name for name, value in loss.state_dict().items() if not torch.equal(value, before[name])
    }
    assert changed == {"learned.weight"}
    weights = loss.learned.weight.detach()
    assert weights.abs().max() <= 3**-0.5, "drawn as a layer of three inputs is"
    descent.step(batch)
    assert target.done == ["step", "init", "step"], "each second update moves them"


def test_step_tells_single_numbers_and_skips_the_actor_at_first() -> None:
    loss = Half()
    optimizer = torch.optim.SGD([loss.learned.weight], lr=1.0)
    descent = GradientDescent(loss, optimizer, actor_delay=2)
    before = loss.learned.weight.detach().clone()
    told = descent.step(TensorDict({}, []))
    assert set(told) == {"loss_a", "loss_actor", "told"}
    assert not any(value.requires_grad for value in told.values())
    after = loss.learned.weight.detach().clone()
    assert torch.allclose(before - after, torch.ones(2, 3)), "without the actor's loss"
    descent.step(TensorDict({}, []))
    assert torch.allclose(after - loss.learned.weight.detach(), torch.full((2, 3), 11.0), atol=1e-5)


def test_state_of_a_descent_is_restored() -> None:
    loss = Half()
    descent = GradientDescent(loss, torch.optim.Adam([loss.learned.weight], lr=0.1))
    descent.step(TensorDict({}, []))
    other = Half()
    again = GradientDescent(other, torch.optim.Adam([other.learned.weight], lr=0.1))
    again.load_state_dict(copy.deepcopy(descent.state_dict()))
    assert again.updates == 1
    for one in (descent, again):
        one.step(TensorDict({}, []))
    assert torch.equal(loss.learned.weight, other.learned.weight)
    assert torch.equal(loss.frozen.weight, other.frozen.weight)
