"""Agents: what decides and learns. `make_agent` makes one by name; torch is loaded only then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bricksrl.agents.presets import AGENTS, PRESETS, CrossQSettings, SACSettings, Settings, TD3Settings, preset
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.agents.agent import Agent
    from bricksrl.agents.layout import ObservationLayout
    from bricksrl.envs.task import Task


def make_agent(
    name: str, layout: ObservationLayout, action_size: int, settings: Settings | None = None, task: Task | None = None
) -> Agent:
    """An agent for observations of that layout and actions ``[action_size]`` in -1..1.

    Args:
        settings: without them those of the preset "default"; the agent "random" has none.
        task: what the observations are of; an agent learns from exchanged goals only where it knows the task.

    Raises:
        UnknownNameError: there is no agent of that name.
        DescriptionError: the settings are those of another agent, or the task shows images, which only "random" can do without.
    """
    usual = preset("default", name)
    settings = settings or usual
    if name == "random":
        from bricksrl.agents.random import RandomAgent

        return RandomAgent(action_size)
    if getattr(task, "camera", None) is not None:
        raise DescriptionError(f"{name} cannot learn from the images of this task yet; take another task, or the agent 'random'")
    if type(settings) is not type(usual):
        raise DescriptionError(
            f"the agent {name} has {type(usual).__name__}, not {type(settings).__name__}; take preset('default', '{name}')"
        )
    if isinstance(settings, TD3Settings):
        from bricksrl.agents.td3 import TD3Agent

        return TD3Agent(layout, action_size, settings, task)
    if isinstance(settings, CrossQSettings):
        from bricksrl.agents.crossq import CrossQAgent

        return CrossQAgent(layout, action_size, settings, task)
    from bricksrl.agents.sac import SACAgent

    return SACAgent(layout, action_size, settings, task)


__all__ = ["AGENTS", "PRESETS", "CrossQSettings", "SACSettings", "Settings", "TD3Settings", "make_agent", "preset"]
