"""Gradient descent: the optimiser, what it takes back from a file, and means of metrics."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch
from torch import nn

from bricksrl.agents.gradient_descent import adam, load_optimizer, means
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
