"""The scout: a 2Wheeler with a color sensor that faces the floor in front of its axle."""

from __future__ import annotations

from dataclasses import replace

from brickhub.robot import Mount, PoweredUpSensor, SensorKind
from bricktwin.robots.two_wheeler import TWO_WHEELER

SCOUT = replace(
    TWO_WHEELER,
    name="scout",
    sensors=(*TWO_WHEELER.sensors, PoweredUpSensor("light", "B", SensorKind.COLOR, Mount((56.0, 0.0, 18.0), "down"))),
)
