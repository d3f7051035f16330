"""Environments as Gymnasium's."""

from __future__ import annotations

from bricksrl.envs.gymnasium.environment import GymnasiumEnv, GymnasiumVectorEnv
from bricksrl.envs.gymnasium.goals import GoalObservation, VectorGoalObservation

__all__ = ["GoalObservation", "GymnasiumEnv", "GymnasiumVectorEnv", "VectorGoalObservation"]
