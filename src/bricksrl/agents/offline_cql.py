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
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.lean.passes import Pass
from bricksrl.agents.learner import step
from bricksrl.agents.networks import StackedCritics, make_actor
from bricksrl.agents.off_policy import Batch, OffPolicyAgent
from bricksrl.agents.presets import CQLSettings
from bricksrl.agents.soft import Temperature, sample_action

if TYPE_CHECKING:
    from bricksrl.envs.task import Task

MAX_PRESSURE = 1e6
"""Limit of the learned factor of the pressure, as its authors have it."""
NEAR_ONE = 0.999
"""Actions of the data are imitated as if they did not go beyond: the tanh of no finite number does."""


class CQLAgent(OffPolicyAgent):
    """CQL for one robot; see `CQLSettings`."""

    loss_names = ("critic_loss", "gap", "actor_loss", "entropy", "alpha")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: CQLSettings, task: Task | None = None) -> None:
        super().__init__(layout, action_size, settings, task)
        self.settings = settings
        size, hidden = self.encoder.size, settings.hidden
        self.actor = make_actor(size, action_size, hidden, settings.min_scale)
        self.critics, self.target_critics = (
            StackedCritics(size, action_size, hidden, layer_norm=settings.layer_norm) for _ in range(2)
        )
        self.target_critics.load_state_dict(self.critics.state_dict())
        self.target_critics.requires_grad_(False)
        self.temperature = Temperature(settings.initial_alpha, settings.entropy * action_size)
        self.pressure = Pressure()
        self._at_once = 2 - 3 * settings.sampled_actions % 2
        self._scoring = Pass(self.critics, self._at_once * settings.batch_size)
        self._critic_parameters: list[Tensor] = list(self.critics.parameters())
        self._target_parameters: list[Tensor] = list(self.target_critics.parameters())
        self._actor_parameters: list[Tensor] = list(self.actor.parameters())
        alone = [self.temperature.log_alpha, self.pressure.log_factor]
        betas = (settings.adam_beta, 0.999)
        parameters = [*self._critic_parameters, *self._actor_parameters, *alone]
        self._optimiser = torch.optim.Adam(parameters, lr=settings.learning_rate, betas=betas, fused=True)

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """A drawn action ``[m]`` with ``explore``, else the mode of the policy."""
        with torch.no_grad():
            loc, scale = self.actor(self.encoder(observation))
            x = torch.addcmul(loc, scale, torch.randn_like(loc)) if explore else loc
            return x.tanh()

    def target(self, batch: Batch) -> Tensor:
        """What the critics are to say ``[batch]``."""
        with torch.no_grad():
            next_action, next_log_prob = sample_action(*self.actor(batch.next_features))
            next_value = self.target_critics(batch.next_features, next_action).amin(0)
            next_value -= self.temperature.alpha() * next_log_prob
            return batch.reward + self.settings.gamma * torch.where(batch.terminated, 0.0, next_value)

    def sampled(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Actions ``[samples, batch, m]`` to compare with those of the data, and their log-densities ``[samples, batch]``."""
        count = self.settings.sampled_actions
        with torch.no_grad():
            uniform = torch.rand(count, *batch.action.shape) * 2.0 - 1.0
            density = uniform.new_full(uniform.shape[:-1], -math.log(2.0) * batch.action.shape[-1])
            loc, scale = self.actor(torch.stack((batch.features, batch.next_features)))
            action, log_prob = sample_action(*(part.expand(count, *part.shape) for part in (loc, scale)))
            return torch.cat((uniform, *action.unbind(1))), torch.cat((density, *log_prob.unbind(1)))

    def critic_loss(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """The critics' loss, the pressure on them (not yet multiplied with its factor), and the gap, a constant."""
        target = self.target(batch)
        actions, densities = self.sampled(batch)
        k, drawn, n = self.critics.k, self.settings.drawn_actions, len(target)
        inputs = torch.cat((batch.features, batch.action), -1).expand(k, 1, n, -1)
        if drawn:
            scores = self.scores(batch.features, actions) - densities
            soft_maximum = scores.logsumexp(1)
            actions = actions[draw_places(scores.softmax(1), drawn), torch.arange(n)]
        chosen = torch.cat((batch.features.expand(*actions.shape[:-1], -1), actions), -1)
        both = self._values(torch.cat((inputs, chosen.expand(k, -1, n, -1)), 1))
        values, others = both[:, 0], both[:, 1:]
        pressed = others.mean(1) if drawn else (others - densities).logsumexp(1)
        if not drawn:
            soft_maximum = pressed.detach()
        loss = (values - target).square().mean(-1).sum()
        gap = (soft_maximum - values.detach()).mean()
        return loss, self.settings.min_q_weight * (pressed - values).mean(-1).sum(), self.settings.min_q_weight * gap

    @torch.no_grad()
    def scores(self, features: Tensor, actions: Tensor) -> Tensor:
        """Values ``[k, samples, batch]`` of actions ``[samples, batch, m]`` in the states ``[batch, f]``, as constants."""
        states, groups = features.repeat(self._at_once, 1), actions.view(-1, len(features) * self._at_once, actions.shape[-1])
        values = [self._scoring.forward(states, group).clone() for group in groups]
        return torch.cat(values, 1).view(self.critics.k, *actions.shape[:-1])

    def _values(self, inputs: Tensor) -> Tensor:
        """Values ``[k, samples, batch]`` of features and actions ``[k, samples, batch, f + m]``, for each critic its own."""
        values: Tensor = self.critics.layers(inputs.flatten(1, 2))
        return values.view(inputs.shape[:-1])

    def actor_loss(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Loss of the actor, and its entropy, a constant."""
        loc, scale = self.actor(batch.features)
        action, log_prob = sample_action(loc, scale)
        if self._updates <= self.settings.imitation_updates:
            climbed = log_prob_of(batch.action, loc, scale)
        else:
            climbed = self.critics(batch.features, action).amin(0)
        return (self.temperature.alpha() * log_prob - climbed).mean(), -log_prob.detach().mean()

    def learn(self, batch: Batch, *, actor: bool) -> tuple[Tensor, ...]:
        """One update; the numbers are those of `loss_names`, without ``actor`` the first two."""
        critic, pressure, gap = self.critic_loss(batch)
        descended: list[tuple[Tensor, list[Tensor]]] = [(critic + self.pressure.factor() * pressure, self._critic_parameters)]
        numbers: tuple[Tensor, ...] = (critic, gap)
        if self.settings.lagrange_threshold is not None:
            descended.append((self.pressure.loss(gap, self.settings.lagrange_threshold), [self.pressure.log_factor]))
        if actor:
            loss, entropy = self.actor_loss(batch)
            descended.append((loss, self._actor_parameters))
            descended.append((self.temperature.loss(entropy), [self.temperature.log_alpha]))
            numbers = (*numbers, loss, entropy, self.temperature.alpha())
        step(self._optimiser, *descended)
        with torch.no_grad():
            torch._foreach_lerp_(self._target_parameters, self._critic_parameters, self.settings.tau)
        return tuple(number.detach() for number in numbers)

    def _parts(self) -> dict[str, nn.Module | torch.optim.Optimizer]:
        return {
            "actor": self.actor,
            "critics": self.critics,
            "target_critics": self.target_critics,
            "temperature": self.temperature,
            "pressure": self.pressure,
            "optimiser": self._optimiser,
        }


class Pressure(nn.Module):
    """What the pressure is multiplied with: 1, or from there learned so that the gap stays at a threshold."""

    def __init__(self) -> None:
        super().__init__()
        self.log_factor = nn.Parameter(torch.zeros(()))

    def factor(self) -> Tensor:
        """The factor, as a constant."""
        return self.log_factor.detach().exp().clamp_max(MAX_PRESSURE)

    def loss(self, gap: Tensor, threshold: float) -> Tensor:
        """What to descend for a gap, a constant."""
        return self.log_factor.exp().clamp_max(MAX_PRESSURE) * (threshold - gap)


def draw_places(weights: Tensor, count: int) -> Tensor:
    """``count`` places ``[k, count, batch]`` along the middle of ``weights`` ``[k, samples, batch]``, which add up to 1 there.

    A place comes up as often as its weight says, on average; draws of one state are spread evenly (systematic resampling), which
    makes them vary less than independent ones.
    """
    k, samples, batch = weights.shape
    heights = weights.cumsum(1).transpose(1, 2).contiguous()
    at = (torch.arange(count) + torch.rand(k, batch, 1)) / count
    return torch.searchsorted(heights, at * heights[..., -1:]).clamp_max(samples - 1).transpose(1, 2)


def log_prob_of(action: Tensor, loc: Tensor, scale: Tensor) -> Tensor:
    """Log-probability ``[*batch]`` of given actions ``[*batch, m]`` under a tanh-squashed normal."""
    inside = action.clamp(-NEAR_ONE, NEAR_ONE)
    z = (inside.atanh() - loc) / scale
    log_slope = torch.log1p(-inside.square())
    return (-0.5 * z.square() - scale.log() - 0.5 * math.log(2 * math.pi) - log_slope).sum(-1)
