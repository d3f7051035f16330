"""What critics are asked, and told, without autograd."""

from __future__ import annotations

import torch
from torch import Tensor

from bricksrl.agents.lean.passes import Pass


def descend(critics: Pass, features: Tensor, action: Tensor, target: Tensor) -> Tensor:
    """Write the gradients of the critics' squared errors against a target ``[rows]``; returns their sum."""
    errors = critics.forward(features, action) - target[:, None]
    slope = errors * (2.0 / len(target))
    loss = torch.dot(errors.view(-1), slope.view(-1)) * 0.5
    critics.backward(slope)
    return loss


def climb_least(critics: Pass, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """The least of the critics' values, on average, and its gradient ``[rows, sought]``, turned to descend."""
    least, nets = critics.forward(features, action)[..., 0].min(0)
    slope = torch.full((len(action), 1), -1.0 / len(action))
    return least.mean(), critics.backward_through(nets, slope)


def climb_mean(critics: Pass, features: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """The same for the mean of the critics' values."""
    values = critics.forward(features, action)
    value = values.mean()
    return value, critics.backward(torch.full_like(values, -1.0 / values.numel()), weights=False, inputs=True).sum(0)
