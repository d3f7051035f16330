"""Soft actor-critic (Haarnoja et al., 2018) with learned temperature; includes DroQ and REDQ.

DroQ: dropout and layer normalisation in the critics, 20 updates per step (Hiraoka et al., 2022).
REDQ: ten critics, targets from two random ones (Chen et al., 2021). TD3, CrossQ and CQL share
`ActorCriticLoss`.
"""

import copy
import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torch.nn import functional
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.envs import EnvBase
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import hold_out_net

from bricksrl.agents.encoder import encode, encoder_keys, make_encoder
from bricksrl.agents.learner import Learner, off_policy_learner
from bricksrl.agents.networks import action_size, action_spec, gaussian_policy, make_body
from bricksrl.agents.settings import (
    CriticSettings,
    Norm,
    OffPolicySettings,
    Positive,
    Range,
    ShareBelowOne,
)
from bricksrl.errors import DescriptionError

LEAST_SCALE = 0.01
SCALE_SHIFT = math.log(math.expm1(1.0 - LEAST_SCALE))
"""An output of 0 gives a scale of 1, as in tensordict's ``NormalParamExtractor``."""


@dataclass(frozen=True)
class EntropySettings(OffPolicySettings):
    """Settings of maximum-entropy policies."""

    alpha_init: Annotated[float, Positive] = 0.2
    """Initial temperature (weight of the entropy); it is learned."""
    target_entropy: Annotated[float, Range(-1e6, 1e6)] = -1.0
    """Target entropy per action entry; uniform actions have 0.69."""
    min_scale: Annotated[float, Positive] = 0.1
    """Lower limit of the standard deviation of an action before the tanh."""


@dataclass(frozen=True)
class SACSettings(EntropySettings, CriticSettings):
    """Settings of SAC, DroQ and REDQ."""

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


class Critics(nn.ModuleList):
    """``k`` independent critics: features ``[batch, f]`` and actions ``[batch, m]`` to values ``[k,
    batch]``."""

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        x = torch.cat((features, action), -1)
        return torch.stack([body(x).squeeze(-1) for body in self])


@dataclass(frozen=True)
class Batch:
    """Encoded transitions: ``features``, ``next_features`` ``[batch, f]``, ``action`` ``[batch,
    m]``, others ``[batch]``."""

    features: Tensor
    action: Tensor
    reward: Tensor
    next_features: Tensor
    discount: Tensor
    """Weight of the next state's value: 0 after termination, else gamma to the number of steps."""
    base: Tensor | None = None
    next_base: Tensor | None = None
    """Actions ``[batch, m]`` of a base, if there is one, which the actor's are added to."""


