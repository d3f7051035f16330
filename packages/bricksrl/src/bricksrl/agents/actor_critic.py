"""Common parts of SAC, TD3, CrossQ and CQL: critics, the loss of an actor and critics on one
encoder, and the update of target networks."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torch.nn import functional
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.objectives.common import LossModule
from torchrl.objectives.utils import hold_out_net

from bricksrl.agents.anchor import REACH, REACH_ON_BASE, STEPS, PolicyAnchor, layers_of
from bricksrl.agents.features.encoder import encode, encoder_keys
from bricksrl.agents.settings import CriticSettings, OffPolicySettings
from bricksrl.errors import RunError


class Critics(nn.ModuleList):
    """``k`` independent critics: features ``[batch, f]`` and actions ``[batch, m]`` to values ``[k,
    batch]``."""

    def forward(
        self,
        features: Tensor,
        action: Tensor,
    ) -> Tensor:
        x = torch.cat((features, action), -1)
        values = [body(x).squeeze(-1) for body in self]
        return torch.stack(values)


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

    outputs_per_number: ClassVar[int] = 1
    """Outputs of the actor for each number of an action, the mean before the tanh first."""

    def __init__(
        self,
        encoder: nn.Module,
        actor: nn.Module,
        critics: Critics,
        settings: OffPolicySettings,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.actor = actor
        self.critics = critics
        self.gamma = settings.gamma
        # of a policy that was taught; it counts the updates that include the actor
        self.anchor: nn.Module | None = None
        actor_updates = STEPS * settings.updates_per_step / settings.actor_delay
        self.anchored_updates = max(1, round(actor_updates))
        self.is_compiled = False
        self.base: nn.Module | None = None
        # CrossQ's settings have no choice of the critics' loss
        is_smooth = isinstance(settings, CriticSettings) and settings.critic_loss == "smooth-l1"
        self.errors = smooth_errors if is_smooth else squared_errors
        keys = encoder_keys(encoder)
        outcome = [("next", key) for key in (*keys, "reward", "terminated")]
        self.in_keys = [*keys, "action", *outcome]

    @abstractmethod
    def target_qvalue(self, batch: Batch) -> Tensor:
        """Target of the critics ``[batch]``, without gradient."""

    @abstractmethod
    def actor_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Losses ("loss_actor" and others) and metrics; without gradient for the critics."""

    def qvalue_loss(self, batch: Batch) -> dict[str, Tensor]:
        """Errors summed over the critics, other losses and metrics."""
        target = self.target_qvalue(batch)
        values = self.critics(batch.features, batch.action)  # [k, batch]
        return {"loss_qvalue": self.errors(values, target)}

    def encode(self, tensordict: TensorDictBase) -> Batch:
        """Encode a batch from a replay buffer."""
        features = encode(self.encoder, tensordict)
        after = tensordict["next"]
        with torch.no_grad():
            next_features = encode(self.encoder, after)
        # n-step returns: the value is bootstrapped from n steps later, fewer at an episode's end
        steps = tensordict.get("steps_to_next_obs", None)
        gamma = self.gamma if steps is None else self.gamma ** steps.squeeze(-1)
        # by "terminated" and not by "done": after a time limit the next state has its value
        goes_on = ~after["terminated"].squeeze(-1)
        discount = gamma * goes_on.to(features.dtype)
        reward = after["reward"].squeeze(-1)
        batch = Batch(
            features,
            tensordict["action"],
            reward,
            next_features,
            discount,
        )
        if self.base is None:
            return batch
        return replace(batch, base=self.base(tensordict), next_base=self.base(after))

    def forward(self, tensordict: TensorDictBase) -> TensorDict:
        """All losses of a batch, and detached metrics; scalars."""
        batch = self.encode(tensordict)
        losses = self.qvalue_loss(batch)
        # the actor's loss passes through the critics, which must not learn from it
        with hold_out_net(self.critics):
            losses |= self.actor_loss(batch)
        return TensorDict(losses)

    def critic_losses(self, tensordict: TensorDictBase) -> TensorDict:
        """The losses of an update without the actor."""
        batch = self.encode(tensordict)
        return TensorDict(self.qvalue_loss(batch))

    def anchor_actor(self) -> None:
        """Hold the actor near its current policy for the updates of `STEPS` robot steps. Raises
        RunError if updates are compiled."""
        # an anchor counts updates in Python, where a graph would keep the first count
        if self.is_compiled:
            raise RunError("a policy that is taught cannot be compiled; omit --compile")
        last_bias = layers_of(self.actor)[-1]
        self.anchor = PolicyAnchor(
            self.actor,
            len(last_bias) // self.outputs_per_number,
            self.anchored_updates,
            REACH if self.base is None else REACH_ON_BASE,
        )

    def load_state_dict(
        self,
        state_dict: Any,
        *args: Any,
        **options: Any,
    ) -> Any:
        """Restore ``state_dict``, also of a policy that was taught. Raises RuntimeError if it is of
        another loss, RunError as `anchor_actor` does."""
        # only a taught policy has an anchor, and a state does not load into what is not there yet
        if any(str(name).startswith("anchor.") for name in state_dict):
            self.anchor_actor()
        return super().load_state_dict(state_dict, *args, **options)

    def actor_outputs(self, features: Tensor) -> Tensor:
        """The actor's outputs on detached features, with the pull of the policy anchor, if any."""
        features = features.detach()
        out: Tensor = self.actor(features)
        if self.anchor is None:
            return out
        anchored: Tensor = self.anchor(features, out)
        return anchored


def on_base(action: Tensor, base: Tensor | None) -> Tensor:
    """An actor's action ``[*batch, m]`` added to that of a base, if there is one, within -1..1."""
    if base is None:
        return action
    return (base + action).clamp(-1.0, 1.0)


def squared_errors(values: Tensor, target: Tensor) -> Tensor:
    """Mean squared error of values ``[k, batch]``, summed over the ``k`` critics."""
    errors = values - target  # [k, batch]
    # summed: each critic learns as fast as it would alone, however many there are
    return errors.square().mean(-1).sum()


def smooth_errors(values: Tensor, target: Tensor) -> Tensor:
    """Mean of half the squared error up to 1, linear beyond, summed over the critics."""
    errors = functional.smooth_l1_loss(values, target.expand_as(values), reduction="none")
    return errors.mean(-1).sum()


class PolyakUpdate:
    """TorchRL's ``SoftUpdate`` for plain modules: each step moves each pair's target by ``tau``."""

    def __init__(
        self,
        *pairs: tuple[nn.Module, nn.Module],
        tau: float,
    ) -> None:
        # flat lists, so that one fused operation moves all of them
        self._sources: list[Tensor] = []
        self._targets: list[Tensor] = []
        for source, target in pairs:
            self._sources += source.parameters()
            self._targets += target.parameters()
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
