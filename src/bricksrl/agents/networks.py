"""Networks of the agents: observation encoder, actor, and critics that run side by side in one product of matrices."""

from __future__ import annotations

import itertools
import math
from typing import Any, Literal

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torch.nn import functional
from torchrl.data import Bounded
from torchrl.modules import ProbabilisticActor, TanhNormal

from bricksrl.agents.layout import ObservationLayout

BATCH_NORM_EPS = 1e-3
"""What the authors of CrossQ add to the variance."""


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled from their range to -1..1, unbounded ones stay as they are. With ``angles="sincos"`` each wrapping
    angle gives its sine and its cosine instead, so that 359 and 1 degrees are neighbours; with ``angles="phases"`` so does each
    difference between two of them, goals left out: a gait is how legs move against each other. With ``goals="difference"`` each
    goal gives also the way that is left to it, the shorter way around where it is an angle that wraps.
    """

    def __init__(
        self,
        layout: ObservationLayout,
        angles: Literal["phases", "sincos", "raw"],
        goals: Literal["difference", "plain"] = "plain",
    ) -> None:
        super().__init__()
        wraps = [w and angles != "raw" for w in layout.wraps]
        angle_index = [i for i, w in enumerate(wraps) if w]
        linear_index = [i for i, w in enumerate(wraps) if not w]
        low, high = torch.tensor(layout.low), torch.tensor(layout.high)
        bounded = torch.isfinite(low) & torch.isfinite(high) & (high > low)
        scale = torch.where(bounded, 2.0 / (high - low), 1.0)
        offset = torch.where(bounded, -(high + low) / (high - low), 0.0)
        pairs = layout.goals if goals == "difference" else ()
        own = [i for i in angle_index if i not in {goal for goal, _ in layout.goals}]
        phases = list(itertools.combinations(own, 2)) if angles == "phases" else []
        # a column for each angle and for each difference
        self._turn = torch.zeros(len(layout), len(angle_index) + len(phases))
        for column, i in enumerate(angle_index):
            self._turn[i, column] = math.pi / 180.0
        for column, (i, j) in enumerate(phases, len(angle_index)):
            self._turn[i, column], self._turn[j, column] = math.pi / 180.0, -math.pi / 180.0
        self._linear = torch.tensor(linear_index, dtype=torch.int64)
        self._scale, self._offset = scale[self._linear], offset[self._linear]
        self._goal, self._reached = (torch.tensor([pair[i] for pair in pairs], dtype=torch.int64) for i in range(2))
        # a way over so many degrees is shorter in the other direction
        self._around = torch.tensor([360.0 if layout.wraps[goal] else math.inf for goal, _ in pairs])
        self._way_scale = torch.tensor([1 / 180.0 if layout.wraps[goal] else float(scale[goal]) for goal, _ in pairs])
        self.size = len(linear_index) + 2 * self._turn.shape[1] + len(pairs)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: the scaled entries in their order, then all sines, all cosines, and all ways to goals."""
        parts = [torch.addcmul(self._offset, observation.index_select(-1, self._linear), self._scale)]
        if self._turn.shape[1]:
            angle_rad = observation @ self._turn
            parts += [angle_rad.sin(), angle_rad.cos()]
        if len(self._goal):
            way = observation.index_select(-1, self._goal) - observation.index_select(-1, self._reached)
            parts.append((way - (way / self._around).round() * 360.0) * self._way_scale)
        return torch.cat(parts, -1)


class Actor(nn.Module):
    """Features ``[*batch, f]`` to what ``head`` makes of a multilayer perceptron's output ``[*batch, out]``.

    Args:
        layer_norm: whether each hidden layer is normalised.
        batch_norm: momentum of batch normalisations before each layer; ``None`` for none.
    """

    def __init__(
        self,
        feature_size: int,
        out_size: int,
        hidden: tuple[int, ...],
        head: nn.Module,
        *,
        layer_norm: bool = False,
        batch_norm: float | None = None,
    ) -> None:
        super().__init__()
        self.body = StackedMLP(feature_size, hidden, out_size, k=1, layer_norm=layer_norm, batch_norm=batch_norm)
        self.head = head

    def forward(self, features: Tensor) -> Any:
        out = self.body(features.reshape(1, -1, features.shape[-1]))
        return self.head(out.view(*features.shape[:-1], out.shape[-1]))


def make_actor(
    feature_size: int, action_size: int, hidden: tuple[int, ...], min_scale: float, *, layer_norm: bool = False
) -> Actor:
    """A network from features ``[*batch, f]`` to location and scale ``[*batch, m]`` of a `TanhNormal`."""
    return Actor(feature_size, 2 * action_size, hidden, NormalParamExtractor(scale_lb=min_scale), layer_norm=layer_norm)


def make_deterministic_actor(feature_size: int, action_size: int, hidden: tuple[int, ...], *, layer_norm: bool = False) -> Actor:
    """A network from features ``[*batch, f]`` to actions ``[*batch, m]`` in -1..1."""
    return Actor(feature_size, action_size, hidden, nn.Tanh(), layer_norm=layer_norm)


def make_normalised_actor(
    feature_size: int, action_size: int, hidden: tuple[int, ...], min_scale: float, momentum: float
) -> Actor:
    """Like `make_actor`, with batch normalisation before each layer."""
    return Actor(feature_size, 2 * action_size, hidden, NormalParamExtractor(scale_lb=min_scale), batch_norm=momentum)


