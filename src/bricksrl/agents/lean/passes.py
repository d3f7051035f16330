"""The way through a `StackedMLP` and back, by hand, in memory that is kept from one time to the next.

What comes out lies in that memory: it holds until the next time. It has the type of what went in, whatever it is computed in.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from bricksrl.agents.lean.flat import Flat, Learned
from bricksrl.agents.networks import BATCH_NORM_EPS, Dropout, StackedBatchNorm, StackedLayerNorm, StackedLinear, StackedMLP

LAYER_NORM_EPS = 1e-5
"""What `torch.nn.LayerNorm` adds to the variance."""


class Pass:
    """Forward and backward through the networks of a `StackedMLP`.

    Args:
        rows: how many samples go through at once.
        flat: where the network's parameters lie; without one the pass goes forward only, and computes in float32.
        nets: which of the networks that stand side by side.
        training: whether batch normalisations normalise by the batch, and their running statistics learn from it.
    """

    def __init__(
        self, network: StackedMLP, rows: int, flat: Flat | None = None, *, nets: slice = slice(None), training: bool = True
    ) -> None:
        self.k = len(range(network.k)[nets])
        self.rows = rows
        room = _Room(rows, self.k, nets, flat)
        self._dtype = room.dtype
        self._steps = list(_steps(network, room, training=training))

    def forward(self, x: Tensor) -> Tensor:
        """Outputs ``[k, rows, out]`` for inputs ``[rows, in]``, the same for all, or ``[k, rows, in]``."""
        out = _as(x, self._dtype).expand(self.k, *x.shape[-2:])
        for step in self._steps:
            out = step.forward(out)
        return _as(out, x.dtype)

    def backward(self, slope: Tensor, *, weights: bool = True, inputs: bool = False) -> Tensor:
        """From the gradient by the outputs of the last `forward`, which is written over, back.

        Args:
            weights: write the gradients by the parameters to where they belong.
            inputs: go on to the gradient ``[k, rows, in]`` by the inputs; else what comes out means nothing.
        """
        back = _as(slope, self._dtype)
        for place in range(len(self._steps) - 1, -1, -1):
            back = self._steps[place].backward(back, weights=weights, further=inputs or place > 0)
        return _as(back, slope.dtype)

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        """Each sample back through one network only: gradients ``[rows, in]`` by inputs from those ``[rows, out]`` by outputs.

        Not through batch normalisations that normalise by the batch, where every sample has to do with every other.
        """
        back = _as(slope.index_select(0, choice.order), self._dtype)
        for step in reversed(self._steps):
            back = step.backward_through(choice, back)
        return _as(torch.empty_like(back).index_copy_(0, choice.order, back), slope.dtype)


class Choice:
    """One of ``k`` networks for each sample, ``nets`` ``[rows]``; samples are put in the order of their networks."""

    def __init__(self, nets: Tensor, k: int) -> None:
        of_row = nets.numpy()  # short arrays: NumPy takes a tenth of torch's time
        order = of_row.argsort(kind="stable")
        self.order, self._places = torch.from_numpy(order), torch.from_numpy(of_row[order] * len(order) + order)
        ends = [0, *np.bincount(of_row, minlength=k).cumsum().tolist()]
        self.parts = [(net, slice(start, end)) for net, (start, end) in enumerate(pairwise(ends)) if end > start]
        """Which network has which of the samples so ordered."""

    def of(self, kept: Tensor) -> Tensor:
        """Of what is kept ``[k, rows, size]`` that of the chosen networks ``[rows, size]``, in order."""
        return kept.view(-1, kept.shape[-1]).index_select(0, self._places)


def _as(tensor: Tensor, dtype: torch.dtype) -> Tensor:
    return tensor if tensor.dtype is dtype else tensor.to(dtype)


class _Room:
    """Where the steps of a pass find their parameters, and take memory from."""

    def __init__(self, rows: int, k: int, nets: slice, flat: Flat | None) -> None:
        self._rows, self._k, self.nets, self._flat = rows, k, nets, flat
        self.dtype = torch.float32 if flat is None else flat.dtype

    def space(self, size: int, *, lying: bool = False) -> Tensor:
        """Memory ``[k, rows, size]``, or ``[k, size, rows]``."""
        return torch.empty(self._k, *((size, self._rows) if lying else (self._rows, size)), dtype=self.dtype)

    def working(self, parameter: nn.Parameter) -> Tensor:
        """The parameter's part for the networks of this pass."""
        return (parameter.detach() if self._flat is None else self._flat.working(parameter))[self.nets]

    def gradient(self, parameter: nn.Parameter) -> Tensor | None:
        """The same of its gradient; ``None`` for parameters that do not learn."""
        return self._flat.gradient(parameter)[self.nets] if isinstance(self._flat, Learned) else None


