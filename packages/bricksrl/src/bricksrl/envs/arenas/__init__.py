"""Arenas: environments of several robots in one world."""

from __future__ import annotations

from bricksrl.envs.arenas.arena_registry import ARENAS, get_arena_task, make_arena

__all__ = ["ARENAS", "get_arena_task", "make_arena"]
