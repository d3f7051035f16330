"""Features: what observations in physical units become before they enter a network, of our agents or of other libraries."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn

from bricksrl.envs.seen_inputs import SeenInputs
from bricksrl.envs.specs import ObservationLayout


class ObservationEncoder(nn.Module):
    """Observations ``[*batch, n]`` in physical units to features ``[*batch, size]`` of order one.

    Bounded entries are scaled to -1..1, unbounded ones unchanged. With ``angles="sincos"`` wrapping angles become sine and
    cosine; ``angles="phases"`` adds sine and cosine of the differences between angles, goals excluded (the phases of a gait).
    With ``goals="difference"`` each goal adds its difference to the current value, for wrapping angles the shorter way. What a
    transform has scaled comes back to its unit first. ``normalize``: linear entries by the mean and deviation of what was seen.
    """

    def __init__(
        self, layout: ObservationLayout, angles: str = "phases", goals: str = "difference", *, normalize: bool = False
    ) -> None:
        super().__init__()
        self.normalize, self.is_scaled = normalize, bool(layout.scale)
        self.unit_scale, self.unit_offset = _constant(layout.scale), _constant(layout.offset)
        self.seen = SeenInputs(layout.names, layout.wraps, [goal for goal, _ in layout.goals])
        wraps = [w and angles != "raw" for w in layout.wraps]
        angle_index = [i for i, w in enumerate(wraps) if w]
        linear_index = [i for i, w in enumerate(wraps) if not w]
        low, high = torch.tensor(layout.low), torch.tensor(layout.high)
        bounded = torch.isfinite(low) & torch.isfinite(high) & (high > low)
        scale = torch.where(bounded, 2.0 / (high - low), 1.0)
        offset = torch.where(bounded, -(high + low) / (high - low), 0.0)
        pairs = layout.goals if goals == "difference" else ()
        goal_index = {goal for goal, _ in layout.goals}
        own = [i for i in angle_index if i not in goal_index and angles == "phases"]
        first, second = torch.combinations(torch.tensor(own, dtype=torch.int64)).T
        one_rad = torch.eye(len(layout.low)) * (math.pi / 180.0)
        angle_matrix = torch.cat((one_rad[angle_index], one_rad[first] - one_rad[second])).T.contiguous()  # one column per angle
        self.angle_matrix, self.linear = _constant(angle_matrix), _constant(linear_index, torch.int64)
        self.scale, self.offset = _constant(scale[self.linear]), _constant(offset[self.linear])
        self.goal = _constant([goal for goal, _ in pairs], torch.int64)
        self.reached = _constant([reached for _, reached in pairs], torch.int64)
        self.period = _constant([360.0 if layout.wraps[goal] else math.inf for goal, _ in pairs])
        self.goal_scale = _constant([1 / 180.0 if layout.wraps[goal] else float(scale[goal]) for goal, _ in pairs])
        self.size = len(linear_index) + 2 * angle_matrix.shape[1] + len(pairs)

    def forward(self, observation: Tensor) -> Tensor:
        """Features: scaled entries, then all sines, all cosines, all goal differences."""
        observation = self.seen(self.in_units(observation))
        linear = self.seen.normalised(observation) if self.normalize else observation
        linear = linear.index_select(-1, self.linear)
        parts = [linear if self.normalize else torch.addcmul(self.offset, linear, self.scale)]
        if self.angle_matrix.shape[1]:
            angle_rad = observation @ self.angle_matrix
            parts += [angle_rad.sin(), angle_rad.cos()]
        if len(self.goal):
            difference = observation.index_select(-1, self.goal) - observation.index_select(-1, self.reached)
            parts.append((difference - (difference / self.period).round() * 360.0) * self.goal_scale)
        return torch.cat(parts, -1)

    def in_units(self, observation: Tensor) -> Tensor:
        """Observations ``[*batch, n]`` in physical units."""
        return (observation - self.unit_offset) / self.unit_scale if self.is_scaled else observation


def _constant(values: Any, dtype: torch.dtype | None = None) -> nn.Buffer:
    """A tensor that moves with its module and is not in its state."""
    return nn.Buffer(torch.as_tensor(values, dtype=dtype), persistent=False)
