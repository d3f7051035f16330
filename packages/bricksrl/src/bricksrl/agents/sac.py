"""Soft actor-critic (Haarnoja et al., 2018) with learned temperature; includes DroQ and REDQ.

DroQ: dropout and layer normalisation in the critics, 20 updates per step (Hiraoka et al., 2022).
REDQ: ten critics, targets from two random ones (Chen et al., 2021).
"""

import copy
import math
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional
from torchrl.envs import EnvBase

from bricksrl.agents.actor_critic import ActorCriticLoss, Batch, Critics, PolyakUpdate, on_base
from bricksrl.agents.features.encoder import make_encoder
from bricksrl.agents.networks import action_size, action_spec, gaussian_policy, make_body
from bricksrl.agents.replay.replay_learner import ReplayLearner, off_policy_learner
from bricksrl.agents.settings import (
    IMAGES_TARGETS,
    PAPER_TARGETS,
    CriticSettings,
    EntropySettings,
    Norm,
    OffPolicySettings,
    Positive,
    Presets,
    Range,
    ShareBelowOne,
    TargetSettings,
)
from bricksrl.errors import DescriptionError

LEAST_SCALE = 0.01
"""Added to each scale, as in tensordict's ``NormalParamExtractor``."""
SCALE_SHIFT = math.log(math.expm1(1.0 - LEAST_SCALE))
"""Added before the softplus, so that an output of 0 gives a scale of 1, as there."""


@dataclass(frozen=True)
class SACSettings(EntropySettings, CriticSettings, TargetSettings, OffPolicySettings):
    """Settings of SAC, DroQ and REDQ."""

    # as much for fewer products than 256 and 1 (`python -m benchmarks ablation`)
    batch_size: Annotated[int, Range(1)] = 128
    actor_delay: Annotated[int, Range(1)] = 2
    alpha_init: Annotated[float, Positive] = 0.1
    actor_norm: Norm = "none"
    """Normalisation in the actor, before each ReLU."""
    actor_dropout: Annotated[float, ShareBelowOne] = 0.0
    """Dropout rate in the actor."""
    dropout: Annotated[float, ShareBelowOne] = 0.0
    """Dropout rate in the critics."""
    num_qs: Annotated[int, Range(1, 64)] = 2
    """Number of critics."""
    num_min_qs: Annotated[int, Range(1, 64)] = 2
    """Number of target critics, drawn for each update; their minimum is the target."""
    actor_q: Literal["min", "mean"] = "min"
    """Value that the actor maximises: minimum or mean of the critics."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.num_min_qs > self.num_qs:
            raise DescriptionError(
                f"num_min_qs is {self.num_min_qs}; there are only {self.num_qs} critics"
            )


_IMAGES = SACSettings(**IMAGES_TARGETS, actor_delay=1)
_PAPER = SACSettings(
    **PAPER_TARGETS,
    actor_delay=1,
    alpha_init=1.0,
)
_DROQ: dict[str, Any] = {
    "dropout": 0.01,
    "updates_per_step": 20.0,
    "actor_delay": 20,
    "actor_q": "mean",
}
"""What DroQ changes, of its authors."""
_REDQ: dict[str, Any] = {**_DROQ, "critic_norm": "none", "dropout": 0.0, "num_qs": 10}
"""What REDQ changes, of its authors: many critics in place of dropout and normalisation."""
_RELEASED_DROQ: dict[str, Any] = {
    **_DROQ,
    "critic_norm": "layer",
    "actor_norm": "layer",
    "actor_dropout": 0.01,
    "actor_delay": 1,
}
"""As released with the BricksRL paper: its actor is like its critics, and learns with them."""
PRESETS = {
    "sac": Presets(
        default=SACSettings(),
        images=_IMAGES,
        paper=_PAPER,
    ),
    "droq": Presets(
        default=SACSettings(
            **_DROQ,
            batch_size=256,
            alpha_init=0.2,
        ),
        images=replace(_IMAGES, **_DROQ, alpha_init=0.2),
        paper=replace(_PAPER, **_RELEASED_DROQ),
    ),
    "redq": Presets(
        default=SACSettings(
            **_REDQ,
            batch_size=256,
            alpha_init=0.2,
        ),
        images=replace(_IMAGES, **_REDQ, alpha_init=0.2),
        paper=replace(_PAPER, **_REDQ),
    ),
}


class SACLoss(ActorCriticLoss):
    """Loss of soft actor-critic. Tests compare it with TorchRL's ``SACLoss``."""

    outputs_per_number = 2
    # as in TorchRL
    out_keys = ["loss_qvalue", "loss_actor", "loss_alpha", "alpha", "entropy"]  # noqa: RUF012

    def __init__(
        self,
        encoder: nn.Module,
        actor: nn.Module,
        critics: Critics,
        settings: Any,
    ) -> None:
        super().__init__(
            encoder,
            actor,
            critics,
            settings,
        )
        self.settings = settings
        self.target_critics = copy.deepcopy(critics).requires_grad_(False)
        self.log_alpha = nn.Parameter(torch.tensor(math.log(settings.alpha_init)))

    @property
    def alpha(self) -> Tensor:
        """The temperature, detached."""
        return self.log_alpha.detach().exp()

    @torch.no_grad()
    def target_qvalue(self, batch: Batch) -> Tensor:
        """Reward plus discounted soft value of the next state."""
        out = self.actor(batch.next_features)
        next_action, next_log_prob = self.draw(out, batch.next_base)
        next_qvalue = self.next_qvalue(batch, next_action)
        # soft: an uncertain policy is worth more by the temperature times its entropy
        next_value = next_qvalue - self.alpha * next_log_prob
        return batch.reward + batch.discount * next_value

    def next_qvalue(
        self,
        batch: Batch,
        next_action: Tensor,
    ) -> Tensor:
        """Minimum ``[batch]`` of the target critics drawn for this update."""
        count = self.settings.num_min_qs
        critics = self.target_critics
        drawn = None
        if count < len(critics):
            drawn = torch.randperm(len(critics))[:count]
        # only those that count are computed; a graph cannot depend on the drawn indices
        if drawn is not None and not torch.compiler.is_compiling():
            critics = Critics(critics[i] for i in drawn.tolist())
            drawn = None
        values: Tensor = critics(batch.next_features, next_action)  # [k, batch]
        if drawn is not None:
            values = values[drawn.to(values.device)]
        return values.amin(0)

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses of actor and temperature."""
        out = self.actor_outputs(batch.features)
        action, log_prob = self.draw(out, batch.base)
        # detached, as only the critics' loss trains the encoder
        values = self.critics(batch.features.detach(), action)
        value = values.amin(0) if self.settings.actor_q == "min" else values.mean(0)
        return {
            "loss_actor": (self.alpha * log_prob - value).mean(),
            **self.alpha_loss(log_prob, action.shape[-1]),
        }

    def alpha_loss(
        self,
        log_prob: Tensor,
        action_size: int,
    ) -> dict[str, Tensor]:
        """Loss of the temperature from log-probabilities ``[batch]``, temperature and entropy."""
        entropy = -log_prob.detach().mean()
        target = self.settings.target_entropy * action_size
        return {
            "loss_alpha": self.log_alpha * (entropy - target),
            "alpha": self.alpha,
            "entropy": entropy,
        }

    def draw(
        self,
        out: Tensor,
        base: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Action ``[*batch, m]`` and log-probability ``[*batch]`` from the actor's outputs: a
        faster ``TanhNormal``. The probability is of what is added to a base."""
        loc, scale = location_and_scale(out, self.settings.min_scale)
        noise = torch.randn(*loc.shape, dtype=out.dtype, device=out.device)
        x = torch.addcmul(loc, scale, noise)
        # log of the normal density, less log(1 - tanh(x)^2) = 2 (log 2 - x - softplus(-2 x)), which
        # stays finite for large x; divided by -2, and without what is constant: [*batch, m]
        normal = noise.square() * 0.25 + scale.log() * 0.5
        parts = normal - x - functional.softplus(-2.0 * x)
        constant_of_entry = 2.0 * math.log(2.0) + 0.5 * math.log(2.0 * math.pi)
        constant = loc.shape[-1] * constant_of_entry
        log_prob = -2.0 * parts.sum(-1) - constant
        return on_base(x.tanh(), base), log_prob


