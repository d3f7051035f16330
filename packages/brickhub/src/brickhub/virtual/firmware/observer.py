"""State observer: a motor model that tracks the measured angle."""

from __future__ import annotations

from collections import deque
from math import trunc
from typing import NamedTuple

from brickhub.virtual.firmware.motor_model import (
    MAX_CURRENT,
    MAX_SPEED,
    MAX_VOLTAGE_MV,
    PRESCALE_CURRENT,
    PRESCALE_SPEED,
    PRESCALE_TORQUE,
    PRESCALE_VOLTAGE,
    MotorType,
)
from brickhub.virtual.firmware.trajectory import RefusedError

_WINDOW_START = -21  # 20 ticks of 5 ms ago: 100 ms
_HISTORY = 60  # ticks of the longest window of Motor.speed: 300 ms
_GAIN_THRESHOLD_MDEG = 20_000
_HIGH_GAIN_FACTOR = 7
_FRICTION_CUTOFF = 500
_STALL_RATIO_PCT = 75


class ObserverSettings(NamedTuple):
    """Settings that a program may tune, in the firmware's order (``pbio_observer_settings_t``).

    A motor stalls while it is slower than ``stall_speed`` (mdeg/s) and the feedback exceeds ``stall_ratio_pct`` of a voltage
    above ``negligible_mv``; after ``stall_time`` (ticks of 0.1 ms) it counts as stalled. The feedback has ``gain_low`` (mV/deg)
    up to ``gain_threshold`` (mdeg) and ``gain_high`` beyond. Friction decreases to 0 below ``friction_cutoff`` (mdeg/s).
    """

    stall_speed: int
    stall_time: int
    negligible_mv: int
    stall_ratio_pct: int
    gain_low: int
    gain_high: int
    gain_threshold: int
    friction_cutoff: int


