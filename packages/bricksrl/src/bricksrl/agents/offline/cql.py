"""Conservative Q-learning (Kumar et al., 2020): SAC with lower values for actions outside of the
data.

Tests compare it with TorchRL's ``CQLLoss``, which differs from the paper, and from this loss, in
three points: its soft maximum is over three sampled actions at a time, not over all (equal for one
sampled action of each kind); it evaluates the next step's actions in the next state, not in the
current one; its learned factor has no effect.

Most time goes into the values of the sampled actions, 30 per state. They are computed in small
groups that fit the cache, without gradient. The gradient of a soft maximum is the mean of gradients
under its weights: a few actions drawn with these weights give an unbiased estimate at less than
half of the cost.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor, nn
from torchrl.envs import EnvBase

from bricksrl.agents import sac
from bricksrl.agents.actor_critic import Batch, Critics
from bricksrl.agents.anchor import CountedUpdates
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.agents.sac import SACLoss, SACSettings, location_and_scale
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    NotNegative,
    Positive,
    Presets,
    Range,
)

MAX_FACTOR = 1e6
"""Maximum learned factor; source: the authors' code."""
ROWS_AT_ONCE = 512
"""Rows per pass through the critics that fit the cache."""
NEAR_ONE = 0.999
"""Limit of actions in log-probabilities: tanh of a finite number is never 1."""


@dataclass(frozen=True)
class CQLSettings(SACSettings):
    """Settings of CQL."""

    batch_size: Annotated[int, Range(1)] = 256
    actor_delay: Annotated[int, Range(1)] = 1
    alpha_init: Annotated[float, Positive] = 0.2
    min_q_weight: Annotated[float, NotNegative] = 1.0
    """Weight of the penalty on values of sampled actions; a threshold adds a learned factor."""
    lagrange_threshold: Annotated[float | None, Range(-1e6, 1e6)] = None
    """Target gap between values of sampled actions and of the data, for a learned factor; none for
    a fixed weight."""
    sampled_actions: Annotated[int, Range(1, 100)] = 10
    """Sampled actions of each kind: uniform, of the policy, of the policy at the next step."""
    drawn_actions: Annotated[int, Range(0, 300)] = 1
    """Sampled actions with a gradient, drawn by their weight; 0 for all."""
    imitation_updates: Annotated[int, NotNegative] = 0
    """Initial updates in which the actor imitates the data."""


PRESETS = {
    "cql": Presets(
        default=CQLSettings(),
        images=CQLSettings(**IMAGES_TARGETS, alpha_init=0.1),
        paper=CQLSettings(
            **PAPER_TARGETS,
            alpha_init=1.0,
            lagrange_threshold=5.0,
            imitation_updates=1000,
        ),
    )
}


