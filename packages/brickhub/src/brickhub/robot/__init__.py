"""Descriptions of robots: the single source of their ports, motors and sensors."""

from __future__ import annotations

from brickhub.robot.bench import BENCH
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

__all__ = [
    "BENCH",
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
]
