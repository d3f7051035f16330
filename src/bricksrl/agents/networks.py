"""Networks of the agents: observation encoder, actor, and critics that run side by side in one product of matrices."""

from __future__ import annotations

import math
from typing import Literal

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torch.nn import functional
from torchrl.data import Bounded
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal

from bricksrl.agents.layout import ObservationLayout


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled from their range to -1..1, unbounded ones stay as they are. With ``angles="sincos"`` each wrapping
    angle gives its sine and its cosine instead, so that 359 and 1 degrees are neighbours.
    """

    def __init__(self, layout: ObservationLayout, angles: Literal["sincos", "raw"]) -> None:
        super().__init__()
        wraps = [w and angles == "sincos" for w in layout.wraps]
        self.angle_index = [i for i, w in enumerate(wraps) if w]
        self.linear_index = [i for i, w in enumerate(wraps) if not w]
        self.size = len(self.linear_index) + 2 * len(self.angle_index)
        low = torch.tensor(layout.low)[self.linear_index]
        high = torch.tensor(layout.high)[self.linear_index]
        bounded = torch.isfinite(low) & torch.isfinite(high) & (high > low)
        self.scale = torch.where(bounded, 2.0 / (high - low), 1.0)
        self.offset = torch.where(bounded, -(high + low) / (high - low), 0.0)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: the scaled entries in their order, then all sines, then all cosines."""
        scaled = torch.addcmul(self.offset, observation[..., self.linear_index], self.scale)
        if not self.angle_index:
            return scaled
        angle_rad = torch.deg2rad(observation[..., self.angle_index])
        return torch.cat((scaled, angle_rad.sin(), angle_rad.cos()), -1)


def make_actor(feature_size: int, action_size: int, hidden: tuple[int, ...], min_scale: float) -> nn.Sequential:
    """A network from features ``[*batch, f]`` to location and scale ``[*batch, m]`` of a `TanhNormal`."""
    mlp = MLP(feature_size, 2 * action_size, num_cells=list(hidden), activation_class=nn.ReLU)
    return nn.Sequential(mlp, NormalParamExtractor(scale_lb=min_scale))


def make_policy(actor: nn.Sequential, action_size: int, in_key: str = "observation") -> ProbabilisticActor:
    """The actor as a TorchRL policy: reads ``in_key``, writes "action" in -1..1 and its log-probability."""
    return ProbabilisticActor(
        TensorDictModule(actor, in_keys=[in_key], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        spec=Bounded(-1.0, 1.0, (action_size,)),
        return_log_prob=True,
    )


class StackedLinear(nn.Module):
    """``k`` linear layers side by side: ``[k, batch, in]`` to ``[k, batch, out]``, initialised as `torch.nn.Linear`."""

    def __init__(self, k: int, in_size: int, out_size: int) -> None:
        super().__init__()
        limit = 1.0 / math.sqrt(in_size)
        self.weight = nn.Parameter(torch.empty(k, in_size, out_size).uniform_(-limit, limit))
        self.bias = nn.Parameter(torch.empty(k, 1, out_size).uniform_(-limit, limit))

    def forward(self, x: Tensor) -> Tensor:
        return torch.baddbmm(self.bias, x, self.weight)


class StackedLayerNorm(nn.Module):
    """``k`` layer normalisations side by side, each with its own gain and shift, on ``[k, batch, size]``."""

    def __init__(self, k: int, size: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(k, 1, size))
        self.bias = nn.Parameter(torch.zeros(k, 1, size))

    def forward(self, x: Tensor) -> Tensor:
        normal = functional.layer_norm(x, x.shape[-1:])
        return torch.addcmul(self.bias, normal, self.weight)


class StackedCritics(nn.Module):
    """``k`` independent action values: features ``[batch, f]`` and actions ``[batch, m]`` to values ``[k, batch]``."""

    def __init__(
        self, feature_size: int, action_size: int, hidden: tuple[int, ...], *, layer_norm: bool, dropout: float, k: int = 2
    ) -> None:
        super().__init__()
        self.k = k
        layers: list[nn.Module] = []
        size = feature_size + action_size
        for units in hidden:
            layers.append(StackedLinear(k, size, units))
            if dropout > 0:
                layers.append(nn.Dropout(dropout))
            if layer_norm:
                layers.append(StackedLayerNorm(k, units))
            layers.append(nn.ReLU())
            size = units
        layers.append(StackedLinear(k, size, 1))
        self.layers = nn.Sequential(*layers)

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        x = torch.cat((features, action), -1)
        values: Tensor = self.layers(x.expand(self.k, *x.shape))
        return values.squeeze(-1)