class Observer:
    """Estimates angle and speed of a motor; detects stalls while no controller runs.

    Attributes:
        angle, speed: state of the model, mdeg and mdeg/s.
        measured_speed: mean of the measured speed over 100 ms, mdeg/s.
    """

    def __init__(self, motor: MotorType, stall_speed: int, stall_time: int) -> None:
        model = motor.model
        gain, negligible_mv = motor.observer_gain, trunc(model.voltage_mv(model.friction_unm) * 5 / 2)
        stall = (stall_speed, stall_time, negligible_mv, _STALL_RATIO_PCT)
        self.tune(ObserverSettings(*stall, gain, gain * _HIGH_GAIN_FACTOR, _GAIN_THRESHOLD_MDEG, _FRICTION_CUTOFF))
        self._rows = *model.angle[:3], *model.speed[:3], *model.current[:3]
        self._friction_unm = model.friction_unm
        self._friction_columns = model.angle[3], model.speed[3], model.current[3]
        self._full_friction = self._friction(model.friction_unm)
        self._history: deque[int] = deque(maxlen=_HISTORY + 1)
        self.measured_speed = 0
        self.reset(0)

    def reset(self, angle: int) -> None:
        """Restart at rest at a measured angle (mdeg). As in the firmware, the measured speed stays until the next step."""
        self.angle, self.speed, self._current = angle, 0, 0
        self._stalled_since: int | None = None
        self._history.clear()
        self._history.extend([angle] * (_HISTORY + 1))

    def tune(self, settings: ObserverSettings) -> None:
        """Use these settings from now on."""
        self.settings = settings
        self._stall_speed, self._stall_time, self._negligible_mv, self._stall_ratio_pct, *gains, cutoff = settings
        self._gain, self._high_gain, self._threshold = gains
        self._friction_cutoff = max(cutoff, 1)

    def feedback_mv(self, angle: int) -> int:
        """Voltage that pulls the model towards a measured angle: the effect of unmodelled load."""
        error = angle - self.angle
        threshold = self._threshold
        if -threshold <= error <= threshold:
            return trunc(error * self._gain / 1000)
        beyond = (abs(error) - threshold) * self._high_gain
        voltage = min((threshold * self._gain + beyond) // 1000, MAX_VOLTAGE_MV)
        return voltage if error > 0 else -voltage

    def update(self, time: int, angle: int, voltage_mv: int) -> None:
        """One 5 ms step with the measured angle and the applied voltage."""
        history = self._history
        history.append(angle)
        self.measured_speed = (angle - history[_WINDOW_START]) * 10
        speed, feedback = self.speed, self.feedback_mv(angle)
        if voltage_mv * feedback < 0 and (speed if voltage_mv > 0 else -speed) < self._stall_speed:
            self._check_stall(time, abs(voltage_mv), abs(feedback))
        else:
            self._stalled_since = None
        voltage = voltage_mv + feedback
        voltage = MAX_VOLTAGE_MV if voltage > MAX_VOLTAGE_MV else -MAX_VOLTAGE_MV if voltage < -MAX_VOLTAGE_MV else voltage
        cutoff = self._friction_cutoff
        if -cutoff <= speed <= cutoff:
            slip, friction, drop = self._friction(trunc(abs(speed) * self._friction_unm / cutoff))
        else:
            slip, friction, drop = self._full_friction
        if speed < 0:
            slip, friction, drop = -slip, -friction, -drop
        ps, pc, pv = PRESCALE_SPEED * speed, PRESCALE_CURRENT * self._current, PRESCALE_VOLTAGE * voltage
        a0, a1, a2, s0, s1, s2, c0, c1, c2 = self._rows
        self.angle += trunc(ps / a0) + trunc(pc / a1) + trunc(pv / a2) + slip
        next_speed = trunc(ps / s0) + trunc(pc / s1) + trunc(pv / s2) + friction
        current = trunc(ps / c0) + trunc(pc / c1) + trunc(pv / c2) + drop
        if (speed < 0) is not (next_speed < 0):
            next_speed -= friction  # friction brakes to rest, not beyond
        self.speed = MAX_SPEED if next_speed > MAX_SPEED else -MAX_SPEED if next_speed < -MAX_SPEED else next_speed
        self._current = MAX_CURRENT if current > MAX_CURRENT else -MAX_CURRENT if current < -MAX_CURRENT else current

    def _friction(self, torque_unm: int) -> tuple[int, int, int]:
        """Changes of angle, speed and current by a torque against the motion."""
        torque = PRESCALE_TORQUE * torque_unm
        angle, speed, current = self._friction_columns
        return trunc(torque / angle), trunc(torque / speed), trunc(torque / current)

    def window_speed(self, window_ms: int) -> int:
        """Mean measured speed over a window, mdeg/s. Raises ValueError for one shorter than a tick or longer than 300 ms."""
        ticks = (window_ms + 2) // 5
        if not 1 <= ticks <= _HISTORY:
            raise RefusedError("the window is out of range")
        return trunc((self._history[-1] - self._history[-1 - ticks]) * 1000 / (ticks * 5))

    @property
    def measured_angle(self) -> int:
        """Angle measured at the last step, mdeg."""
        return self._history[-1]

    @property
    def current(self) -> int:
        """The model's current, 0.1 mA."""
        return self._current

    @property
    def is_pushed_back(self) -> bool:
        """Whether the motor stalls now; after the stall time it counts as stalled."""
        return self._stalled_since is not None

    def is_stalled(self, time: int) -> bool:
        return self._stalled_since is not None and time - self._stalled_since > self._stall_time

    def _check_stall(self, time: int, voltage: int, feedback: int) -> None:
        """Detect a stall of a slow motor by the magnitudes of its voltage and the opposing feedback."""
        if feedback * 100 > voltage * self._stall_ratio_pct and voltage > self._negligible_mv:
            if self._stalled_since is None:
                self._stalled_since = time
        else:
            self._stalled_since = None
