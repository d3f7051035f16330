"""What the comparisons with TorchRL's losses share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictParams
from torch import Tensor, nn

from bricksrl.agents.lean.flat import Flat, Learned
from bricksrl.agents.networks import StackedCritics
from bricksrl.agents.off_policy import Batch, OffPolicyAgent


class Separate(nn.Module):
    """A critic of ordinary layers, as TorchRL's losses want it."""

    def __init__(self, layers: nn.Sequential) -> None:
        super().__init__()
        self.layers = layers

    def forward(self, features: Tensor, action: Tensor) -> Tensor:
        value: Tensor = self.layers(torch.cat((features, action), -1))
        return value


def separate(layers: nn.Sequential) -> Separate:
    """The layers as a critic."""
    return Separate(layers)


def batch_of(agent: OffPolicyAgent, n: int) -> Batch:
    """Random transitions of 4 actions."""
    size = agent.encoder.size
    return Batch(torch.randn(n, size), torch.rand(n, 4) * 2 - 1, torch.randn(n), torch.randn(n, size), torch.rand(n) < 0.3)


def to_torchrl(batch: Batch) -> TensorDict:
    """The batch as TorchRL has it."""
    n = len(batch.reward)
    done = batch.terminated[:, None]
    after = {"features": batch.next_features, "reward": batch.reward[:, None], "terminated": done, "done": done}
    return TensorDict({"features": batch.features, "action": batch.action, "next": TensorDict(after, [n])}, [n])


def as_theirs(name: str, value: Tensor) -> Tensor:
    """A stacked parameter, or its gradient, in the shape that a stack of ordinary layers has."""
    return value.mT if name.endswith("weight") and value.shape[1] > 1 else value.squeeze(1)


def copy_critics(critics: StackedCritics, params: TensorDictParams) -> None:
    """Write the weights and running statistics of our critics into TorchRL's."""
    for name, value in [*critics.named_parameters(), *critics.named_buffers()]:
        params.get(("module", *name.split("."))).data.copy_(as_theirs(name, value.detach()))


def gradients_of(critics: StackedCritics, loss: Tensor, params: TensorDictParams, their_loss: Tensor) -> Any:
    """Gradients of the losses for our critics and for TorchRL's, in one shape."""
    parameters = list(critics.named_parameters())
    ours = torch.autograd.grad(loss, [value for _, value in parameters], retain_graph=True)
    theirs = torch.autograd.grad(
        their_loss, [params.get(("module", *name.split("."))) for name, _ in parameters], retain_graph=True
    )
    return tuple(as_theirs(name, value) for (name, _), value in zip(parameters, ours, strict=True)), theirs


def frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing move, so that gradients can be looked at: no step of Adam, no target that follows."""
    monkeypatch.setattr(Learned, "step", lambda self: None)
    monkeypatch.setattr(Flat, "follow", lambda self, other, share: None)


def written(learned: Learned, module: nn.Module) -> tuple[Tensor, ...]:
    """Gradients that were written by hand."""
    return tuple(learned.gradient(parameter).clone() for parameter in module.parameters())


def written_for_critics(learned: Learned, critics: StackedCritics) -> tuple[Tensor, ...]:
    """The same for critics, in TorchRL's shape."""
    return tuple(as_theirs(name, learned.gradient(parameter)) for name, parameter in critics.named_parameters())


def of_critics(critics: StackedCritics, params: TensorDictParams) -> list[Tensor]:
    """TorchRL's parameters, in the order of ours."""
    return [params.get(("module", *name.split("."))) for name, _ in critics.named_parameters()]


def of_actor(actor: nn.Module, params: TensorDictParams, prefix: tuple[str, ...]) -> list[Tensor]:
    """TorchRL's parameters of an actor, in the order of ours."""
    return [params.get((*prefix, *name.split("."))) for name, _ in actor.named_parameters()]


def assert_close(ours: Iterable[Tensor], theirs: Iterable[Tensor], rtol: float = 1e-4, atol: float = 1e-5) -> None:
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(one.detach(), other.detach(), rtol=rtol, atol=atol)
