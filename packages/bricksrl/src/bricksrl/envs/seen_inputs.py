"""Inputs: what the first layer of a network has learned on. An agent that acts holds what it observes within that range, so that
an input that never varied where it learned decides nothing where it acts."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

_log = logging.getLogger(__name__)
LARGEST = torch.finfo(torch.float32).max


class SeenInputs(nn.Module):
    """Least, greatest, mean and deviation of each input ``[n]`` that was learned on, in the module's state; where it lacks them,
    nothing was seen. Angles (``wraps``) are held only if they never varied, ``free`` inputs never."""

    least: Tensor
    greatest: Tensor
    moments: Tensor

    def __init__(self, names: Sequence[str], wraps: Sequence[bool], free: Sequence[int]) -> None:
        super().__init__()
        n = len(wraps)
        self.names, self.warned = names, set[str]()
        self.register_buffer("least", torch.full((n,), LARGEST))
        self.register_buffer("greatest", torch.full((n,), -LARGEST))
        self.register_buffer("moments", torch.zeros(3, n, dtype=torch.float64))  # count, mean, sum of squared deviations
        is_free = torch.zeros(n, dtype=torch.bool)
        is_free[list(free)] = True
        self.wraps, self.free = nn.Buffer(torch.tensor(wraps), persistent=False), nn.Buffer(is_free, persistent=False)

    @torch.no_grad()
    def see(self, inputs: Tensor) -> None:
        """Add inputs ``[*batch, n]`` that are learned on."""
        rows = inputs.reshape(-1, inputs.shape[-1])
        torch.minimum(self.least, rows.amin(0), out=self.least)
        torch.maximum(self.greatest, rows.amax(0), out=self.greatest)
        count, mean, squares = self.moments
        added, values = len(rows), rows.double()
        difference, total = values.mean(0) - mean, count + added
        squares += (values - values.mean(0)).square().sum(0) + difference.square() * count * added / total
        mean += difference * added / total
        count += added

    def forward(self, inputs: Tensor) -> Tensor:
        """Inputs ``[*batch, n]``, of an agent that acts at its best within what it has learned on."""
        if self.training or exploration_type() is not ExplorationType.DETERMINISTIC:
            return inputs
        least, greatest = self.bounds()
        if not torch.compiler.is_exporting():
            self._say(inputs, least, greatest)
        return inputs.clamp(least, greatest)

    def bounds(self) -> tuple[Tensor, Tensor]:
        """Least and greatest value ``[n]`` within which each input is held."""
        is_held = (self.least <= self.greatest) & ~self.free & (~self.wraps | (self.least == self.greatest))
        return torch.where(is_held, self.least, -LARGEST), torch.where(is_held, self.greatest, LARGEST)

    def _say(self, inputs: Tensor, least: Tensor, greatest: Tensor) -> None:
        """Say once of each input that it is farther outside of what was seen than that is wide."""
        span = greatest - least
        rows = inputs.reshape(-1, len(least))
        for row, index in ((rows < least - span) | (rows > greatest + span)).nonzero().tolist():
            name = self.names[index] if self.names else f"input {index}"
            if name not in self.warned:
                self.warned.add(name)
                low, high, value = float(least[index]), float(greatest[index]), float(rows[row, index])
                learned = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                _log.warning("%s reads %g, but the agent learned with %s: it acts as if it read that", name, value, learned)

    def normalised(self, inputs: Tensor) -> Tensor:
        """Inputs less their mean, divided by their deviation; 0 where they never varied."""
        count, mean, squares = self.moments
        deviation = (squares / count.clamp_min(1.0)).sqrt()
        scale = torch.where(deviation > 1e-6, 1.0 / deviation.clamp_min(1e-6), 0.0)
        normalised: Tensor = (inputs - mean) * scale
        return normalised.to(inputs.dtype)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        for name, buffer in self.named_buffers():
            if name in ("least", "greatest", "moments"):
                state_dict.setdefault(prefix + name, buffer)
        super()._load_from_state_dict(state_dict, prefix, *args)
