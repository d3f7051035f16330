"""Agents: what decides and learns. `make_agent` makes one by name; torch is loaded only then."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from bricksrl.agents.image_presets import ImageSACSettings, ImageTD3Settings
from bricksrl.agents.presets import (
    AGENTS,
    PRESETS,
    ACTSettings,
    BCSettings,
    CQLSettings,
    CrossQSettings,
    IQLSettings,
    SACSettings,
    Settings,
    TD3BCSettings,
    TD3Settings,
    preset,
)
from bricksrl.errors import DescriptionError

if TYPE_CHECKING:
    from bricksrl.agents.agent import Agent
    from bricksrl.agents.layout import ObservationLayout
    from bricksrl.envs.task import Task

_CLASSES = {
    **dict.fromkeys(("sac", "droq", "redq"), "sac:SACAgent"),
    "td3": "td3:TD3Agent",
    "crossq": "crossq:CrossQAgent",
    "bc": "offline_bc:BCAgent",
    "act": "offline_act:ACTAgent",
    "iql": "offline_iql:IQLAgent",
    "cql": "offline_cql:CQLAgent",
    "td3bc": "offline_td3bc:TD3BCAgent",
}


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
    made: Agent = _class_of(name)(layout, action_size, settings, task)
    return made


def _make_image_agent(
    layout: ObservationLayout, side_px: int, action_size: int, settings: ImageSACSettings | ImageTD3Settings
) -> Agent:
    if isinstance(settings, ImageSACSettings):
        from bricksrl.agents.image_sac import ImageSACAgent

        return ImageSACAgent(layout, side_px, action_size, settings)
    from bricksrl.agents.image_td3 import ImageTD3Agent

    return ImageTD3Agent(layout, side_px, action_size, settings)


def _class_of(name: str) -> Any:
    """The class of an agent that learns; importing it loads torch."""
    place, _, kind = _CLASSES[name].partition(":")
    return getattr(importlib.import_module(f"bricksrl.agents.{place}"), kind)


__all__ = [
    "AGENTS",
    "PRESETS",
    "ACTSettings",
    "BCSettings",
    "CQLSettings",
    "CrossQSettings",
    "IQLSettings",
    "ImageSACSettings",
    "ImageTD3Settings",
    "SACSettings",
    "Settings",
    "TD3BCSettings",
    "TD3Settings",
    "make_agent",
    "preset",
]
