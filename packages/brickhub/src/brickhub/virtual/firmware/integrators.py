"""Integrators of position and speed errors, each with anti-windup and stall detection."""

from __future__ import annotations

from math import trunc

from brickhub.virtual.firmware.settings import ControlSettings

LOOPS_PER_S = 200


class PositionIntegrator:
    """Integral of the position error; a pause also stops the trajectory's clock."""

    def __init__(self, settings: ControlSettings, time: int) -> None:
        self._settings = settings
        self.integral = 0
        self.running = True
        self.pause_began = time
        self._paused_total = 0

    def trajectory_time(self, time: int) -> int:
        return (time if self.running else self.pause_began) - self._paused_total

    def pause(self, time: int) -> None:
        if self.running:
            self.running = False
            self.pause_began = time

    def resume(self, time: int) -> None:
        if not self.running:
            self.running = True
            self._paused_total += time - self.pause_began

    def update(self, error: int, target_error: int) -> int:
        """Add the error of one control step, unless it winds up, and return the integral (mdeg s)."""
        s, integral = self._settings, self.integral
        change = trunc(error / LOOPS_PER_S)
        shrinks = abs(integral + change) < abs(integral)
        if not shrinks:
            if not self.running:
                return integral
            rate = s.integral_rate
            if not -rate <= error <= rate:
                change = trunc((rate if error > 0 else -rate) / LOOPS_PER_S)
                shrinks = abs(integral + change) < abs(integral)
        if shrinks or s.integral_deadzone <= abs(target_error) <= s.saturation_error * 2:
            integral, limit = integral + change, s.max_integral
            self.integral = integral = limit if integral > limit else -limit if integral < -limit else integral
        return integral

    def is_stalled(self, time: int, speed: int, reference_speed: int) -> bool:
        if self.running:
            limit = self._settings.max_integral
            if limit == 0 or -limit < self.integral < limit:
                return False
        return _stalls(self._settings, self.pause_began, time, speed, reference_speed)


class SpeedIntegrator:
    """Integral of the speed error: a difference of positions."""

    def __init__(self, settings: ControlSettings) -> None:
        self._settings = settings
        self.running = True
        self.pause_began = 0
        self._paused_error = 0
        self._error_at_resume = 0

    def error(self, position_error: int) -> int:
        return self._paused_error + (position_error - self._error_at_resume if self.running else 0)

    def pause(self, time: int, position_error: int) -> None:
        if self.running:
            self.running = False
            self._paused_error += position_error - self._error_at_resume
            self.pause_began = time

    def resume(self, position_error: int) -> None:
        if not self.running:
            self.running = True
            self._error_at_resume = position_error

    def is_stalled(self, time: int, speed: int, reference_speed: int) -> bool:
        return not self.running and _stalls(self._settings, self.pause_began, time, speed, reference_speed)


def _stalls(s: ControlSettings, since: int, time: int, speed: int, reference_speed: int) -> bool:
    if reference_speed < 0:
        reference_speed, speed = -reference_speed, -speed
    if reference_speed != 0 and speed > s.stall_speed:
        return False
    return time - since >= s.stall_time
