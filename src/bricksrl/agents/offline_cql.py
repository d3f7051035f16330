"""Conservative Q-learning (Kumar et al. 2020): soft actor-critic that does not believe in actions which the data has not seen.

Its critics are pressed down at sampled actions and up at those of the data. TorchRL's ``CQLLoss`` is the oracle. In three
points it differs from the paper, and we do not: it takes the soft maximum over three sampled actions at a time and not over all
(with one sampled action of each kind that is the same), it values the next step's actions in the next state and not in this one,
and what is learned as the factor of the pressure multiplies nothing.

Nearly all of the work is in the values of the sampled actions, 30 for each state of the batch. They are computed a few at a time,
so that what is worked on stays near the processor, and without what a gradient needs. The gradient of a soft maximum is the mean
of the gradients under its own weights: it is taken at a few actions drawn by these weights, which has the same mean at less than
half of the cost.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.lean import gaussian
from bricksrl.agents.lean.flat import Learned
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.off_policy import Batch
from bricksrl.agents.presets import CQLSettings
from bricksrl.agents.sac import SACAgent

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

MAX_PRESSURE = 1e6
"""Limit of the learned factor of the pressure, as its authors have it."""


class CQLAgent(SACAgent):
    """CQL for one robot; see `CQLSettings`."""

    loss_names = ("critic_loss", "gap", "actor_loss", "entropy", "alpha")
    settings: CQLSettings

    def __init__(self, layout: ObservationLayout, action_size: int, settings: CQLSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.pressure = Pressure()
        self.learned_pressure = Learned(self.pressure, learning_rate=settings.learning_rate, adam_beta=settings.adam_beta)
        self.flats = *self.flats, self.learned_pressure
        sampled, rows = 3 * settings.sampled_actions, settings.batch_size
        self._chosen = settings.drawn_actions or sampled
        nets = [slice(net, net + 1) for net in range(settings.critics)]
        self._pressing = [Pass(self.critics, (1 + self._chosen) * rows, self.learned_critics, nets=one) for one in nets]
        self._at_once = 2 - sampled % 2
        self._scoring = Pass(self.critics, self._at_once * rows, self.learned_critics)

    def sampled(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Actions ``[samples, batch, m]`` to compare with those of the data, and their log-densities ``[samples, batch]``."""
        count, (rows, size) = self.settings.sampled_actions, batch.action.shape
        uniform = torch.rand(count, rows, size) * 2.0 - 1.0
        density = uniform.new_full((count, rows), -math.log(2.0) * size)
        out = self._foreseeing(2 * rows).forward(torch.cat((batch.features, batch.next_features)))[0]
        drawn = gaussian.draw(out.mT.repeat(1, count).mT, self.settings.min_scale, torch.randn(2 * count * rows, size))
        action, log_prob = drawn.action.view(count, 2, rows, size), drawn.log_prob.view(count, 2, rows)
        return torch.cat((uniform, *action.unbind(1))), torch.cat((density, *log_prob.unbind(1)))

    def scores(self, features: Tensor, actions: Tensor) -> Tensor:
        """Values ``[k, samples, batch]`` of actions ``[samples, batch, m]`` in the states ``[batch, f]``."""
        states, groups = features.repeat(self._at_once, 1), actions.view(-1, len(features) * self._at_once, actions.shape[-1])
        values = [self._scoring.forward(states, group).clone() for group in groups]
        return torch.cat(values, 1).view(self.critics.k, *actions.shape[:-1])

    def descend_critics(self, batch: Batch, next_action: Tensor, next_log_prob: Tensor) -> tuple[Tensor, ...]:
        """Gradients of the critics, and of the pressure on them; returns the sum of their squared errors, and the gap."""
        target = self.target(batch, next_action, next_log_prob)
        actions, densities = self.sampled(batch)
        scores = self.scores(batch.features, actions) - densities
        shares = scores.softmax(1)
        if self.settings.drawn_actions:
            actions = actions[draw_places(shares, self._chosen), torch.arange(len(target))]
            shares = torch.full(actions.shape[:-1], 1.0 / self._chosen)
        else:
            actions = actions.expand(len(shares), *actions.shape)
        states, weight = batch.features.repeat(1 + self._chosen, 1), self.settings.min_q_weight * self.pressure.weight()
        found = []
        for critic, chosen, share in zip(self._pressing, actions, shares, strict=True):
            values = critic.forward(states, torch.cat((batch.action, chosen.flatten(0, 1))))[0, : len(target), 0]
            errors = values - target
            slope = torch.cat((2.0 * errors - weight, (weight * share).flatten())) / len(target)
            critic.backward(slope[None, :, None])
            found.append(torch.stack((errors.square().mean(), values.mean())))
        loss, value = torch.stack(found, 1)
        gap = self.settings.min_q_weight * (scores.logsumexp(1).mean() - value.mean())
        if self.settings.lagrange_threshold is not None:
            slope = self.pressure.slope(gap, self.settings.lagrange_threshold)
            self.learned_pressure.gradient(self.pressure.log_factor).copy_(slope)
        return loss.sum(), gap

    def lead(self, batch: Batch, drawn: gaussian.Draw, of_log_prob: float) -> tuple[Tensor, Tensor]:
        """What the actor is to raise beside its entropy, in the first updates how probable the actions of the data are."""
        if self._updates > self.settings.imitation_updates:
            return super().lead(batch, drawn, of_log_prob)
        log_prob, of_outputs = drawn.imitate(batch.action)
        return log_prob, of_outputs + drawn.backward(torch.zeros_like(drawn.action), of_log_prob)

    def move_critics(self) -> None:
        """A step of the critics and of the pressure, and a smaller one of the targets after the critics."""
        super().move_critics()
        if self.settings.lagrange_threshold is not None:
            self.learned_pressure.step()

    def _parts(self) -> dict[str, Any]:
        return {**super()._parts(), "pressure": self.pressure, "adam_of_pressure": self.learned_pressure}


class Pressure(nn.Module):
    """What the pressure is multiplied with: 1, or from there learned so that the gap stays at a threshold."""

    def __init__(self) -> None:
        super().__init__()
        self.log_factor = nn.Parameter(torch.zeros(()))

    def weight(self) -> float:
        """The factor."""
        return self.log_factor.detach().exp().clamp_max(MAX_PRESSURE).item()

    def slope(self, gap: Tensor, threshold: float) -> Tensor:
        """The gradient, by the logarithm of the factor, of the factor times what the gap lacks of the threshold."""
        weight = self.weight()
        return (threshold - gap) * (weight if weight < MAX_PRESSURE else 0.0)


def draw_places(weights: Tensor, count: int) -> Tensor:
    """``count`` places ``[k, count, batch]`` along the middle of ``weights`` ``[k, samples, batch]``, which add up to 1 there.

    A place comes up as often as its weight says, on average; draws of one state are spread evenly (systematic resampling), which
    makes them vary less than independent ones.
    """
    k, samples, batch = weights.shape
    heights = weights.cumsum(1).transpose(1, 2).contiguous()
    at = (torch.arange(count) + torch.rand(k, batch, 1)) / count
    return torch.searchsorted(heights, at * heights[..., -1:]).clamp_max(samples - 1).transpose(1, 2)
