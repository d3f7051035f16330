"""Descriptions of robots: the single source of their ports, motors and sensors."""

from __future__ import annotations

from brickhub.robot.bench import BENCH
from brickhub.robot.hardware import HubKind, HubModel, MotorKind, Sense, SensorKind
from brickhub.robot.spec import Chassis, Direction, DriveBase, Motor, Mount, PoweredUpSensor, Robot, Sensor, UltrasonicSensor

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
    "Sense",
    "Sensor",
    "SensorKind",
    "UltrasonicSensor",
]