def location_and_scale(out: Tensor, min_scale: float) -> tuple[Tensor, Tensor]:
    """Location and scale ``[*batch, m]`` of the normal before the tanh, from outputs ``[*batch, 2
    m]``."""
    loc, raw_scale = out.chunk(2, -1)
    # tensordict's formula, so that the loss sees the distribution that the policy draws from
    scale = functional.softplus(raw_scale + SCALE_SHIFT) + LEAST_SCALE
    return loc, scale.clamp_min(min_scale)


def build(
    env: EnvBase,
    settings: SACSettings,
    device: torch.device | str = "cpu",
    make_loss: type[SACLoss] = SACLoss,
) -> ReplayLearner:
    """SAC, or an algorithm with another loss, for an environment. Initialized from torch's global
    generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)
    actor = make_body(
        settings,
        encoder.size,
        2 * m,
        norm=settings.actor_norm,
        dropout=settings.actor_dropout,
    )
    bodies = [
        make_body(
            settings,
            encoder.size + m,
            1,
            norm=settings.critic_norm,
            dropout=settings.dropout,
        )
        for _ in range(settings.num_qs)
    ]
    critics = Critics(bodies)
    policy = gaussian_policy(
        encoder,
        actor,
        action_spec(env),
        min_scale=settings.min_scale,
    )
    loss = make_loss(encoder, actor, critics, settings).to(device)
    target = PolyakUpdate((loss.critics, loss.target_critics), tau=settings.tau)
    return off_policy_learner(
        env,
        settings,
        policy.to(device),
        loss,
        target,
    )
