"""The way through a `StackedMLP` and back, by hand, in memory that is kept from one time to the next.

One network goes all the way before the other does, so that what it works on is still near the processor. What comes out lies in
the memory kept: it holds until the next time. It has the type of what went in, whatever it is computed in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from bricksrl.agents.lean.flat import Flat, Learned
from bricksrl.agents.networks import BATCH_NORM_EPS, Dropout, StackedBatchNorm, StackedLayerNorm, StackedLinear, StackedMLP

LAYER_NORM_EPS = 1e-5
"""What `torch.nn.LayerNorm` adds to the variance."""

_ops = torch.ops.aten


class Pass:
    """Forward and backward through the networks of a `StackedMLP`.

    Args:
        rows: how many samples go through at once.
        flat: where the network's parameters lie; without one the pass goes forward only, and computes in their own type.
        nets: which of the networks that stand side by side.
        training: whether batch normalisations normalise by the batch, and their running statistics learn from it.
        sought: the inputs whose gradient is of interest.
    """

    def __init__(
        self,
        network: StackedMLP,
        rows: int,
        flat: Flat | None = None,
        *,
        nets: slice = slice(None),
        training: bool = True,
        sought: slice = slice(None),
    ) -> None:
        chosen = range(network.k)[nets]
        self.rows, self.k = rows, len(chosen)
        linear = [layer for layer in network.layers if isinstance(layer, StackedLinear)]
        dtype = linear[0].weight.dtype if flat is None else flat.dtype
        in_size, out_size = linear[0].weight.shape[1], linear[-1].weight.shape[2]
        self._inputs = torch.empty(rows, in_size, dtype=dtype)
        # both are written along their longer side
        self._out = torch.empty(self.k, out_size, rows, dtype=dtype).mT
        self._of_inputs = torch.empty(self.k, len(range(in_size)[sought]), rows, dtype=dtype).mT
        self._drops = {layer: _Places(layer, self.k) for layer in network.layers if isinstance(layer, Dropout)}
        shared: dict[nn.Module, Tensor] = {}
        rooms = [
            _Room(net, place, flat, self._inputs, self._out[place], self._of_inputs[place], sought, shared)
            for place, net in enumerate(chosen)
        ]
        self._nets = [list(_steps(network, room, self._drops, training=training)) for room in rooms]

    def forward(self, *columns: Tensor) -> Tensor:
        """Outputs ``[k, rows, out]`` for inputs ``[rows, in]``, the same for all networks, that the columns make up."""
        torch.cat(columns, -1, out=self._inputs)
        for places in self._drops.values():
            places.draw()
        for steps in self._nets:
            for step in steps:
                step.forward()
        return _as(self._out, columns[0].dtype)

    def backward(self, slope: Tensor, *, weights: bool = True, inputs: bool = False) -> Tensor:
        """From the gradient by the outputs of the last `forward` back.

        Args:
            weights: write the gradients by the parameters to where they belong.
            inputs: go on to the gradient ``[k, rows, sought]`` by the inputs; else what comes out means nothing.
        """
        for steps, back in zip(self._nets, _as(slope, self._out.dtype), strict=True):
            for place in range(len(steps) - 1, -1, -1):
                back = steps[place].backward(back, weights=weights, further=inputs or place > 0)
        return _as(self._of_inputs, slope.dtype)

    def backward_through(self, nets: Tensor, slope: Tensor) -> Tensor:
        """Each sample back through one network only, that of ``nets`` ``[rows]``: from ``[rows, out]`` to ``[rows, sought]``.

        Not through batch normalisations that normalise by the batch, where every sample has to do with every other.
        """
        found = self._of_inputs[0]
        for net, steps in enumerate(self._nets):
            rows = (nets == net).nonzero()[:, 0]
            if len(rows) == 0:
                continue
            back = _as(slope.index_select(0, rows), found.dtype)
            for step in reversed(steps):
                back = step.backward_through(rows, back)
            found.index_copy_(0, rows, back)
        return _as(found, slope.dtype)


def _as(tensor: Tensor, dtype: torch.dtype) -> Tensor:
    return tensor if tensor.dtype is dtype else tensor.to(dtype)


class _Places:
    """Where a dropout drops this time, for each of ``k`` networks."""

    def __init__(self, layer: Dropout, k: int) -> None:
        self._layer, self._k = layer, k
        self.count = 0
        self.of_net = torch.empty(k, 0, dtype=torch.int64)

    def draw(self) -> None:
        """Elsewhere than before."""
        self.of_net = self._layer.places(self.count, self._k)


@dataclass(frozen=True)
class _Room:
    """Where the steps of one network, the ``net``-th of all and in its ``place`` here, find parameters and memory."""

    net: int
    place: int
    flat: Flat | None
    inputs: Tensor
    out: Tensor
    """``[rows, out]``."""
    of_inputs: Tensor
    """``[rows, sought]``."""
    sought: slice
    shared: dict[nn.Module, Tensor]
    """Memory for gradients by what goes into a layer, which one network uses after the other."""

    def space(self, size: int) -> Tensor:
        """Memory ``[rows, size]``."""
        return torch.empty(len(self.inputs), size, dtype=self.inputs.dtype)

    def back(self, layer: nn.Module, size: int, *, lying: bool) -> Tensor:
        """The layer's shared memory ``[rows, size]``, which may lie the other way."""
        if layer not in self.shared:
            self.shared[layer] = self.space(size) if not lying else self.space(size).view(size, -1).mT
        return self.shared[layer]

    def working(self, parameter: nn.Parameter) -> Tensor:
        """The parameter's part for this network."""
        return (parameter.detach() if self.flat is None else self.flat.working(parameter))[self.net]

    def gradient(self, parameter: nn.Parameter) -> Tensor | None:
        """The same of its gradient; ``None`` for parameters that do not learn."""
        return self.flat.gradient(parameter)[self.net] if isinstance(self.flat, Learned) else None


