"""A hub in simulated time: one clock, the 5 ms control loop of the firmware, and the body that it moves.

Time is a whole number of milliseconds and passes only in :meth:`Machine.advance`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from bricksrl.robots import MotorKind, Robot
from bricksrl.twin.firmware.drive_base import DriveBaseControl
from bricksrl.twin.firmware.servo import Servo
from bricksrl.twin.physics import Physics
from bricksrl.twin.senses import Sense, Sensed

CONTROL_LOOP_MS = 5
# A program that polls without waiting would stand still in simulated time for ever. On a hub each call costs
# some 10 us; here calls are free until there are many of them without a wait.
_FREE_CALLS = 200
_CALLS_PER_MS = 100


class Body(Protocol):
    """The physical half of a virtual robot: what motors turn and sensors see.

    Motor angles are those of the motor's own shaft, clockwise positive, before direction and gears.
    """

    motors: dict[str, MotorKind]
    """Port letter to the kind of motor that is plugged in there."""
    distance_sensors: frozenset[str]
    """Ports with an ultrasonic sensor."""
    battery_mv: int
    physics: Physics
    """The parameters in force, which are drawn anew for each episode where they are random."""

    def reset(self, rng: np.random.Generator) -> None:
        """The human hand: put the robot at the start of an episode."""

    def advance_to(self, time_ms: int) -> None:
        """Integrate the physics up to this simulated time."""

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft as its rotation sensor reports it."""

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        """Apply a voltage to a motor; ``None`` opens the circuit (coast)."""

    def distance_mm(self, port: str) -> int:
        """Reading of an ultrasonic sensor, 40..2000."""

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch and roll as ``hub.imu.tilt`` reports them."""

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub: x forward, y left, z up."""

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub; at rest (0, 0, +9810)."""

    def heading_deg(self) -> float:
        """Integrated rotation about z, clockwise positive, since the start; not wrapped."""


@runtime_checkable
class SensingBody(Protocol):
    """A body with other sensors than those."""

    def sensed(self, port: str, sense: Sense) -> Sensed:
        """What the sensor on this port senses now."""


class Machine:
    """Clock, servos and drive bases of one virtual hub.

    Attributes:
        time_ms: simulated time since the hub was switched on.
        alarm_ms: simulated time at which ``on_alarm`` is called from within :meth:`advance`; ``None`` for never.
    """

    def __init__(self, robot: Robot, body: Body) -> None:
        self.robot = robot
        self.body = body
        self.time_ms = 0
        self.alarm_ms: int | None = None
        self.on_alarm: Callable[[], None] = lambda: None
        self.servos = {port: Servo(kind, port, self) for port, kind in body.motors.items()}
        self.drive_bases: list[DriveBaseControl] = []
        self._calls = 0

    @property
    def time_ticks(self) -> int:
        """Time in the firmware's control ticks of 0.1 ms."""
        return self.time_ms * 10

    def advance(self, duration_ms: int) -> None:
        """Let time pass: physics, control loop, alarm."""
        self._calls = 0
        end_ms = self.time_ms + duration_ms
        while self.time_ms < end_ms:
            self._advance_towards(end_ms)

    def doze(self, duration_ms: int) -> int:
        """Let time pass, but not beyond the next alarm, which may have brought input; returns how long it was."""
        self._calls = 0
        start_ms = self.time_ms
        end_ms = start_ms + duration_ms
        while self.time_ms < end_ms and not self._advance_towards(end_ms):
            pass
        return self.time_ms - start_ms

    def _advance_towards(self, end_ms: int) -> bool:
        """Advance as far as nothing but physics happens, at most to ``end_ms``; whether there was an alarm."""
        time_ms = self.time_ms
        next_ms = time_ms - time_ms % CONTROL_LOOP_MS + CONTROL_LOOP_MS
        stop_ms = next_ms if next_ms < end_ms else end_ms
        alarm_ms = self.alarm_ms
        if alarm_ms is not None and time_ms < alarm_ms < stop_ms:
            stop_ms = alarm_ms
        self.body.advance_to(stop_ms)
        self.time_ms = stop_ms
        if stop_ms == next_ms:
            for base in self.drive_bases:
                base.update()
            for servo in self.servos.values():
                servo.update()
        if self.alarm_ms is None or stop_ms < self.alarm_ms:
            return False
        self.on_alarm()
        return True

    def advance_to_control(self) -> None:
        """Let time pass until the control loop has run once: the grain at which moves end."""
        self.advance(CONTROL_LOOP_MS - self.time_ms % CONTROL_LOOP_MS)

    def charge_call(self) -> None:
        """Count a call that takes no simulated time, so that a polling loop comes to an end."""
        self._calls += 1
        if self._calls > _FREE_CALLS and self._calls % _CALLS_PER_MS == 0:
            calls = self._calls
            self.advance(1)
            self._calls = calls

    def stop_motors(self) -> None:
        """What the firmware does when a program ends: all motors coast, all objects are forgotten."""
        for base in self.drive_bases:
            base.release()
        self.drive_bases.clear()
        for servo in self.servos.values():
            servo.close()
