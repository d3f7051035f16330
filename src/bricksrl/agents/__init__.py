"""Agents: what decides and learns. `make_agent` makes one by name; torch is loaded only then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bricksrl.agents.presets import PRESETS, SACSettings, preset
from bricksrl.errors import UnknownNameError

if TYPE_CHECKING:
    from bricksrl.agents.agent import Agent
    from bricksrl.agents.layout import ObservationLayout

AGENTS = ("sac", "random")


def make_agent(name: str, layout: ObservationLayout, action_size: int, settings: SACSettings | None = None) -> Agent:
    """An agent for observations of that layout and actions ``[action_size]`` in -1..1; ``settings`` concern "sac".

    Raises:
        UnknownNameError: there is no agent of that name.
    """
    if name == "sac":
        from bricksrl.agents.sac import SACAgent

        return SACAgent(layout, action_size, settings or preset("default"))
    if name == "random":
        from bricksrl.agents.random import RandomAgent

        return RandomAgent(action_size)
    raise UnknownNameError(f"there is no agent '{name}'; choose one of {', '.join(AGENTS)}")


__all__ = ["AGENTS", "PRESETS", "SACSettings", "make_agent", "preset"]
