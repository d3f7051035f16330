"""Descriptions of robots: the single source of their ports, motors and sensors."""

from brickhub.robot.hardware import AnyHub, HubKind, HubModel, KitKind, MotorKind, Sense, SensorKind
from brickhub.robot.spec import (
    BENCH,
    Chassis,
    Direction,
    DriveBase,
    Motor,
    Mount,
    PoweredUpSensor,
    Robot,
    Sensor,
    UltrasonicSensor,
)

__all__ = [
    "BENCH",
    "AnyHub",
    "Chassis",
    "Direction",
    "DriveBase",
    "HubKind",
    "HubModel",
    "KitKind",
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
