"""Robots of this package, each with its building plan."""

from __future__ import annotations

from brickhub.errors import UnknownNameError
from brickhub.robot import BENCH, Robot
from bricktwin.robots.robo_arm import ROBO_ARM
from bricktwin.robots.scout import SCOUT
from bricktwin.robots.two_wheeler import TWO_WHEELER
from bricktwin.robots.walker import WALKER

__all__ = ["BENCH", "ROBOTS", "ROBO_ARM", "SCOUT", "TWO_WHEELER", "WALKER", "get"]

ROBOTS = {robot.name: robot for robot in (TWO_WHEELER, SCOUT, WALKER, ROBO_ARM, BENCH)}


def get(name: str) -> Robot:
    """The robot of that name. Raises UnknownNameError if there is no such robot."""
    try:
        return ROBOTS[name]
    except KeyError:
        raise UnknownNameError(f"there is no robot '{name}'; choose one of {', '.join(sorted(ROBOTS))}") from None
