"""Conservative Q-learning (Kumar et al., 2020): SAC whose critics are pressed down where the data has no actions.

TorchRL's ``CQLLoss`` is the oracle. In three points it differs from the paper, and we do not: it takes the soft maximum over
three sampled actions at a time and not over all (with one sampled action of each kind that is the same), it values the next
step's actions in the next state and not in this one, and what is learned as the factor of the pressure multiplies nothing.

Nearly all of the work is in the values of the sampled actions, 30 for each state of the batch. They are computed a few at a time,
so that what is worked on stays in the cache, and without gradient. The gradient of a soft maximum is the mean of the gradients
under its own weights: it is taken at a few actions drawn by these weights, which has the same mean at less than half of the cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase

from bricksrl.agents import sac
from bricksrl.agents.actor_critic import Batch, Critics, squared_errors
from bricksrl.agents.learner import Learner
from bricksrl.agents.sac import SACLoss, SACSettings, location_and_scale
from bricksrl.agents.settings import NotNegative, Positive, Range

MAX_FACTOR = 1e6
"""Limit of the learned factor of the pressure, as its authors have it."""
ROWS_AT_ONCE = 512
"""Rows of a pass through the critics that stay in the cache of a processor."""
NEAR_ONE = 0.999
"""Limit of actions whose log-probability is taken: the tanh of no finite number is 1."""


@dataclass(frozen=True)
class CQLSettings(SACSettings):
    """Settings of CQL."""

    learning_rate: Annotated[float, Positive] = 1e-3
    alpha_init: Annotated[float, Positive] = 0.2
    min_q_weight: Annotated[float, NotNegative] = 1.0
    """Weight of the pressure on the values of sampled actions; with a threshold it is multiplied by a learned factor too."""
    lagrange_threshold: Annotated[float | None, Range(-1e6, 1e6)] = None
    """Gap between the values of sampled actions and those of the data that the factor is learned for; none for a fixed one."""
    sampled_actions: Annotated[int, Range(1, 100)] = 10
    """Actions that are compared with the data's: so many uniform ones, of the policy here, and of the policy a step later."""
    drawn_actions: Annotated[int, Range(0, 300)] = 1
    """Of these, those at which the gradient is taken, drawn as the full gradient weighs them; 0 for the full gradient."""
    imitation_updates: Annotated[int, NotNegative] = 0
    """Updates at the start in which the actor imitates the data."""