def make_policy(actor: nn.Module, action_size: int, in_key: str = "observation") -> ProbabilisticActor:
    """The actor as a TorchRL policy: reads ``in_key``, writes "action" in -1..1 and its log-probability."""
    return ProbabilisticActor(
        TensorDictModule(actor, in_keys=[in_key], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        spec=Bounded(-1.0, 1.0, (action_size,)),
        return_log_prob=True,
    )


def _first(stacked: Tensor, x: Tensor) -> Tensor:
    """As many of the stacked parameters as ``x`` has slices."""
    return stacked if len(stacked) == len(x) else stacked[: len(x)]


class StackedLinear(nn.Module):
    """``k`` linear layers side by side: ``[k, batch, in]`` to ``[k, batch, out]``, initialised as `torch.nn.Linear`.

    Of an input for fewer than ``k`` the first layers are used; so it is with layer normalisations too. The weights lie in memory
    along the longer side: products with a narrow matrix take a quarter of the time so.
    """

    def __init__(self, k: int, in_size: int, out_size: int) -> None:
        super().__init__()
        limit = 1.0 / math.sqrt(in_size)
        weight = torch.empty(k, out_size, in_size).mT if out_size < in_size else torch.empty(k, in_size, out_size)
        self.weight = nn.Parameter(weight.uniform_(-limit, limit))
        self.bias = nn.Parameter(torch.empty(k, 1, out_size).uniform_(-limit, limit))

    def forward(self, x: Tensor) -> Tensor:
        return torch.baddbmm(_first(self.bias, x), x, _first(self.weight, x))


class StackedLayerNorm(nn.Module):
    """``k`` layer normalisations side by side, each with its own gain and shift, on ``[k, batch, size]``."""

    def __init__(self, k: int, size: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(k, 1, size))
        self.bias = nn.Parameter(torch.zeros(k, 1, size))

    def forward(self, x: Tensor) -> Tensor:
        normal = functional.layer_norm(x, x.shape[-1:])
        return torch.addcmul(_first(self.bias, x), normal, _first(self.weight, x))


class Dropout(nn.Module):
    """Sets each entry to zero with probability ``rate`` and scales the others up, as `torch.nn.Dropout` does.

    Instead of throwing dice for each entry it draws as many places, with repetition, as miss an entry with probability
    ``1 - rate``: for small rates a tenth of the time.
    """

    def __init__(self, rate: float) -> None:
        super().__init__()
        self._draws_per_entry = -math.log1p(-rate)
        self.scale = 1.0 / (1.0 - rate)

    def places(self, count: int, k: int = 1) -> Tensor:
        """Where to drop, of ``count`` entries, ``k`` times: ``[k, places]``."""
        return torch.randint(count, (k, round(count * self._draws_per_entry)))

    def forward(self, x: Tensor) -> Tensor:
        k = len(x) if x.ndim > 2 else 1  # networks side by side
        return (x * self.scale).view(k, -1).scatter(1, self.places(x.numel() // k, k), 0.0).view(x.shape)


class StackedBatchNorm(nn.Module):
    """``k`` batch normalisations side by side, on ``[k, batch, size]``: over the batch, or as it was on average in evaluation."""

    running_mean: Tensor
    running_var: Tensor

    def __init__(self, k: int, size: int, momentum: float) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(k, 1, size))
        self.bias = nn.Parameter(torch.zeros(k, 1, size))
        self.register_buffer("running_mean", torch.zeros(k, 1, size))
        self.register_buffer("running_var", torch.ones(k, 1, size))
        self.momentum = momentum

    def forward(self, x: Tensor) -> Tensor:
        k, batch, size = x.shape
        mean, var = self.running_mean.view(-1), self.running_var.view(-1)
        columns = x.transpose(0, 1).reshape(batch, k * size)
        weight, bias = self.weight.view(-1), self.bias.view(-1)
        normal = functional.batch_norm(columns, mean, var, weight, bias, self.training, self.momentum, BATCH_NORM_EPS)
        return normal.view(batch, k, size).transpose(0, 1)


class StackedMLP(nn.Module):
    """``k`` multilayer perceptrons side by side: ``[k, batch, in]`` to ``[k, batch, out]``, ReLU between the layers.

    Args:
        batch_norm: momentum of batch normalisations before each layer; ``None`` for none.
    """

    def __init__(
        self,
        in_size: int,
        hidden: tuple[int, ...],
        out_size: int,
        *,
        layer_norm: bool = False,
        dropout: float = 0.0,
        batch_norm: float | None = None,
        k: int = 2,
    ) -> None:
        super().__init__()
        layers: list[nn.Module] = [] if batch_norm is None else [StackedBatchNorm(k, in_size, batch_norm)]
        size = in_size
        for units in hidden:
            layers.append(StackedLinear(k, size, units))
            if dropout > 0:
                layers.append(Dropout(dropout))
            if layer_norm:
                layers.append(StackedLayerNorm(k, units))
            layers.append(nn.ReLU(inplace=True))
            if batch_norm is not None:
                layers.append(StackedBatchNorm(k, units, batch_norm))
            size = units
        layers.append(StackedLinear(k, size, out_size))
        self.k = k
        self.layers = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        out: Tensor = self.layers(x)
        return out


class StackedCritics(StackedMLP):
    """``k`` independent action values: features ``[batch, f]`` and actions ``[batch, m]`` to values ``[k, batch]``."""

    def __init__(
        self,
        feature_size: int,
        action_size: int,
        hidden: tuple[int, ...],
        *,
        layer_norm: bool = False,
        dropout: float = 0.0,
        batch_norm: float | None = None,
        k: int = 2,
    ) -> None:
        size = feature_size + action_size
        super().__init__(size, hidden, 1, layer_norm=layer_norm, dropout=dropout, batch_norm=batch_norm, k=k)

    def forward(self, features: Tensor, action: Tensor, *, first: int | None = None) -> Tensor:  # type: ignore[override]
        """Values of all critics, or of the ``first`` ones."""
        x = torch.cat((features, action), -1)
        return super().forward(x.expand(first or self.k, *x.shape)).squeeze(-1)
