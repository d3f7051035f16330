"""Compiled updates equal eager ones."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from small import learned, make, steps, taught
from torch import Tensor

from bricksrl.agents.actor_critic import ActorCriticLoss
from bricksrl.agents.compiled import CompiledGradients, compile_updates
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.teachers import hold
from bricksrl.errors import RunError


def compiled(learner: GradientLearner, backend: str = "eager") -> CompiledGradients:
    """Traced without machine code, which needs no C++ compiler."""
    assert isinstance(learner.loss, ActorCriticLoss)
    return CompiledGradients(learner.loss, learner.device, backend)


def gradients(learner: GradientLearner) -> list[Tensor | None]:
    found = [None if one.grad is None else one.grad.clone() for one in learner.descent.parameters()]
    for one in learner.descent.parameters():
        one.grad = None
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("agent", "changes"), [("sac", {"n_step": 3}), ("td3", {}), ("droq", {}), ("redq", {})]
)
def test_compiled_losses_and_gradients_equal_eager(agent: str, changes: dict[str, Any]) -> None:
    learner = taught(make(agent, **changes))
    graph, loss, batch = compiled(learner), learner.loss, learner.memory.sample()  # type: ignore[union-attr]
    assert isinstance(loss, ActorCriticLoss)
    for whole in (True, False):
        torch.manual_seed(3)
        losses = loss(batch) if whole else loss.critic_losses(batch)
        torch.stack(
            [value for name, value in losses.items() if name.startswith("loss")]
        ).sum().backward()
        eager = gradients(learner)
        torch.manual_seed(3)
        found = graph(batch, whole)
        assert set(found.keys()) == set(losses.keys())
        for name, value in losses.items():
            torch.testing.assert_close(found[name], value.detach(), rtol=1e-5, atol=1e-6)
        for one, other in zip(eager, gradients(learner), strict=True):
            assert (one is None) == (other is None)
            if one is not None and other is not None:
                torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


def test_updates_use_compiled_gradients() -> None:
    one, other = learned("sac", actor_delay=2), learned("sac", actor_delay=2)
    other.descent.gradients = compiled(other)
    for learner in (one, other):
        torch.manual_seed(3)
        told = learner.make_updates(4)
        assert "loss_qvalue" in told
    for mine, theirs in zip(one.loss.parameters(), other.loss.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("agent", ["crossq", "cql", "tqc", "ppo", "bc", "random"])
def test_other_algorithms_cannot_be_compiled(agent: str) -> None:
    with pytest.raises(
        RunError, match="^only SAC, DroQ, REDQ and TD3 can be compiled; omit --compile$"
    ):
        compile_updates(make(agent))


def test_running_statistics_cannot_be_compiled() -> None:
    with pytest.raises(
        RunError, match="batch normalisation cannot be compiled; choose layer or rms"
    ):
        compile_updates(make("sac", critic_norm="batch"))


def test_anchored_policy_cannot_be_compiled() -> None:
    learner = make("sac")
    hold(learner)
    with pytest.raises(RunError, match="an anchored policy cannot be compiled"):
        compile_updates(learner)
    compiled = make("sac")
    compile_updates(compiled)
    with pytest.raises(RunError, match="a policy that is taught cannot be compiled"):
        hold(compiled)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own, when it loads
def test_missing_compiler_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch._inductor.config as inductor

    monkeypatch.setattr(inductor.cpp, "cxx", ("/nowhere/c++",))
    monkeypatch.setattr(inductor, "fx_graph_cache", False)
    learner = make("sac", hidden=(4,))
    learner.remember(steps(20))
    compile_updates(learner)
    with pytest.raises(RunError, match=r"no C\+\+ compiler; install one") as caught:
        learner.make_updates(1)
    assert "\n" not in str(caught.value)