class _Step(Protocol):
    out: Tensor

    def forward(self) -> None:
        """From what the step before put out to ``out``; may be written where that is."""

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        """The gradient by what went in, to go ``further``, and those by the ``weights``; ``slope`` may be written over."""

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        """The gradient by some ``rows`` of what went in, from that by what came of them, which may be written over."""


def _steps(network: StackedMLP, room: _Room, drops: dict[Dropout, _Places], *, training: bool) -> Iterator[_Step]:
    layers = [None, *network.layers, None]
    first = next(layer for layer in network.layers if isinstance(layer, StackedLinear))
    x = room.inputs
    step: _Step
    for before, layer, following in zip(layers, layers[1:-1], layers[2:], strict=False):
        if isinstance(layer, StackedLinear):
            scale = following.scale if isinstance(following, Dropout) else 1.0
            step = _Linear(x, layer, room, scale, first=layer is first, highest=following is None)
        elif isinstance(layer, Dropout):
            step = _Drop(x, drops[layer], room.place)
        elif isinstance(layer, StackedLayerNorm):
            step = _RectifiedLayerNorm(x, layer, room)
        elif isinstance(layer, StackedBatchNorm):
            step = _BatchNorm(x, layer, room, training=training)
        elif not isinstance(before, StackedLayerNorm):
            step = _ReLU(x)
        else:
            continue
        yield step
        x = step.out


class _Linear:
    """A product with a matrix; ``scale`` is that of a dropout behind it, which costs nothing here.

    Products are turned so that what is written lies along its longer side.
    """

    def __init__(self, x: Tensor, layer: StackedLinear, room: _Room, scale: float, *, first: bool, highest: bool) -> None:
        weight, bias = room.working(layer.weight), room.working(layer.bias)[0]
        of_weight, of_bias = room.gradient(layer.weight), room.gradient(layer.bias)
        in_size, out_size = weight.shape
        self.out = room.out if highest else room.space(out_size)
        self._scale = scale
        # views take time to make
        self._forward = (bias[:, None], weight.mT, x.mT, self.out.mT) if highest else (bias, x, weight, self.out)
        self._narrowing = out_size < in_size
        self._x, self._x_turned = x, x.mT
        self._of_bias = None if of_bias is None else of_bias[0]
        self._of_weight = of_weight if of_weight is None or not self._narrowing else of_weight.mT
        self._lowest = x is room.inputs
        self._lying = self._lowest or (first and in_size < out_size)
        self._weight = weight[room.sought] if self._lowest else weight
        self._turned = self._weight.mT
        self._back = room.of_inputs if self._lowest else room.back(layer, in_size, lying=self._lying)
        self._back_turned = self._back.mT

    def forward(self) -> None:
        bias, one, other, out = self._forward
        torch.addmm(bias, one, other, beta=self._scale, alpha=self._scale, out=out)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        scale = self._scale
        if weights and self._of_weight is not None and self._of_bias is not None:
            torch.sum(slope, 0, out=self._of_bias)
            if scale != 1.0:
                self._of_bias *= scale
            factors = (slope.mT, self._x) if self._narrowing else (self._x_turned, slope)
            torch.addmm(self._of_weight, *factors, beta=0.0, alpha=scale, out=self._of_weight)
        if not further:
            return slope
        if self._lying:
            torch.addmm(self._back_turned, self._weight, slope.mT, beta=0.0, alpha=scale, out=self._back_turned)
        elif slope.shape[1] == 1:
            torch.mul(slope, self._turned, out=self._back)
        else:
            torch.addmm(self._back, slope, self._turned, beta=0.0, alpha=scale, out=self._back)
        return self._back

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        back = slope * self._turned if slope.shape[1] == 1 else slope @ self._turned
        return back if self._scale == 1.0 else back.mul_(self._scale)


