"""Small agents for tests, and transitions of the RoboArm's simulation for them to learn from."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

import torch
from torch import Tensor

import bricksrl
from bricksrl.agents import Settings, make_agent, preset
from bricksrl.agents.agent import Agent, Transition
from bricksrl.agents.layout import layout_of
from bricksrl.agents.off_policy import OffPolicyAgent

ENV = bricksrl.make("RoboArmSim-v0", seed=0)
LAYOUT = layout_of(ENV)
TASK = ENV.task
A = TypeVar("A", bound=Agent)
LEARNERS = ("sac", "td3", "droq", "redq", "crossq", "iql", "cql", "td3bc")


def small(agent: str, **changes: Any) -> Settings:
    """The default settings with networks that learn in no time."""
    usual = {"hidden": (16, 16), "batch_size": 10, "updates_per_step": 1, "actor_delay": 1}
    return replace(preset("default", agent), **{**usual, **changes})


def transitions(count: int, length: int = 5) -> list[Transition]:
    """Random steps of the arm in episodes of ``length``; the same ones at every call."""
    generator = torch.Generator().manual_seed(7)
    with torch.random.fork_rng():
        ENV.set_seed(5)
        found: list[Transition] = []
        for step in range(1, count + 1):
            state = ENV.reset() if step % length == 1 else ENV.step_mdp(state)  # noqa: F821
            state["action"] = torch.rand(4, generator=generator) * 2 - 1
            state = ENV.step(state)
            after = state["next"]
            reward, terminated = float(after["reward"]), bool(after["terminated"])
            found.append(
                Transition(state["observation"], state["action"], reward, after["observation"], terminated, step % length == 0)
            )
    return found


def fresh(agent: str, settings: Settings | None = None, seed: int = 11) -> OffPolicyAgent:
    """An agent that has learned nothing."""
    torch.manual_seed(seed)
    made = make_agent(agent, LAYOUT, 4, settings or small(agent), TASK)
    assert isinstance(made, OffPolicyAgent)
    return made


def taught(made: A, steps: Iterable[Transition], updates: int = 3) -> A:
    """The agent after it has seen some steps, and made some updates."""
    for transition in steps:
        made.remember(transition)
    for _ in range(updates):
        made.update()
    return made


def learned(agent: str, settings: Settings | None = None, updates: int = 3) -> OffPolicyAgent:
    """An agent after some updates."""
    return taught(fresh(agent, settings), transitions(30), updates)


def tensors(agent: Agent) -> list[Tensor]:
    """All tensors of its state but the memory."""
    state = agent.state_dict()
    del state["replay"]
    parts = [part.values() for part in state.values() if isinstance(part, dict)]
    return [value for values in parts for value in values if isinstance(value, Tensor)]


def saved(agent: Agent) -> dict[str, Any]:
    """Its state after a while in a file."""
    file = io.BytesIO()
    torch.save(agent.state_dict(), file)
    file.seek(0)
    state: dict[str, Any] = torch.load(file, weights_only=True)
    return state


def assert_go_on_alike(one: Agent, other: Agent, steps: list[Transition]) -> None:
    """They learn the same from the steps and act the same then, bit for bit."""
    for each in (one, other):
        torch.manual_seed(1)
        for transition in steps:
            each.remember(transition)
            each.update()
    assert all(torch.equal(a, b) for a, b in zip(tensors(one), tensors(other), strict=True))
    seen = steps[0].observation
    assert torch.equal(one.act(seen, explore=False), other.act(seen, explore=False))
