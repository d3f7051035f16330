"""What a controller adds up: position errors and speed errors, each with its anti-windup and its notion of a stall."""

from __future__ import annotations

from bricksrl.twin.firmware.settings import ControlSettings, by_gain

LOOPS_PER_S = 200


class PositionIntegrator:
    """Integral of the position error; pausing it also stops the clock of the trajectory."""

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
        """Add one loop's error where that helps, and return the integral (mdeg s)."""
        s = self._settings
        change = int(error / LOOPS_PER_S)
        shrinks = abs(self.integral + change) < abs(self.integral)
        if self.running or shrinks:
            if not shrinks:
                error = max(-s.integral_rate, min(s.integral_rate, error))
                change = int(error / LOOPS_PER_S)
                shrinks = abs(self.integral + change) < abs(self.integral)
            away = abs(target_error)
            if shrinks or (away >= s.integral_deadzone and away <= by_gain(s.max_torque, s.kp) * 2):
                limit = by_gain(s.max_torque, s.ki)
                self.integral = max(-limit, min(limit, self.integral + change))
        return self.integral

    def is_stalled(self, time: int, speed: int, reference_speed: int) -> bool:
        if self.running:
            if self.integral == 0:
                return False
            limit = by_gain(self._settings.max_torque, self._settings.ki)
            if limit == 0 or abs(self.integral) < limit:
                return False
        return _stalls(self._settings, self.pause_began, time, speed, reference_speed)


class SpeedIntegrator:
    """Integral of the speed error, which is a difference of positions."""

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
