"""Agents: what decides and learns. `make_agent` makes one by name; torch is loaded only then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bricksrl.agents.image_presets import ImageSACSettings, ImageTD3Settings
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
        DescriptionError: the settings are those of another agent.
    """
    camera = getattr(task, "camera", None)
    usual = preset("default", name, images=camera is not None)
    settings = settings or usual
    if name == "random":
        from bricksrl.agents.random import RandomAgent

        return RandomAgent(action_size)
    if type(settings) is not type(usual):
        take = f"preset('default', '{name}'{', images=True' if camera is not None else ''})"
        raise DescriptionError(f"the agent {name} has {type(usual).__name__}, not {type(settings).__name__}; take {take}")
    if isinstance(settings, ImageSACSettings | ImageTD3Settings):
        return _make_image_agent(layout, camera.image_px if camera is not None else 0, action_size, settings)
    if isinstance(settings, TD3Settings):
        from bricksrl.agents.td3 import TD3Agent

        return TD3Agent(layout, action_size, settings, task)
    if isinstance(settings, CrossQSettings):
        from bricksrl.agents.crossq import CrossQAgent

        return CrossQAgent(layout, action_size, settings, task)
    from bricksrl.agents.sac import SACAgent

    return SACAgent(layout, action_size, settings, task)


def _make_image_agent(
    layout: ObservationLayout, side_px: int, action_size: int, settings: ImageSACSettings | ImageTD3Settings
) -> Agent:
    if isinstance(settings, ImageSACSettings):
        from bricksrl.agents.image_sac import ImageSACAgent

        return ImageSACAgent(layout, side_px, action_size, settings)
    from bricksrl.agents.image_td3 import ImageTD3Agent

    return ImageTD3Agent(layout, side_px, action_size, settings)


__all__ = [
    "AGENTS",
    "PRESETS",
    "CrossQSettings",
    "ImageSACSettings",
    "ImageTD3Settings",
    "SACSettings",
    "Settings",
    "TD3Settings",
    "make_agent",
    "preset",
]