class ActorCriticLoss(LossModule):  # type: ignore[misc]
    """Loss of an actor (features to the policy's outputs) and critics on the features ``[batch,
    f]`` of a shared encoder.

    It has TorchRL's keys (TorchRL's losses are the oracles in tests), a `qvalue_loss`, and an
    `actor_loss`, which not every update computes. Features are encoded once; only the critics' loss
    trains the encoder.
    """

    def __init__(
        self, encoder: nn.Module, actor: nn.Module, critics: Critics, settings: OffPolicySettings
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.actor = actor
        self.critics = critics
        self.gamma = settings.gamma
        self.anchor: nn.Module | None = None  # of a policy that was taught
        self.base: nn.Module | None = None
        is_smooth = isinstance(settings, CriticSettings) and settings.critic_loss == "smooth-l1"
        self.errors = smooth_errors if is_smooth else squared_errors
        keys = encoder_keys(encoder)
        self.in_keys = [
            *keys,
            "action",
            *(("next", key) for key in (*keys, "reward", "terminated")),
        ]

    @abstractmethod
    def target_qvalue(self, batch: Batch) -> Tensor:
        """Target of the critics ``[batch]``, without gradient."""

    @abstractmethod
    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses ("loss_actor" and others) and metrics; without gradient for the critics."""

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Errors summed over the critics, other losses and metrics."""
        target = self.target_qvalue(batch)
        return {"loss_qvalue": self.errors(self.critics(batch.features, batch.action), target)}

    def encode(self, tensordict: TensorDictBase) -> Batch:
        """Encode a batch from a replay buffer."""
        features = encode(self.encoder, tensordict)
        after = tensordict["next"]
        with torch.no_grad():
            next_features = encode(self.encoder, after)
        steps = tensordict.get("steps_to_next_obs", None)
        gamma = self.gamma if steps is None else self.gamma ** steps.squeeze(-1)
        discount = gamma * (~after["terminated"].squeeze(-1)).to(features.dtype)
        batch = Batch(
            features, tensordict["action"], after["reward"].squeeze(-1), next_features, discount
        )
        return (
            batch
            if self.base is None
            else replace(batch, base=self.base(tensordict), next_base=self.base(after))
        )

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """All losses of a batch, and detached metrics; scalars."""
        batch = self.encode(tensordict)
        losses = self.qvalue_loss(batch)
        with hold_out_net(self.critics):
            losses |= self.actor_loss(batch)
        return TensorDict(losses)

    def critic_losses(self, tensordict: TensorDictBase) -> TensorDict:
        """The losses of an update without the actor."""
        return TensorDict(self.qvalue_loss(self.encode(tensordict)))

    def actor_outputs(self, features: Tensor) -> Tensor:
        """The actor's outputs on detached features, with the pull of the policy anchor, if any."""
        features = features.detach()
        out: Tensor = self.actor(features)
        return out if self.anchor is None else self.anchor(features, out)


def on_base(action: Tensor, base: Tensor | None) -> Tensor:
    """An actor's action ``[*batch, m]`` added to that of a base, if there is one, within -1..1."""
    return action if base is None else (base + action).clamp(-1.0, 1.0)


def squared_errors(values: Tensor, target: Tensor) -> Tensor:
    """Mean squared error of values ``[k, batch]``, summed over the ``k`` critics."""
    return (values - target).square().mean(-1).sum()


def smooth_errors(values: Tensor, target: Tensor) -> Tensor:
    """Mean of half the squared error up to 1, linear beyond, summed over the critics."""
    return (
        functional.smooth_l1_loss(values, target.expand_as(values), reduction="none").mean(-1).sum()
    )


class SACLoss(ActorCriticLoss):
    """Loss of soft actor-critic. Tests compare it with TorchRL's ``SACLoss``."""

    # as in TorchRL
    out_keys = ["loss_qvalue", "loss_actor", "loss_alpha", "alpha", "entropy"]  # noqa: RUF012

    def __init__(
        self, encoder: nn.Module, actor: nn.Module, critics: Critics, settings: Any
    ) -> None:
        super().__init__(encoder, actor, critics, settings)
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
        next_action, next_log_prob = self.draw(self.actor(batch.next_features), batch.next_base)
        return batch.reward + batch.discount * (
            self.next_qvalue(batch, next_action) - self.alpha * next_log_prob
        )

    def next_qvalue(self, batch: Batch, next_action: Tensor) -> Tensor:
        """Minimum ``[batch]`` of the target critics drawn for this update."""
        count = self.settings.num_min_qs
        critics = self.target_critics
        drawn = torch.randperm(len(critics))[:count] if count < len(critics) else None
        # a graph cannot depend on the drawn indices
        if drawn is not None and not torch.compiler.is_compiling():
            critics = Critics(critics[i] for i in drawn.tolist())
            drawn = None
        values: Tensor = critics(batch.next_features, next_action)
        return (values if drawn is None else values[drawn.to(values.device)]).amin(0)

    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses of actor and temperature."""
        action, log_prob = self.draw(self.actor_outputs(batch.features), batch.base)
        values = self.critics(batch.features.detach(), action)
        value = values.amin(0) if self.settings.actor_q == "min" else values.mean(0)
        return {
            "loss_actor": (self.alpha * log_prob - value).mean(),
            **self.alpha_loss(log_prob, action.shape[-1]),
        }

    def alpha_loss(self, log_prob: Tensor, action_size: int) -> dict[str, Tensor]:
        """Loss of the temperature from log-probabilities ``[batch]``, temperature and entropy."""
        entropy = -log_prob.detach().mean()
        target = self.settings.target_entropy * action_size
        return {
            "loss_alpha": self.log_alpha * (entropy - target),
            "alpha": self.alpha,
            "entropy": entropy,
        }

    def draw(self, out: Tensor, base: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Action ``[*batch, m]`` and log-probability ``[*batch]`` from the actor's outputs: a
        faster ``TanhNormal``. The probability is of what is added to a base."""
        loc, scale = location_and_scale(out, self.settings.min_scale)
        noise = torch.randn(*loc.shape, dtype=out.dtype, device=out.device)
        x = torch.addcmul(loc, scale, noise)
        # log of the normal density, less log(1 - tanh(x)^2) = 2 (log 2 - x - softplus(-2 x)), which
        # stays finite for large x
        parts = noise.square() * 0.25 + scale.log() * 0.5 - x - functional.softplus(-2.0 * x)
        constant = loc.shape[-1] * (2.0 * math.log(2.0) + 0.5 * math.log(2.0 * math.pi))
        return on_base(x.tanh(), base), -2.0 * parts.sum(-1) - constant


def location_and_scale(out: Tensor, min_scale: float) -> tuple[Tensor, Tensor]:
    """Location and scale ``[*batch, m]`` of the normal before the tanh, from outputs ``[*batch, 2
    m]``."""
    loc, raw_scale = out.chunk(2, -1)
    return loc, (functional.softplus(raw_scale + SCALE_SHIFT) + LEAST_SCALE).clamp_min(min_scale)


class PolyakUpdate:
    """TorchRL's ``SoftUpdate`` for plain modules: each step moves each pair's target by ``tau``."""

    def __init__(self, *pairs: tuple[nn.Module, nn.Module], tau: float) -> None:
        self._sources = [parameter for source, _ in pairs for parameter in source.parameters()]
        self._targets = [parameter for _, target in pairs for parameter in target.parameters()]
        self._average = get_ema_multi_avg_fn(1.0 - tau)

    @torch.no_grad()
    def step(self) -> None:
        """Move the targets."""
        self._average(self._targets, self._sources, 0)

    @torch.no_grad()
    def init_(self) -> None:
        """Let the targets equal their networks."""
        for target, source in zip(self._targets, self._sources, strict=True):
            target.copy_(source)


def build(
    env: EnvBase,
    settings: SACSettings,
    device: torch.device | str = "cpu",
    make_loss: type[SACLoss] = SACLoss,
) -> Learner:
    """SAC, or an algorithm with another loss, for an environment. Initialized from torch's global
    generator."""
    m = action_size(env)
    encoder = make_encoder(env, settings)
    actor = make_body(
        settings, encoder.size, 2 * m, norm=settings.actor_norm, dropout=settings.actor_dropout
    )
    kwargs = {"norm": settings.critic_norm, "dropout": settings.dropout}
    critics = Critics(
        [make_body(settings, encoder.size + m, 1, **kwargs) for _ in range(settings.num_qs)]
    )
    policy = gaussian_policy(encoder, actor, action_spec(env), min_scale=settings.min_scale)
    loss = make_loss(encoder, actor, critics, settings).to(device)
    target = PolyakUpdate((loss.critics, loss.target_critics), tau=settings.tau)
    return off_policy_learner(env, settings, policy.to(device), loss, target)
