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
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import SoftUpdate

from bricksrl.agents.actor_critic import ActorCriticLoss, Critics
from bricksrl.agents.networks import deterministic_policy, gaussian_policy, mlp
from bricksrl.agents.operators import critic_operator

SIZE, ACTION, N = 5, 3, 64
GAMMA = 0.9
_GAUSSIAN = ("module", "0", "module", "body")
_DETERMINISTIC = ("module", "body")
"""Our actor's parameter names in TorchRL."""


def action_spec() -> TensorSpec:
    return Bounded(-1.0, 1.0, (ACTION,), dtype=torch.get_default_dtype())


def actor(outputs: int, **kind: Any) -> nn.Sequential:
    return mlp(SIZE, outputs, (16, 12), **kind)


def critics(count: int = 2, hidden: tuple[int, ...] = (16, 12), **kind: Any) -> Critics:
    return Critics([mlp(SIZE + ACTION, 1, hidden, **kind) for _ in range(count)])


def batch(n: int = N, *, steps: bool = False) -> TensorDict:
    """Random transitions with terminations and truncations."""
    terminated, truncated = torch.rand(2, n, 1) < 0.3
    after = {
        "observation": torch.randn(n, SIZE),
        "reward": torch.randn(n, 1),
        "terminated": terminated,
    }
    after["done"] = terminated | truncated
    action = (torch.rand(n, ACTION) * 2.0 - 1.0) * 0.99
    found = TensorDict(
        {"observation": torch.randn(n, SIZE), "action": action, "next": TensorDict(after, [n])}, [n]
    )
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


def their_loss(
    kind: Any, loss: Any, policy: Any, tau: float = 0.5, **options: Any
) -> tuple[Any, Any]:
    """TorchRL's loss with copies of our networks, and the update of its targets if there are
    any."""
    critic = critic_operator(nn.Identity(), copy.deepcopy(loss.critics[0]).train())
    oracle = kind(policy, critic, loss_function="l2", action_spec=action_spec(), **options)
    oracle.make_value_estimator(gamma=GAMMA)
    _copy_critics(loss.critics, oracle.qvalue_network_params)
    if not hasattr(loss, "target_critics"):
        return oracle, None
    targets = SoftUpdate(oracle, tau=tau)
    _copy_critics(loss.target_critics, oracle.target_qvalue_network_params)
    if hasattr(loss, "target_actor"):
        names, values = zip(*loss.target_actor.named_parameters(), strict=True)
        for value, theirs in zip(
            values, _theirs(oracle.target_actor_network_params, _DETERMINISTIC, names), strict=True
        ):
            theirs.data.copy_(value.data)
    return oracle, targets


def _theirs(params: Any, prefix: tuple[str, ...], names: Iterable[str]) -> list[Tensor]:
    return [params.get((*prefix, *name.split("."))) for name in names]


def _copy_critics(ours: Critics, params: Any) -> None:
    """Write parameters and running statistics of our critics into TorchRL's stacked ones."""
    for number, body in enumerate(ours):
        names, values = zip(*body.named_parameters(), *body.named_buffers(), strict=True)
        for value, theirs in zip(values, _theirs(params, _DETERMINISTIC, names), strict=True):
            theirs.data[number].copy_(value.data)


def assert_same_gradients(
    ours: Any, oracle: Any, critic: tuple[Tensor, Tensor], actor: tuple[Tensor, Tensor]
) -> None:
    """Equal gradients of two pairs of values (our loss, TorchRL's) for the critics and for the
    actor."""
    assert_same_critic_gradients(ours.critics, critic[0], oracle.qvalue_network_params, critic[1])
    names, values = zip(*ours.actor.named_parameters(), strict=True)
    prefix = _DETERMINISTIC if hasattr(ours, "target_actor") else _GAUSSIAN
    one = torch.autograd.grad(actor[0], values, retain_graph=True)
    other = torch.autograd.grad(
        actor[1], _theirs(oracle.actor_network_params, prefix, names), retain_graph=True
    )
    assert_close(one, other)


def assert_same_critic_gradients(ours: Critics, loss: Tensor, params: Any, theirs: Tensor) -> None:
    names = [name for name, _ in ours[0].named_parameters()]
    stacks = list(zip(*(tuple(body.parameters()) for body in ours), strict=True))
    one = torch.autograd.grad(
        loss, [value for stack in stacks for value in stack], retain_graph=True
    )
    other = torch.autograd.grad(theirs, _theirs(params, _DETERMINISTIC, names), retain_graph=True)
    k = len(ours)
    assert_close([torch.stack(one[i * k : (i + 1) * k]) for i in range(len(names))], other)


def assert_close(ours: Iterable[Tensor], theirs: Iterable[Tensor]) -> None:
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(
            one.detach(), other.detach().view(one.shape), rtol=1e-6, atol=1e-8
        )


def assert_same_parameters(one: Any, other: Any, *networks: str) -> None:
    """Equal networks of two losses of TorchRL's."""
    for name in networks:
        ends = [getattr(loss, name).flatten_keys() for loss in (one, other)]
        assert_close(*([end[key] for key in sorted(ends[0].keys())] for end in ends))


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
        patched.setattr(
            torch.distributions.normal, "_standard_normal", lambda *_, **__: next(order)
        )
        patched.setattr(torch, "normal", lambda loc, scale: loc + scale * next(order))


def draws() -> Draws:
    """Draws for the next step's action and this one's."""
    return Draws(after=torch.randn(N, ACTION), now=torch.randn(N, ACTION))
