"""LEGO robots of BricksRL for LeRobot: robots and teleoperators, found by LeRobot's commands."""

from lerobot_robot_bricksrl.config import (
    BricksGamepadConfig,
    BricksKeyboardConfig,
    BricksRandomConfig,
    BricksRoboArmConfig,
    BricksRobotConfig,
    BricksTwoWheelerConfig,
    BricksWalkerConfig,
)
from lerobot_robot_bricksrl.robot import BricksRoboArm, BricksRobot, BricksTwoWheeler, BricksWalker
from lerobot_robot_bricksrl.teleoperator import BricksGamepad, BricksKeyboard, BricksRandom

__all__ = [
    "BricksGamepad",
    "BricksGamepadConfig",
    "BricksKeyboard",
    "BricksKeyboardConfig",
    "BricksRandom",
    "BricksRandomConfig",
    "BricksRoboArm",
    "BricksRoboArmConfig",
    "BricksRobot",
    "BricksRobotConfig",
    "BricksTwoWheeler",
    "BricksTwoWheelerConfig",
    "BricksWalker",
    "BricksWalkerConfig",
]
