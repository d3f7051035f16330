"""Actor-critic losses: the parts that SAC, TD3, CrossQ and CQL share.

Each is a `LossModule` with TorchRL's keys, whose own are their oracles, of a `qvalue_loss` and an `actor_loss`, which not every
update computes. Features are computed once for all networks; only the critics' loss trains their encoder.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import hold_out_net

from bricksrl.agents.encoder import encoder_keys
from bricksrl.agents.settings import OffPolicySettings

if TYPE_CHECKING:
    from bricksrl.agents.policy_transfer import PolicyAnchor


class Critics(nn.ModuleList):
    """``k`` independent action values: features ``[batch, f]`` and actions ``[batch, m]`` to values ``[k, batch]``."""

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        x = torch.cat((features, action), -1)
        return torch.stack([body(x).squeeze(-1) for body in self])


@dataclass(frozen=True)
class Batch:
    """Encoded transitions: ``features``, ``next_features`` ``[batch, f]``, ``action`` ``[batch, m]``, the others ``[batch]``."""

    features: Tensor
    action: Tensor
    reward: Tensor
    next_features: Tensor
    discount: Tensor
    """Weight of the next state's value: 0 where the task ended, else gamma to the power of the steps in between."""


class ActorCriticLoss(LossModule):  # type: ignore[misc]
    """A loss for an actor and critics on the features of one encoder.

    Args:
        encoder: what is observed to features ``[batch, f]``.
        actor: the body of the policy, features to its outputs.
        settings: of the algorithm.
    """

    def __init__(self, encoder: nn.Module, actor: nn.Module, critics: Critics, settings: OffPolicySettings) -> None:
        super().__init__()
        self.encoder, self.actor, self.critics, self.gamma = encoder, actor, critics, settings.gamma
        self.anchor: PolicyAnchor | None = None
        self._keys = encoder_keys(encoder)
        self.in_keys = [*self._keys, "action", *(("next", key) for key in (*self._keys, "reward", "terminated"))]

    @abstractmethod
    def target_qvalue(self, batch: Batch) -> Tensor:
        """What the critics are to predict ``[batch]``, without gradient."""

    @abstractmethod
    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The actor's loss, as "loss_actor", and what else is descended or told; no gradient of it is for the critics."""

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """The critics' squared errors, summed over the critics, and what else is descended or told."""
        target = self.target_qvalue(batch)
        return {"loss_qvalue": squared_errors(self.critics(batch.features, batch.action), target)}

    def encode(self, tensordict: TensorDictBase) -> Batch:
        """The encoded transitions of a batch from a replay buffer."""
        after = tensordict["next"]
        features = self.encoder(*(tensordict[key] for key in self._keys))
        with torch.no_grad():
            next_features = self.encoder(*(after[key] for key in self._keys))
        steps = tensordict.get("steps_to_next_obs", None)
        gamma = self.gamma if steps is None else self.gamma ** steps.squeeze(-1)
        discount = gamma * (~after["terminated"].squeeze(-1)).to(features.dtype)
        return Batch(features, tensordict["action"], after["reward"].squeeze(-1), next_features, discount)

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """All losses of a batch, and detached values beside them, each a scalar."""
        batch = self.encode(tensordict)
        found = self.qvalue_loss(batch)
        with hold_out_net(self.critics):
            found |= self.actor_loss(batch)
        return TensorDict(found)

    def critic_losses(self, tensordict: TensorDictBase) -> TensorDict:
        """The losses of a batch in whose update the actor has no part."""
        return TensorDict(self.qvalue_loss(self.encode(tensordict)))

    def actor_outputs(self, features: Tensor) -> Tensor:
        """Outputs of the actor on features without gradient, held near the anchor where there is one."""
        features = features.detach()
        out: Tensor = self.actor(features)
        return out if self.anchor is None else self.anchor(features, out)

    def _forward_value_estimator_keys(self, **_: object) -> None:
        """No value estimator: the target is part of the loss."""


def squared_errors(values: Tensor, target: Tensor) -> Tensor:
    """Mean squared error of values ``[k, batch]``, summed over the ``k`` critics."""
    return (values - target).square().mean(-1).sum()


class PolyakUpdate:
    """TorchRL's ``SoftUpdate`` for plain modules: each step moves the target of each pair by the share ``tau``."""

    def __init__(self, *pairs: tuple[nn.Module, nn.Module], tau: float) -> None:
        self._sources = [parameter for source, _ in pairs for parameter in source.parameters()]
        self._targets = [parameter for _, target in pairs for parameter in target.parameters()]
        self._average = get_ema_multi_avg_fn(1.0 - tau)

    @torch.no_grad()
    def step(self) -> None:
        """Move the targets."""
        self._average(self._targets, self._sources, 0)
