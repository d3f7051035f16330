"""Common networks, batches and noise for comparisons with TorchRL's losses."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.data import Bounded, TensorSpec
from torchrl.modules import ProbabilisticActor, ValueOperator

from bricksrl.agents.actor_critic import ActorCriticLoss, Critics
from bricksrl.agents.networks import deterministic_policy, gaussian_policy, mlp
from bricksrl.agents.operators import critic_operator

SIZE, ACTION = 5, 3
GAMMA = 0.9
OF_GAUSSIAN = ("module", "0", "module", "body")
OF_DETERMINISTIC = ("module", "body")
"""Our actor's parameter names in TorchRL."""


def action_spec() -> TensorSpec:
    return Bounded(-1.0, 1.0, (ACTION,), dtype=torch.get_default_dtype())


def actor(outputs: int, **kind: Any) -> nn.Sequential:
    return mlp(SIZE, outputs, (16, 12), **kind)


def critics(count: int = 2, hidden: tuple[int, ...] = (16, 12), **kind: Any) -> Critics:
    return Critics([mlp(SIZE + ACTION, 1, hidden, **kind) for _ in range(count)])


def batch(n: int = 64, *, steps: bool = False) -> TensorDict:
    """Random transitions with terminations and truncations."""
    terminated, truncated = torch.rand(2, n, 1) < 0.3
    after = {"observation": torch.randn(n, SIZE), "reward": torch.randn(n, 1), "terminated": terminated}
    after["done"] = terminated | truncated
    action = (torch.rand(n, ACTION) * 2.0 - 1.0) * 0.99
    found = TensorDict({"observation": torch.randn(n, SIZE), "action": action, "next": TensorDict(after, [n])}, [n])
    return found.set("steps_to_next_obs", torch.randint(1, 4, (n, 1))) if steps else found


def moved(loss: ActorCriticLoss) -> Any:
    """The loss, with targets that differ from their networks."""
    for name, parameter in loss.named_parameters():
        if name.startswith("target_"):
            parameter.data += 0.1 * torch.randn_like(parameter)
    return loss


def their_gaussian(body: nn.Module, min_scale: float) -> ProbabilisticActor:
    return gaussian_policy(nn.Identity(), copy.deepcopy(body), action_spec(), min_scale=min_scale)


def their_deterministic(body: nn.Module) -> Any:
    return deterministic_policy(nn.Identity(), copy.deepcopy(body), action_spec(), noise=0.0)[0]


def their_critic(ours: Critics) -> ValueOperator:
    return critic_operator(nn.Identity(), copy.deepcopy(ours[0]).train())


def _theirs(params: Any, prefix: tuple[str, ...], names: Iterable[str]) -> list[Tensor]:
    return [params.get((*prefix, *name.split("."))) for name in names]


def copy_body(body: nn.Module, params: Any, prefix: tuple[str, ...]) -> None:
    """Write an actor's parameters into TorchRL's."""
    names, values = zip(*body.named_parameters(), strict=True)
    for value, theirs in zip(values, _theirs(params, prefix, names), strict=True):
        theirs.data.copy_(value.data)


def copy_critics(ours: Critics, params: Any) -> None:
    """Write parameters and running statistics of our critics into TorchRL's stacked ones."""
    for number, body in enumerate(ours):
        names, values = zip(*body.named_parameters(), *body.named_buffers(), strict=True)
        for value, theirs in zip(values, _theirs(params, OF_DETERMINISTIC, names), strict=True):
            theirs.data[number].copy_(value.data)


def assert_same_actor_gradients(body: nn.Module, loss: Tensor, params: Any, prefix: tuple[str, ...], theirs: Tensor) -> None:
    names, values = zip(*body.named_parameters(), strict=True)
    one = torch.autograd.grad(loss, values, retain_graph=True)
    other = torch.autograd.grad(theirs, _theirs(params, prefix, names), retain_graph=True)
    assert_close(one, other)


def assert_same_critic_gradients(ours: Critics, loss: Tensor, params: Any, theirs: Tensor) -> None:
    names = [name for name, _ in ours[0].named_parameters()]
    stacks = list(zip(*(tuple(body.parameters()) for body in ours), strict=True))
    one = torch.autograd.grad(loss, [value for stack in stacks for value in stack], retain_graph=True)
    other = torch.autograd.grad(theirs, _theirs(params, OF_DETERMINISTIC, names), retain_graph=True)
    k = len(ours)
    assert_close([torch.stack(one[i * k : (i + 1) * k]) for i in range(len(names))], other)


def assert_close(ours: Iterable[Tensor], theirs: Iterable[Tensor]) -> None:
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(one.detach(), other.detach().view(one.shape), rtol=1e-6, atol=1e-8)


class Draws:
    """Equal standard normal draws for both losses, in each one's order."""

    def __init__(self, **by_name: Tensor) -> None:
        self.by_name = by_name

    def _order(self, names: tuple[str, ...]) -> Iterator[Tensor]:
        return iter([self.by_name[name] for name in names])

    def for_ours(self, patched: pytest.MonkeyPatch, *names: str) -> None:
        order = self._order(names)
        patched.setattr(torch, "randn", lambda *shape, **_: next(order))

    def for_theirs(self, patched: pytest.MonkeyPatch, *names: str) -> None:
        order = self._order(names)
        patched.setattr(torch.distributions.normal, "_standard_normal", lambda *_, **__: next(order))
        patched.setattr(torch, "normal", lambda loc, scale: loc + scale * next(order))
