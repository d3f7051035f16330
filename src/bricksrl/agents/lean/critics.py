"""What critics are asked, and told, without autograd."""

from __future__ import annotations

import torch
from torch import Tensor

from bricksrl.agents.lean.passes import Choice, Pass


def descend(critics: Pass, inputs: Tensor, target: Tensor) -> Tensor:
    """Write the gradients of the critics' squared errors for inputs ``[rows, in]`` and a target ``[rows]``; returns their sum."""
    errors = critics.forward(inputs) - target[:, None]
    slope = errors * (2.0 / len(target))
    loss = torch.dot(errors.view(-1), slope.view(-1)) * 0.5
    critics.backward(slope)
    return loss


def climb_least(critics: Pass, inputs: Tensor) -> tuple[Tensor, Tensor]:
    """The least of the critics' values, on average, and its gradient ``[rows, in]`` by the inputs, turned to descend."""
    least, nets = critics.forward(inputs)[..., 0].min(0)
    slope = torch.full((len(inputs), 1), -1.0 / len(inputs))
    return least.mean(), critics.backward_through(Choice(nets, critics.k), slope)


def climb_mean(critics: Pass, inputs: Tensor) -> tuple[Tensor, Tensor]:
    """The same for the mean of the critics' values."""
    values = critics.forward(inputs)
    value = values.mean()
    return value, critics.backward(torch.full_like(values, -1.0 / values.numel()), weights=False, inputs=True).sum(0)