class _Step(Protocol):
    def forward(self, x: Tensor) -> Tensor:
        """What comes out; ``x`` may be written over."""

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        """The gradient by ``x``, if it is to go ``further``, and those by the ``weights``; ``slope`` may be written over."""

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        """The gradient by the samples of ``x``, ordered, from that by what came of them, which may be written over."""


def _steps(network: StackedMLP, room: _Room, *, training: bool) -> Iterator[_Step]:
    layers = [None, *network.layers, None]
    for before, layer, following in zip(layers, layers[1:-1], layers[2:], strict=False):
        if isinstance(layer, StackedLinear):
            scale = following.scale if isinstance(following, Dropout) else 1.0
            yield _Linear(layer, room, scale, lowest=before is None, highest=following is None)
        elif isinstance(layer, Dropout):
            yield _Drop(layer)
        elif isinstance(layer, StackedLayerNorm):
            yield _RectifiedLayerNorm(layer, room)
        elif isinstance(layer, StackedBatchNorm):
            yield _BatchNorm(layer, room, training=training)
        elif not isinstance(before, StackedLayerNorm):
            yield _ReLU()


class _Linear:
    """A product with a matrix for each network; ``scale`` is that of a dropout behind it, which costs nothing here.

    Products are turned so that what is written lies along its longer side.
    """

    def __init__(self, layer: StackedLinear, room: _Room, scale: float, *, lowest: bool, highest: bool) -> None:
        self._weight, self._bias = room.working(layer.weight), room.working(layer.bias)
        self._of_weight, self._of_bias = room.gradient(layer.weight), room.gradient(layer.bias)
        self._scale, self._highest = scale, highest
        _, in_size, out_size = self._weight.shape
        self._narrowing, self._lying = out_size < in_size, lowest and out_size > in_size
        self._out = room.space(out_size, lying=highest)
        self._out = self._out.mT if highest else self._out
        self._back = room.space(in_size, lying=self._lying)
        # views take time to make
        self._turned, self._each, self._each_turned = self._weight.mT, list(self._weight), list(self._weight.mT)
        self._of_turned = None if self._of_weight is None else self._of_weight.mT
        self._of_x = self._back.mT if self._lying else self._back
        self._x = self._x_turned = self._out

    def forward(self, x: Tensor) -> Tensor:
        if x is not self._x:
            self._x, self._x_turned = x, x.mT
        if self._highest:
            torch.baddbmm(self._bias.mT, self._turned, self._x_turned, out=self._out.mT)
            return self._out
        return torch.baddbmm(self._bias, x, self._weight, beta=self._scale, alpha=self._scale, out=self._out)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        if self._scale != 1.0:
            slope *= self._scale
        if weights and self._of_weight is not None and self._of_turned is not None and self._of_bias is not None:
            torch.sum(slope, 1, keepdim=True, out=self._of_bias)
            if self._narrowing:
                torch.bmm(slope.mT, self._x, out=self._of_turned)
            else:
                torch.bmm(self._x_turned, slope, out=self._of_weight)
        if not further:
            return slope
        if self._lying:
            torch.bmm(self._weight, slope.mT, out=self._back)
        elif slope.shape[-1] == 1:
            torch.mul(slope, self._turned, out=self._back)
        else:
            torch.bmm(slope, self._turned, out=self._back)
        return self._of_x

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        if self._scale != 1.0:
            slope *= self._scale
        back, product = self._back[0], torch.mul if slope.shape[-1] == 1 else torch.mm
        for net, part in choice.parts:
            if self._lying:
                torch.mm(self._each[net], slope[part].mT, out=back[:, part])
            else:
                product(slope[part], self._each_turned[net], out=back[part])
        return self._of_x[0]


class _ReLU:
    """Nothing below zero."""

    def forward(self, x: Tensor) -> Tensor:
        self._out = x.relu_()
        return self._out

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        return _through_relu(slope, self._out)

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        return _through_relu(slope, choice.of(self._out))


def _through_relu(slope: Tensor, out: Tensor) -> Tensor:
    """The gradient, written over, where the ReLU's output is above zero."""
    rectified: Tensor = torch.ops.aten.threshold_backward.grad_input(slope, out, 0.0, grad_input=slope)
    return rectified


class _Drop:
    """Zeros at random places; the scale of what stays is the business of the linear layer before."""

    def __init__(self, layer: Dropout) -> None:
        self._layer = layer

    def forward(self, x: Tensor) -> Tensor:
        self._shape, self._places = x.shape, self._layer.places(x.numel())
        x.view(-1).index_fill_(0, self._places, 0.0)
        return x

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        slope.view(-1).index_fill_(0, self._places, 0.0)
        return slope

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        kept = torch.ones(self._shape, dtype=slope.dtype)
        kept.view(-1).index_fill_(0, self._places, 0.0)
        return slope.mul_(choice.of(kept))


