"""Actions drawn from a tanh-squashed normal, their log-probabilities, and the way back to what the normal was made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

_ops = torch.ops.aten

NEAR_ONE = 0.999
"""Actions to imitate count as if they did not go beyond: the tanh of no finite number does."""
LEAST_SCALE = 0.01
SCALE_SHIFT = math.log(math.expm1(1.0 - LEAST_SCALE))
"""An output of 0 is a scale of 1, as in tensordict's ``NormalParamExtractor``."""
_SHIFT, _LEAST = torch.tensor(SCALE_SHIFT), torch.tensor(LEAST_SCALE)
"""The same as tensors: added in half the time."""


@dataclass(frozen=True)
class Draw:
    """Actions ``[rows, m]``, their log-probabilities ``[rows]``, and what the way back needs, each ``[rows, m]``."""

    action: Tensor
    log_prob: Tensor
    noise: Tensor
    loc: Tensor
    scale: Tensor
    raw_scale: Tensor
    min_scale: float

    def last(self, rows: int) -> Draw:
        """The last ones only."""
        action, log_prob, noise, loc, scale, raw_scale = (
            part[-rows:] for part in (self.action, self.log_prob, self.noise, self.loc, self.scale, self.raw_scale)
        )
        return Draw(action, log_prob, noise, loc, scale, raw_scale, self.min_scale)

    def backward(self, of_action: Tensor, of_log_prob: float) -> Tensor:
        """The gradient ``[rows, 2 m]`` by a network's outputs, from those by the actions and by each log-probability."""
        # the slope of log(1 - tanh(x)^2) is -2 tanh(x), and for a given noise the normal's own density knows its scale only
        of_x = torch.add(_ops.tanh_backward(of_action, self.action), self.action, alpha=2.0 * of_log_prob)
        return self._by_outputs(of_x, torch.sub(of_x * self.noise, self.scale.reciprocal(), alpha=of_log_prob))

    def imitate(self, action: Tensor) -> tuple[Tensor, Tensor]:
        """The mean log-probability of other actions ``[rows, m]``, and its gradient ``[rows, 2 m]``, turned to descend."""
        inside = action.clamp(-NEAR_ONE, NEAR_ONE)
        z = (inside.atanh() - self.loc) / self.scale
        parts = -0.5 * z.square() - self.scale.log() - torch.log1p(-inside.square())
        of_loc = z / self.scale * (-1.0 / len(action))
        of_scale = torch.addcmul(self.scale.reciprocal() * (1.0 / len(action)), of_loc, z)
        constant = 0.5 * math.log(2 * math.pi) * action.shape[-1]
        return parts.sum(-1).mean() - constant, self._by_outputs(of_loc, of_scale)

    def _by_outputs(self, of_loc: Tensor, of_scale: Tensor) -> Tensor:
        of_scale = of_scale.mul_((self.raw_scale + _SHIFT).sigmoid_())
        of_scale = _ops.threshold_backward(of_scale, self.scale, self.min_scale)
        return torch.cat((of_loc.mT, of_scale.mT)).mT


def draw(out: Tensor, min_scale: float, noise: Tensor) -> Draw:
    """What the outputs ``[rows, 2 m]`` of a network make of standard normal ``noise`` ``[rows, m]``."""
    loc, raw_scale = out.chunk(2, -1)
    noise = noise.mT.contiguous().mT  # as the outputs lie
    scale = _soft(raw_scale).clamp_min_(min_scale)
    x = torch.addcmul(loc, scale, noise)
    parts = _bend(x).addcmul_(noise, noise, value=0.125).add_(scale.log(), alpha=0.25)
    log_prob = parts.sum(-1).mul_(-4.0).sub_((0.5 * math.log(2 * math.pi) + 2.0 * math.log(2.0)) * loc.shape[-1])
    return Draw(x.tanh(), log_prob, noise, loc, scale, raw_scale, min_scale)


def log_slope(x: Tensor) -> Tensor:
    """log(1 - tanh(x)^2), written so that it stays finite where tanh saturates."""
    return 4.0 * _bend(x) + 2.0 * math.log(2.0)


def _bend(x: Tensor) -> Tensor:
    """A quarter of log((1 - tanh(x)^2) / 4): -(x + softplus(-2 x)) / 2."""
    return torch.sub(functional.softplus(x, -2.0), x, alpha=0.5)


def act(out: Tensor, min_scale: float, *, explore: bool) -> Tensor:
    """An action ``[m]`` for the outputs ``[2 m]``: drawn with ``explore``, else the mode."""
    loc, raw_scale = out.chunk(2)
    if explore:
        loc = torch.addcmul(loc, _soft(raw_scale).clamp_min_(min_scale), torch.randn_like(loc))
    return loc.tanh()


def _soft(raw_scale: Tensor) -> Tensor:
    return functional.softplus(raw_scale + _SHIFT).add_(_LEAST)
