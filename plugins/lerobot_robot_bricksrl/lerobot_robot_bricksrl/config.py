"""Configurations, by the names that LeRobot's command line has for them."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.robots.config import RobotConfig
from lerobot.teleoperators.config import TeleoperatorConfig


@RobotConfig.register_subclass("bricksrl")
@dataclass(kw_only=True)
class BricksRobotConfig(RobotConfig):
    """A robot with the commands and channels of an environment.

    Attributes:
        env: environment of BricksRL, or a task of your own: ``my_task.py:TASK``.
        hub: "virtual", "ble", "ble:NAME", "usb".
        realtime: let a virtual robot take as long as a real one.
        seed: of a virtual robot; ``None`` for another one every time.
    """

    env: str = "Walker-v0"
    hub: str = "virtual"
    realtime: bool = False
    seed: int | None = None


@RobotConfig.register_subclass("bricksrl_walker")
@dataclass(kw_only=True)
class BricksWalkerConfig(BricksRobotConfig):
    """The Walker."""

    env: str = "Walker-v0"


@RobotConfig.register_subclass("bricksrl_two_wheeler")
@dataclass(kw_only=True)
class BricksTwoWheelerConfig(BricksRobotConfig):
    """The 2Wheeler."""

    env: str = "RunAway-v0"


@RobotConfig.register_subclass("bricksrl_robo_arm")
@dataclass(kw_only=True)
class BricksRoboArmConfig(BricksRobotConfig):
    """The RoboArm."""

    env: str = "RoboArm-v0"


@dataclass(kw_only=True)
class _HandConfig(TeleoperatorConfig):
    """A teleoperator of a robot with the commands of an environment."""

    env: str = "Walker-v0"


@TeleoperatorConfig.register_subclass("bricksrl_keyboard")
@dataclass(kw_only=True)
class BricksKeyboardConfig(_HandConfig):
    """Two keys for each command, in the terminal."""


@TeleoperatorConfig.register_subclass("bricksrl_gamepad")
@dataclass(kw_only=True)
class BricksGamepadConfig(_HandConfig):
    """A stick for each command."""


@TeleoperatorConfig.register_subclass("bricksrl_random")
@dataclass(kw_only=True)
class BricksRandomConfig(_HandConfig):
    """Uniformly random commands, for trying out."""

    seed: int = 0