class CQLLoss(CountedUpdates, SACLoss):
    """Loss of conservative Q-learning."""

    def __init__(
        self,
        encoder: nn.Module,
        actor: nn.Module,
        critics: Critics,
        settings: CQLSettings,
    ) -> None:
        super().__init__(
            encoder,
            actor,
            critics,
            settings,
        )
        is_learned = settings.lagrange_threshold is not None
        lagrange = ["loss_lagrange"] if is_learned else []
        self.out_keys = ["loss_qvalue", "loss_cql", *lagrange, "gap", *self.out_keys[1:]]
        self.log_factor = nn.Parameter(torch.zeros(()), requires_grad=is_learned)

    @torch.no_grad()
    def sample_actions(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Sampled actions ``[samples, batch, m]`` and their log-densities ``[samples, batch]``."""
        count = self.settings.sampled_actions
        (rows, size) = batch.action.shape
        uniform = (
            torch.rand(
                count,
                rows,
                size,
                device=batch.action.device,
            )
            * 2.0
            - 1.0
        )
        # each entry is uniform over a range of length 2: its density is 1/2
        density = uniform.new_full((count, rows), -math.log(2.0) * size)
        out = self.actor(torch.cat((batch.features, batch.next_features)))
        base = None
        if batch.base is not None and batch.next_base is not None:
            base = torch.cat((batch.base, batch.next_base))
        action, log_density = self.draw(out.expand(count, *out.shape), base)
        # of this state and of the next: [count, 2, batch, m] and [count, 2, batch]
        of_states = action.view(count, 2, rows, size).unbind(1)
        densities_of_states = log_density.view(count, 2, rows).unbind(1)
        actions = torch.cat((uniform, *of_states))
        return actions, torch.cat((density, *densities_of_states))

    @torch.no_grad()
    def scores(
        self,
        features: Tensor,
        actions: Tensor,
    ) -> Tensor:
        """Values ``[k, samples, batch]`` of actions ``[samples, batch, m]`` in states ``[batch,
        f]``."""
        at_once = max(1, ROWS_AT_ONCE // len(features))
        values = []
        for group in actions.split(at_once):
            states = features.expand(len(group), *features.shape).flatten(0, 1)
            flat_values = self.critics(states, group.flatten(0, 1))  # [k, samples * batch]
            values.append(flat_values.view(-1, *group.shape[:2]))
        return torch.cat(values, 1)

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Squared errors of the critics, the conservative penalty, and the loss of its factor."""
        target = self.target_qvalue(batch)
        actions, densities = self.sample_actions(batch)
        # Less the density of how an action was drawn: the importance weight of CQL(H), appendix F.
        scores = self.scores(batch.features, actions) - densities
        shares = scores.softmax(1)  # [k, samples, batch]
        drawn = None
        if self.settings.drawn_actions:
            drawn = draw_indices(shares, self.settings.drawn_actions)
        each_row = torch.arange(len(target), device=target.device)
        values = []
        sampled_values = []
        for i, critic in enumerate(self.critics):
            chosen = actions
            weights: Tensor | float = shares[i]
            if drawn is not None:
                # they were drawn by their weights, so that their plain mean is unbiased
                chosen = actions[drawn[i], each_row]
                weights = 1.0 / len(chosen)
            # the data's action goes first, through the same pass as the sampled ones
            compared = torch.cat((batch.action[None], chosen))
            states = batch.features.expand(1 + len(chosen), *batch.features.shape)
            predicted = critic(torch.cat((states, compared), -1)).squeeze(-1)
            values.append(predicted[0])
            sampled_values.append((predicted[1:] * weights).sum(0).mean())
        value = torch.stack(values)  # [k, batch]
        weight = self.settings.min_q_weight
        # The gap is a number to compare with the threshold; the penalty has the gradient.
        gap = weight * (scores.logsumexp(1).mean() - value.detach().mean())
        penalty = weight * (torch.stack(sampled_values) - value.mean(-1)).sum()
        factor = self.log_factor.exp().clamp_max(MAX_FACTOR)
        losses = {
            "loss_qvalue": self.errors(value, target),
            "loss_cql": factor.detach() * penalty,
            "gap": gap,
        }
        if self.settings.lagrange_threshold is not None:
            losses["loss_lagrange"] = factor * (self.settings.lagrange_threshold - gap)
        return losses

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses of actor and temperature; the first updates imitate the data instead."""
        self.updates_made += 1
        if self.updates_made > self.settings.imitation_updates:
            return super().actor_loss(batch)
        out = self.actor_outputs(batch.features)
        _, log_density = self.draw(out)
        action = batch.action if batch.base is None else batch.action - batch.base
        imitation = log_prob(out, self.settings.min_scale, action).mean()
        return {
            "loss_actor": self.alpha * log_density.mean() - imitation,
            **self.alpha_loss(log_density, batch.action.shape[-1]),
        }


def draw_indices(weights: Tensor, count: int) -> Tensor:
    """Indices ``[k, count, batch]`` drawn with weights ``[k, samples, batch]``, which sum to 1 over
    samples. Systematic resampling: unbiased, with less variance than independent draws."""
    k, samples, batch = weights.shape
    cumulative = weights.cumsum(1).transpose(1, 2).contiguous()
    # one random shift for all of a row's points, which are 1 / count apart: [k, batch, count]
    shift = torch.rand(
        k,
        batch,
        1,
        device=weights.device,
    )
    points = (torch.arange(count, device=weights.device) + shift) / count
    # rounded sums end a little beside 1, and a point may lie beyond the last of them
    total = cumulative[..., -1:]
    indices = torch.searchsorted(cumulative, points * total).clamp_max(samples - 1)
    return indices.transpose(1, 2)


def log_prob(
    out: Tensor,
    min_scale: float,
    action: Tensor,
) -> Tensor:
    """Log-probability ``[*batch]`` of actions ``[*batch, m]`` in -1..1, from the actor's
    outputs."""
    loc, scale = location_and_scale(out, min_scale)
    inside = action.clamp(-NEAR_ONE, NEAR_ONE)
    z = (inside.atanh() - loc) / scale
    parts = -0.5 * z.square() - scale.log() - torch.log1p(-inside.square())
    return parts.sum(-1) - 0.5 * math.log(2.0 * math.pi) * action.shape[-1]


def build(
    env: EnvBase,
    settings: CQLSettings,
    device: torch.device | str = "cpu",
) -> ReplayLearner:
    """CQL for an environment. Initialized from torch's global generator."""
    return sac.build(env, settings, device, CQLLoss)
