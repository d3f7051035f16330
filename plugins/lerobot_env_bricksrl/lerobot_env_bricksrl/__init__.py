"""Environments of BricksRL for LeRobot's commands, which find this package by its name:
``--env.type=bricksrl``."""

import gymnasium

from lerobot_env_bricksrl.config import GYM_ID, BricksEnvConfig
from lerobot_env_bricksrl.env import BricksEnv

gymnasium.register(GYM_ID, entry_point=BricksEnv)

__all__ = ["BricksEnv", "BricksEnvConfig"]