class _ReLU:
    """Nothing below zero."""

    def __init__(self, x: Tensor) -> None:
        self.out = x

    def forward(self) -> None:
        self.out.relu_()

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        return _through_relu(slope, self.out)

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        return _through_relu(slope, self.out.index_select(0, rows))


def _through_relu(slope: Tensor, out: Tensor) -> Tensor:
    """The gradient, written over, where the ReLU's output is above zero."""
    rectified: Tensor = _ops.threshold_backward.grad_input(slope, out, 0.0, grad_input=slope)
    return rectified


class _Drop:
    """Zeros at random places; the scale of what stays is the business of the linear layer before."""

    def __init__(self, x: Tensor, places: _Places, place: int) -> None:
        self.out, self._flat, self._places, self._place = x, x.view(-1), places, place
        places.count = x.numel()

    def forward(self) -> None:
        self._flat.index_fill_(0, self._places.of_net[self._place], 0.0)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        slope.view(-1).index_fill_(0, self._places.of_net[self._place], 0.0)
        return slope

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        kept = torch.ones_like(self.out)
        kept.view(-1).index_fill_(0, self._places.of_net[self._place], 0.0)
        return slope.mul_(kept.index_select(0, rows))


class _RectifiedLayerNorm:
    """Layer normalisation (Ba et al. 2016), and the ReLU behind it."""

    def __init__(self, x: Tensor, layer: StackedLayerNorm, room: _Room) -> None:
        self._gain, self._shift = room.working(layer.weight)[0], room.working(layer.bias)[0]
        self._of_gain, self._of_shift = room.gradient(layer.weight), room.gradient(layer.bias)
        self._x, self._shape = x, [x.shape[1]]
        self._mean = self._rstd = self.out = room.space(x.shape[1])

    def forward(self) -> None:
        normal, self._mean, self._rstd = torch.native_layer_norm(self._x, self._shape, self._gain, self._shift, LAYER_NORM_EPS)
        torch.clamp_min(normal, 0.0, out=self.out)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        given = self._x, self._shape, self._mean, self._rstd, self._gain, self._shift, [True, weights, weights]
        back: Tensor
        back, of_gain, of_shift = _ops.native_layer_norm_backward(_through_relu(slope, self.out), *given)
        if weights and self._of_gain is not None and self._of_shift is not None:
            self._of_gain.copy_(of_gain)
            self._of_shift.copy_(of_shift)
        return back

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        slope = _through_relu(slope, self.out.index_select(0, rows))
        x, mean, rstd = (kept.index_select(0, rows) for kept in (self._x, self._mean, self._rstd))
        given = slope, x, self._shape, mean, rstd, self._gain, self._shift, [True, False, False]
        back: Tensor = _ops.native_layer_norm_backward(*given)[0]
        return back


class _BatchNorm:
    """Batch normalisation (Ioffe and Szegedy 2015)."""

    def __init__(self, x: Tensor, layer: StackedBatchNorm, room: _Room, *, training: bool) -> None:
        # in the type of the parameters, whatever else is computed in
        parts = layer.weight, layer.bias, layer.running_mean, layer.running_var
        self._gain, self._shift, self._running_mean, self._running_var = (part.detach()[room.net, 0] for part in parts)
        self._of_gain, self._of_shift = room.gradient(layer.weight), room.gradient(layer.bias)
        self._momentum, self._training = layer.momentum, training
        self._x, self._of_inputs = x, room.of_inputs if x is room.inputs else None
        self._sought, self.out = room.sought, room.space(x.shape[1])
        self._mean, self._rstd = (torch.empty(x.shape[1] if training else 0, dtype=self._gain.dtype) for _ in range(2))

    def forward(self) -> None:
        moments = self._running_mean, self._running_var, self._training, self._momentum, BATCH_NORM_EPS
        into = self.out, self._mean, self._rstd
        torch.native_batch_norm(self._x, self._gain, self._shift, *moments, out=into)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        back, of_gain, of_shift = self._back(slope, self._x, [further, weights, weights])
        if weights and self._of_gain is not None and self._of_shift is not None:
            self._of_gain.copy_(of_gain)
            self._of_shift.copy_(of_shift)
        if further and self._of_inputs is not None:
            self._of_inputs.copy_(back[:, self._sought])
        return back

    def backward_through(self, rows: Tensor, slope: Tensor) -> Tensor:
        if self._training:
            raise RuntimeError("a sample of a batch that is normalised has no gradient of its own")
        back = self._back(slope, slope, [True, False, False])[0]
        return back if self._of_inputs is None else back[:, self._sought]

    def _back(self, slope: Tensor, x: Tensor, wanted: list[bool]) -> tuple[Tensor, Tensor, Tensor]:
        moments = self._running_mean, self._running_var, self._mean, self._rstd, self._training, BATCH_NORM_EPS
        found: tuple[Tensor, Tensor, Tensor] = _ops.native_batch_norm_backward(slope, x, self._gain, *moments, wanted)
        return found
