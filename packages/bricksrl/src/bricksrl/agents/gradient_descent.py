"""Gradient descent: updates of a loss's networks, and what all learners that make them share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.objectives import LossModule

from bricksrl.agents.learner import Learner
from bricksrl.agents.settings import Settings

ACTOR_LOSSES = ("loss_actor", "loss_alpha")
"""Losses omitted in updates without the actor."""


def adam(
    parameters: Iterable[Tensor],
    settings: Settings,
    weight_decay: float = 0.0,
) -> torch.optim.Optimizer:
    """Adam with decoupled weight decay over all parameters with gradients."""
    learned = [parameter for parameter in parameters if parameter.requires_grad]
    betas = (settings.adam_beta, 0.999)
    return torch.optim.AdamW(
        learned,
        lr=settings.learning_rate,
        betas=betas,
        weight_decay=weight_decay,
        fused=True,
    )


def means(metrics: Iterable[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Mean of each metric over the updates that report it."""
    updates = list(metrics)
    # An actor's losses are not in each update, where it learns less often than its critics.
    values: dict[str, list[Tensor]] = {}
    for update in updates:
        for name, value in update.items():
            values.setdefault(name, []).append(value)
    return {name: torch.stack(of_name).mean() for name, of_name in values.items()}


@dataclass
class GradientDescent:
    """A loss, and the steps that its networks make down its gradient.

    Attributes:
        loss: any `LossModule`.
        optimizer: of the loss's parameters.
        target: its ``step`` moves target networks after an update, as TorchRL's ``SoftUpdate``.
        actor_delay: every n-th update includes the actor's losses.
        target_delay: every n-th update moves the targets.
        reset_every: updates after which networks, targets and optimiser start anew; 0 for never.
        minimised: losses to minimise; ``None`` for all names that begin with "loss".
        clip_norm: limit of the gradient's norm.
        gradients: replaces autograd; see `bricksrl.agents.compiled`.
        updates: number of updates so far.
    """

    loss: LossModule
    optimizer: torch.optim.Optimizer
    target: Any = None
    actor_delay: int = 1
    target_delay: int = 1
    reset_every: int = 0
    minimised: tuple[str, ...] | None = None
    clip_norm: float | None = None
    gradients: Callable[[TensorDictBase, bool], TensorDictBase] | None = None
    updates: int = field(default=0, init=False)

    def parameters(self) -> list[Tensor]:
        """Parameters of the optimiser."""
        groups = self.optimizer.param_groups
        return [parameter for group in groups for parameter in group["params"]]

    def step(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """One gradient step on a batch. Returns detached losses and metrics."""
        self.updates += 1
        with_actor = self.updates % self.actor_delay == 0
        if self.gradients is not None:
            losses = self.gradients(batch, with_actor)
        else:
            losses = self._losses(batch, with_actor)
            self._total(losses, with_actor).backward()
        if self.clip_norm is not None:
            torch.nn.utils.clip_grad_norm_(self.parameters(), self.clip_norm)
        self.optimizer.step()
        self.optimizer.zero_grad()
        if self.target is not None and self.updates % self.target_delay == 0:
            self.target.step()
        if self.reset_every and self.updates % self.reset_every == 0:
            self._restart()
        return {
            name: value.detach()
            for name, value in losses.items()
            if isinstance(name, str) and value.numel() == 1
        }

    def _losses(
        self,
        batch: TensorDictBase,
        with_actor: bool,
    ) -> TensorDictBase:
        # Ours can leave the actor's losses out; TorchRL's compute all, and some are dropped.
        losses: TensorDictBase
        if not with_actor and hasattr(self.loss, "critic_losses"):
            losses = self.loss.critic_losses(batch)
        else:
            losses = self.loss(batch)
        return losses

    def _total(
        self,
        losses: TensorDictBase,
        with_actor: bool,
    ) -> Tensor:
        """What is minimised, a scalar."""
        names = self.minimised
        if not names:
            # By keys: a TensorDict itself is iterated over by rows.
            names = tuple(name for name in losses.keys() if name.startswith("loss"))  # noqa: SIM118
        skipped = () if with_actor else ACTOR_LOSSES
        values = [losses[name].sum() for name in names if name in losses and name not in skipped]
        return torch.stack(values).sum()

    def _restart(self) -> None:
        """Draw the weights of all layers anew that are learned; what is frozen, such as a base, an
        anchor or a part of a user's network, and what was measured, such as ranges and the
        temperature, stays."""
        learned = {id(tensor) for tensor in self.parameters() if tensor.requires_grad}
        for module in self.loss.modules():
            is_learned = any(id(tensor) in learned for tensor in module.parameters(recurse=False))
            if not is_learned or not hasattr(module, "reset_parameters"):
                continue
            # `reset_parameters` draws all of a layer's tensors, also one that is frozen.
            frozen = [
                (tensor, tensor.detach().clone())
                for tensor in module.parameters()
                if id(tensor) not in learned
            ]
            module.reset_parameters()
            with torch.no_grad():
                for tensor, before in frozen:
                    tensor.copy_(before)
        # Targets begin as their networks do, and Adam's moments are of weights that are gone.
        if self.target is not None:
            self.target.init_()
        self.optimizer.state.clear()

    def state_dict(self) -> dict[str, Any]:
        """Loss and optimiser, and the number of updates."""
        return {
            "updates": self.updates,
            "loss": dict(self.loss.state_dict()),
            "optimizer": self.optimizer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state_dict`. Raises any error if it is of another loss or optimiser."""
        self.updates = int(state["updates"])
        load_loss(self.loss, state["loss"])
        load_optimizer(self.optimizer, state["optimizer"])


@dataclass
class GradientLearner(Learner, ABC):
    """A learner that descends a gradient, batch by batch."""

    descent: GradientDescent

    @property
    def loss(self) -> LossModule:
        """The loss that is minimised."""
        return self.descent.loss

    @property
    def updates(self) -> int:
        """Number of updates so far."""
        return self.descent.updates

    @property
    def device(self) -> torch.device:
        """Device of the networks."""
        parameters = self.descent.parameters()
        return parameters[0].device if parameters else super().device

    @abstractmethod
    def batches(self, count: int) -> Iterator[TensorDictBase]:
        """``count`` batches, each drawn when it is wanted; none without data."""

    def make_updates(self, count: int) -> dict[str, Tensor]:
        metrics = means(map(self.descent.step, self.batches(count)))
        # The copy on the environment's device acts next.
        if self._copy is not None:
            self._copy.load_state_dict(self.policy.state_dict())
        return metrics

    def state_dict(self) -> dict[str, Any]:
        return {**super().state_dict(), **self.descent.state_dict()}

    def _load(self, state: dict[str, Any]) -> None:
        super()._load(state)
        self.descent.load_state_dict(state)


def load_loss(loss: LossModule, state: dict[str, Any]) -> None:
    """Restore a loss's ``state_dict``. Raises RuntimeError if it is of another loss."""
    # TorchRL's losses create their estimator, and some buffers, when they are first used: a state
    # does not load into what is not there yet.
    if any(name.startswith("_value_estimator.") for name in state):
        _ = loss.value_estimator
    for name in state.keys() - loss.state_dict().keys():
        if getattr(loss, name, state) is None:
            delattr(loss, name)
            loss.register_buffer(name, state[name])
    loss.load_state_dict(state)


def load_optimizer(optimizer: torch.optim.Optimizer, state: dict[str, Any]) -> None:
    """Restore an optimiser's ``state_dict``. Raises KeyError, TypeError or ValueError if it is of
    another one."""
    kinds = [_kinds(group) for group in optimizer.param_groups]
    # It takes whatever it is given, and the first update would fail on it.
    optimizer.load_state_dict(state)
    if [_kinds(group) for group in optimizer.param_groups] != kinds:
        raise TypeError("its options are of other types")
    # What another optimiser of a user keeps is not known.
    if not isinstance(optimizer, torch.optim.Adam):
        return
    for parameter, kept in optimizer.state.items():
        shapes = [kept[name].shape for name in ("exp_avg", "exp_avg_sq")]
        if shapes != [parameter.shape] * 2 or kept["step"].ndim:
            raise ValueError("its moments are of other shapes")


def _kinds(group: dict[str, Any]) -> dict[str, type]:
    """Types of an optimiser's options; all numbers are of one, as a schedule makes floats of
    whole ones."""
    is_number = {name: type(value) in (int, float) for name, value in group.items()}
    return {name: float if is_number[name] else type(value) for name, value in group.items()}
