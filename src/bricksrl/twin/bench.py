"""Motors on the bench: no load, as the firmware's own motor simulation moves them.

The model is that of the firmware's test build (``motor_driver_virtual_simulation.c``, v4): a medium angular motor in
steps of 1 ms with the states angle, speed and current. It uses the same figures for every kind of motor, and so does
this; it also brakes when it coasts.
"""

from __future__ import annotations

import numpy as np

from bricksrl.robots import Robot, UltrasonicSensor
from bricksrl.twin.physics import Physics

_FRICTION_UNM = 21413.268
_FRICTION_FADES_BELOW_MDEG_S = 2000.0
_MAX_DUTY = 10_000


class _BenchMotor:
    """Angle in mdeg, speed in mdeg/s, current in 0.1 mA, voltage in mV."""

    __slots__ = ("angle", "current", "speed", "voltage")

    def __init__(self) -> None:
        self.angle = self.speed = self.current = self.voltage = 0.0

    def step(self) -> None:
        """One millisecond."""
        v, i, u = self.speed, self.current, self.voltage
        torque = _FRICTION_UNM * max(-1.0, min(1.0, v / _FRICTION_FADES_BELOW_MDEG_S))
        self.angle += (
            v * 0.0009981527613056019 + i * 0.001957577848006867 + u * 0.0002818172865566039 + torque * -9.498678309037282e-05
        )
        self.speed = v * 0.994653578576391 + i * 3.640640918794361 + u * 0.815657436669528 + torque * -0.18980175337809
        self.current = (
            v * -0.0021977502690683696 + i * 0.6348769647439378 + u * 0.335291816502189 + torque * 0.0002247101788128779
        )


class BenchBody:
    """A robot that is not assembled: motors turn freely, the hub lies still and level, nothing is in sight."""

    def __init__(self, robot: Robot, battery_mv: int = 7200) -> None:
        self.motors = {motor.port: motor.kind for motor in robot.motors}
        self.distance_sensors = frozenset(s.port for s in robot.sensors if isinstance(s, UltrasonicSensor))
        self.battery_mv = battery_mv
        self.physics = Physics()
        self._motors = {port: _BenchMotor() for port in self.motors}
        self._time_ms = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to put back."""

    def advance_to(self, time_ms: int) -> None:
        while self._time_ms < time_ms:
            for motor in self._motors.values():
                motor.step()
            self._time_ms += 1

    def angle_mdeg(self, port: str) -> int:
        return int(self._motors[port].angle)

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        duty = int((voltage_mv or 0) * _MAX_DUTY / self.battery_mv)
        duty = max(-_MAX_DUTY, min(_MAX_DUTY, duty))
        self._motors[port].voltage = int(duty * self.battery_mv / _MAX_DUTY)

    def distance_mm(self, port: str) -> int:
        return 2000

    def tilt_deg(self) -> tuple[float, float]:
        return 0.0, 0.0

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 9810.0

    def heading_deg(self) -> float:
        return 0.0