class CQLLoss(SACLoss):
    """Loss of conservative Q-learning."""

    def __init__(self, encoder: nn.Module, actor: nn.Module, critics: Critics, settings: CQLSettings) -> None:
        super().__init__(encoder, actor, critics, settings)
        self.out_keys = ["loss_qvalue", "loss_cql", "loss_lagrange", "gap", *self.out_keys[1:]]
        is_learned = settings.lagrange_threshold is not None
        if not is_learned:
            self.out_keys.remove("loss_lagrange")
        self.log_factor = nn.Parameter(torch.zeros(()), requires_grad=is_learned)
        self._made = 0

    @torch.no_grad()
    def sample_actions(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Actions ``[samples, batch, m]`` to compare with those of the data, and their log-densities ``[samples, batch]``."""
        count, (rows, size) = self.settings.sampled_actions, batch.action.shape
        uniform = torch.rand(count, rows, size, device=batch.action.device) * 2.0 - 1.0
        density = uniform.new_full((count, rows), -math.log(2.0) * size)
        out = self.actor(torch.cat((batch.features, batch.next_features)))
        action, log_density = self.draw(out.expand(count, *out.shape))
        actions, densities = action.view(count, 2, rows, size), log_density.view(count, 2, rows)
        return torch.cat((uniform, *actions.unbind(1))), torch.cat((density, *densities.unbind(1)))

    @torch.no_grad()
    def scores(self, features: Tensor, actions: Tensor) -> Tensor:
        """Values ``[k, samples, batch]`` of actions ``[samples, batch, m]`` in the states ``[batch, f]``."""
        at_once = max(1, ROWS_AT_ONCE // len(features))
        values = []
        for some in actions.split(at_once):
            states = features.expand(len(some), *features.shape).flatten(0, 1)
            values.append(self.critics(states, some.flatten(0, 1)).view(-1, *some.shape[:2]))
        return torch.cat(values, 1)

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The critics' squared errors, the pressure on them, and what its factor is learned from."""
        target = self.target_qvalue(batch)
        actions, densities = self.sample_actions(batch)
        scores = self.scores(batch.features, actions) - densities
        shares = scores.softmax(1)
        values, pressed = [], []
        places = draw_places(shares, self.settings.drawn_actions) if self.settings.drawn_actions else None
        for number, critic in enumerate(self.critics):
            chosen = actions if places is None else actions[places[number], torch.arange(len(target), device=target.device)]
            weights = shares[number] if places is None else 1.0 / len(chosen)
            states = batch.features.expand(1 + len(chosen), *batch.features.shape)
            found = critic(torch.cat((states, torch.cat((batch.action[None], chosen))), -1)).squeeze(-1)
            values.append(found[0])
            pressed.append((found[1:] * weights).sum(0).mean())
        value = torch.stack(values)
        gap = self.settings.min_q_weight * (scores.logsumexp(1).mean() - value.detach().mean())
        pressure = self.settings.min_q_weight * (torch.stack(pressed) - value.mean(-1)).sum()
        factor = self.log_factor.exp().clamp_max(MAX_FACTOR)
        found_losses = {"loss_qvalue": squared_errors(value, target), "loss_cql": factor.detach() * pressure, "gap": gap}
        if self.settings.lagrange_threshold is not None:
            found_losses["loss_lagrange"] = factor * (self.settings.lagrange_threshold - gap)
        return found_losses

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses of actor and temperature; in the first updates the actor imitates the data in place of ascending the critics."""
        self._made += 1
        if self._made > self.settings.imitation_updates:
            return super().actor_loss(batch)
        out = self.actor_outputs(batch.features)
        _, log_density = self.draw(out)
        imitation = log_prob(out, self.settings.min_scale, batch.action).mean()
        return {
            "loss_actor": self.alpha * log_density.mean() - imitation,
            **self.alpha_loss(log_density, batch.action.shape[-1]),
        }

    def get_extra_state(self) -> dict[str, int]:
        """The updates of the actor so far."""
        return {"made": self._made}

    def set_extra_state(self, state: dict[str, int]) -> None:
        """Inverse of `get_extra_state`."""
        self._made = int(state["made"])


def draw_places(weights: Tensor, count: int) -> Tensor:
    """``count`` places ``[k, count, batch]`` along the middle of ``weights`` ``[k, samples, batch]``, which add up to 1 there.

    A place comes up as often as its weight says, on average; draws of one state are spread evenly (systematic resampling), which
    makes them vary less than independent ones.
    """
    k, samples, batch = weights.shape
    heights = weights.cumsum(1).transpose(1, 2).contiguous()
    at = (torch.arange(count, device=weights.device) + torch.rand(k, batch, 1, device=weights.device)) / count
    return torch.searchsorted(heights, at * heights[..., -1:]).clamp_max(samples - 1).transpose(1, 2)


def log_prob(out: Tensor, min_scale: float, action: Tensor) -> Tensor:
    """Log-probability ``[*batch]`` of actions ``[*batch, m]`` in -1..1, from the actor's outputs."""
    loc, scale = location_and_scale(out, min_scale)
    inside = action.clamp(-NEAR_ONE, NEAR_ONE)
    z = (inside.atanh() - loc) / scale
    parts = -0.5 * z.square() - scale.log() - torch.log1p(-inside.square())
    return parts.sum(-1) - 0.5 * math.log(2.0 * math.pi) * action.shape[-1]


def build(env: EnvBase, settings: CQLSettings, device: torch.device | str = "cpu") -> Learner:
    """CQL for an environment; networks are drawn from torch's global generator."""
    return sac.build(env, settings, device, CQLLoss)
