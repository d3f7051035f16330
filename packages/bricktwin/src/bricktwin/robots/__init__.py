"""Descriptions of robots: the single source of their ports, motors and sensors."""

from __future__ import annotations

from brickhub.errors import UnknownNameError
from brickhub.robot.bench import BENCH
from bricktwin.robots.robo_arm import ROBO_ARM
from bricktwin.robots.scout import SCOUT
from brickhub.robot.spec import (
    Chassis,
    Direction,
    DriveBase,
    HubKind,
    HubModel,
    Motor,
    MotorKind,
    Mount,
    PoweredUpSensor,
    Robot,
    Sensor,
    SensorKind,
    UltrasonicSensor,
)
from bricktwin.robots.two_wheeler import TWO_WHEELER
from bricktwin.robots.walker import WALKER

ROBOTS = {robot.name: robot for robot in (TWO_WHEELER, SCOUT, WALKER, ROBO_ARM, BENCH)}


def get(name: str) -> Robot:
    """The robot of that name. Raises UnknownNameError if there is no such robot."""
    try:
        return ROBOTS[name]
    except KeyError:
        raise UnknownNameError(f"there is no robot '{name}'; choose one of {', '.join(sorted(ROBOTS))}") from None


__all__ = [
    "BENCH",
    "ROBOTS",
    "ROBO_ARM",
    "SCOUT",
    "TWO_WHEELER",
    "WALKER",
    "Chassis",
    "Direction",
    "DriveBase",
    "HubKind",
    "HubModel",
    "Motor",
    "MotorKind",
    "Mount",
    "PoweredUpSensor",
    "Robot",
    "Sensor",
    "SensorKind",
    "UltrasonicSensor",
    "get",
]