class _RectifiedLayerNorm:
    """Layer normalisation (Ba et al. 2016), for one network after the other, and the ReLU behind it."""

    def __init__(self, layer: StackedLayerNorm, room: _Room) -> None:
        self._affine = [(gain[0], shift[0]) for gain, shift in zip(*map(room.working, (layer.weight, layer.bias)), strict=True)]
        self._of_gain, self._of_shift = room.gradient(layer.weight), room.gradient(layer.bias)
        size = layer.weight.shape[-1]
        self._shape = [size]
        self._out, self._back = room.space(size), room.space(size)

    def forward(self, x: Tensor) -> Tensor:
        self._x, self._moments = x, []
        for one, out, affine in zip(x, self._out, self._affine, strict=True):
            normal, *moments = torch.native_layer_norm(one, self._shape, *affine, LAYER_NORM_EPS)
            torch.clamp_min(normal, 0.0, out=out)
            self._moments.append(moments)
        return self._out

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        slope = _through_relu(slope, self._out)
        wanted = [True, weights, weights]
        for place, (affine, moments) in enumerate(zip(self._affine, self._moments, strict=True)):
            back, of_gain, of_shift = torch.ops.aten.native_layer_norm_backward(
                slope[place], self._x[place], self._shape, *moments, *affine, wanted
            )
            self._back[place].copy_(back)
            if weights and self._of_gain is not None and self._of_shift is not None:
                self._of_gain[place].copy_(of_gain)
                self._of_shift[place].copy_(of_shift)
        return self._back

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        slope, x = _through_relu(slope, choice.of(self._out)), choice.of(self._x)
        mean, rstd = (choice.of(torch.stack(moment)) for moment in zip(*self._moments, strict=True))
        for net, part in choice.parts:
            given = slope[part], x[part], self._shape, mean[part], rstd[part], *self._affine[net], [True, False, False]
            slope[part] = torch.ops.aten.native_layer_norm_backward(*given)[0]
        return slope


class _BatchNorm:
    """Batch normalisation (Ioffe and Szegedy 2015), and its gradient as they have it."""

    def __init__(self, layer: StackedBatchNorm, room: _Room, *, training: bool) -> None:
        self._gain, self._shift = room.working(layer.weight), room.working(layer.bias)
        self._of_gain, self._of_shift = room.gradient(layer.weight), room.gradient(layer.bias)
        self._running_mean, self._running_var = layer.running_mean[room.nets], layer.running_var[room.nets]
        self._momentum, self._training = layer.momentum, training
        size = self._gain.shape[-1]
        self._centred, self._out, self._back = room.space(size), room.space(size), room.space(size)

    def forward(self, x: Tensor) -> Tensor:
        mean, var = self._running_mean, self._running_var
        if self._training:
            mean = x.mean(1, keepdim=True)
        torch.sub(x, mean, out=self._centred)
        if self._training:
            n = x.shape[1]
            var = torch.mul(self._centred, self._centred, out=self._out).mean(1, keepdim=True)
            self._running_mean.lerp_(mean.type_as(self._running_mean), self._momentum)
            self._running_var.lerp_(var.type_as(self._running_var) * (n / max(n - 1, 1)), self._momentum)
        self._scale = (var + BATCH_NORM_EPS).rsqrt_().to(x.dtype)
        return torch.addcmul(self._shift, self._centred, self._scale * self._gain, out=self._out)

    def backward(self, slope: Tensor, *, weights: bool, further: bool) -> Tensor:
        n = slope.shape[1]
        if weights or self._training:
            along = torch.mul(slope, self._centred, out=self._back).sum(1, keepdim=True).mul_(self._scale)
            total = slope.sum(1, keepdim=True)
            if weights and self._of_gain is not None and self._of_shift is not None:
                self._of_gain.copy_(along)
                self._of_shift.copy_(total)
        if not further:
            return slope
        factor = self._scale * self._gain
        if not self._training:
            return torch.mul(slope, factor, out=self._back)
        torch.addcmul(total * factor * (-1.0 / n), slope, factor, out=self._back)
        return self._back.addcmul_(self._centred, along * self._scale * factor, value=-1.0 / n)

    def backward_through(self, choice: Choice, slope: Tensor) -> Tensor:
        if self._training:
            raise RuntimeError("a sample of a batch that is normalised has no gradient of its own")
        factor = self._scale * self._gain
        for net, part in choice.parts:
            slope[part] *= factor[net]
        return slope
