"""Parameters of networks in one piece of memory, so that a step of Adam or of a target network is one call."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from bricksrl.errors import DescriptionError

ADAM_BETA2, ADAM_EPS = 0.999, 1e-8
"""What `torch.optim.Adam` has by default."""


def working_type(precision: str) -> torch.dtype:
    """The type that networks compute in, for the name of a precision: for float32 that of new parameters.

    Raises:
        DescriptionError: this processor computes in that type only by way of another, slower than in float32.
    """
    if precision == "float32":
        return torch.get_default_dtype()
    able = torch.cpu.get_capabilities()
    if not any(able.get(name) for name in ("avx512_bf16", "amx_bf16", "bf16")):
        raise DescriptionError("this processor has no arithmetic in bfloat16, it would be slower with it; take precision float32")
    return torch.bfloat16


class Flat:
    """Moves the parameters of modules into one vector, of which they are views from then on.

    Where the working type ``dtype`` is another than theirs, there is a second vector of that type, which networks compute with.
    """

    def __init__(self, *modules: nn.Module, dtype: torch.dtype | None = None) -> None:
        parameters = [parameter for module in modules for parameter in module.parameters()]
        self.values = torch.cat([_along_memory(parameter.detach()).flatten() for parameter in parameters])
        self._working = self.values.to(dtype)  # the same one where the type is
        ends = torch.tensor([parameter.numel() for parameter in parameters]).cumsum(0).tolist()
        self._places = {p: (end - p.numel(), end) for p, end in zip(parameters, ends, strict=True)}
        for parameter in parameters:
            parameter.data = self._view(self.values, parameter)

    @property
    def dtype(self) -> torch.dtype:
        """The working type."""
        return self._working.dtype

    def working(self, parameter: nn.Parameter) -> Tensor:
        """What to compute with in place of the parameter."""
        return self._view(self._working, parameter)

    def refresh(self) -> None:
        """Bring what is computed with to the parameters, after they were changed."""
        if self._working is not self.values:
            self._working.copy_(self.values)

    def follow(self, other: Flat, share: float) -> None:
        """Move that share of the way to the other's values."""
        self.values.lerp_(other.values, share)
        self.refresh()

    def _view(self, vector: Tensor, parameter: nn.Parameter) -> Tensor:
        start, end = self._places[parameter]
        along = _along_memory(parameter)
        view = vector[start:end].view(along.shape)
        return view if along is parameter else view.mT


def _along_memory(tensor: Tensor) -> Tensor:
    """The tensor itself, or transposed if that is how it lies in memory."""
    return tensor.mT if tensor.ndim > 1 and tensor.stride(-1) > tensor.stride(-2) else tensor


class Learned(Flat):
    """Parameters that learn: their gradients lie in one vector too, and Adam takes steps down them."""

    def __init__(
        self, *modules: nn.Module, learning_rate: float, adam_beta: float = 0.9, dtype: torch.dtype | None = None
    ) -> None:
        super().__init__(*modules, dtype=dtype)
        self._learning_rate, self._beta = learning_rate, adam_beta
        self._slope, self._mean, self._square = (torch.zeros_like(self.values) for _ in range(3))
        self._working_slope = self._slope.to(dtype)
        self._steps = torch.zeros(())

    def gradient(self, parameter: nn.Parameter) -> Tensor:
        """Where the parameter's gradient is to be written."""
        return self._view(self._working_slope, parameter)

    def step(self) -> None:
        """One step of Adam (Kingma and Ba 2015) down the gradients."""
        if self._working_slope is not self._slope:
            self._slope.copy_(self._working_slope)
        self._steps += 1
        torch._fused_adam_(
            [self.values],
            [self._slope],
            [self._mean],
            [self._square],
            [],
            [self._steps],
            lr=self._learning_rate,
            beta1=self._beta,
            beta2=ADAM_BETA2,
            weight_decay=0.0,
            eps=ADAM_EPS,
            amsgrad=False,
            maximize=False,
        )
        self.refresh()

    def state_dict(self) -> dict[str, Any]:
        """Adam's memory; the parameters are in the modules' own."""
        return {"mean": self._mean, "square": self._square, "steps": self._steps}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave, after the modules have taken over theirs."""
        for mine, its in ((self._mean, state["mean"]), (self._square, state["square"]), (self._steps, state["steps"])):
            if mine.shape != its.shape:
                raise ValueError(f"Adam has {mine.numel()} numbers here and {its.numel()} there")
            mine.copy_(its)
        self.refresh()
