"""Motor models of the firmware, discrete linear systems with friction in steps of 5 ms, and the
observer, whose model tracks the measured angle.

Figures: motor curves measured by Pybricks, as stored in the firmware (``servo_settings.c``, v4).
Each entry is a denominator: ``PRESCALE[column] * value / entry`` is the contribution of a column to
the next state.

The models of EV3's motors are discretised for steps of 10 ms (``motor_data.py``, ``h=0.01``), but
the firmware runs them every 5 ms as all others. So a brick estimates half of the true speed, and so
does this observer. They are no models of the motors themselves.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import trunc
from typing import NamedTuple

from brickhub.robot import MotorKind
from brickhub.virtual.firmware import RefusedError
from brickhub.virtual.firmware.settings import MAX_TORQUE_UNM, ControlSettings

# The firmware's model has only integers of 32 bits. Each quantity is limited to a maximum, and its
# scale is what still fits, (2**31 - 1) // maximum (`pbio/doc/control/model.py`).
MAX_SPEED = 2_500_000
MAX_ACCELERATION = 25_000_000
MAX_CURRENT = 30_000
MAX_VOLTAGE_MV = 12_000
PRESCALE_SPEED = 858
PRESCALE_ACCELERATION = 85
PRESCALE_CURRENT = 71_582
PRESCALE_VOLTAGE = 178_956
PRESCALE_TORQUE = 2_147
_HISTORY = 60
"""Steps of 5 ms of the longest window of ``Motor.speed``, 300 ms."""
_WINDOW_START = -21
"""Place in the history of the angle 20 steps ago, 100 ms: the last one is the present."""
# The observer's feedback is weak for errors of up to 20 degrees, and seven times as strong for
# what is beyond.
_GAIN_THRESHOLD_MDEG = 20_000
_HIGH_GAIN_FACTOR = 7
_FRICTION_CUTOFF = 500
"""Speed in mdeg/s below which dry friction goes through 0 in a straight line, without a jump."""
_STALL_RATIO_PCT = 75
"""Share of the voltage that the feedback has in a motor that stalls; all of it if stuck."""


@dataclass(frozen=True, slots=True)
class ObserverModel:
    """Rows (angle, speed, current) by columns (speed, current, voltage, torque), then the inverse
    relations."""

    angle: tuple[int, int, int, int]
    speed: tuple[int, int, int, int]
    current: tuple[int, int, int, int]
    voltage_by_torque: int
    torque_by_voltage: int
    torque_by_speed: int
    torque_by_acceleration: int
    friction_unm: int

    def voltage_mv(self, torque_unm: int) -> int:
        """Voltage for a torque at rest (``pbio_observer_torque_to_voltage``)."""
        torque = _clamp(torque_unm, MAX_TORQUE_UNM)
        return trunc(PRESCALE_TORQUE * torque / self.voltage_by_torque)

    def torque_unm(self, voltage_mv: int) -> int:
        """Torque of a voltage at rest (``pbio_observer_voltage_to_torque``)."""
        voltage = _clamp(voltage_mv, MAX_VOLTAGE_MV)
        return trunc(PRESCALE_VOLTAGE * voltage / self.torque_by_voltage)

    def drive_mv(
        self,
        torque_unm: int,
        speed: int,
        acceleration: int,
        limit_unm: int = MAX_TORQUE_UNM,
    ) -> int:
        """Voltage for a torque plus the feedforward of a reference; their sum is limited, to at
        most MAX_TORQUE_UNM."""
        torque = torque_unm + self.feedforward_unm(speed, acceleration)
        if torque > limit_unm:
            torque = limit_unm
        elif torque < -limit_unm:
            torque = -limit_unm
        return trunc(PRESCALE_TORQUE * torque / self.voltage_by_torque)

    def feedforward_unm(
        self,
        speed: int,
        acceleration: int,
    ) -> int:
        """Torque to follow a reference: half the friction, back-EMF, inertia."""
        # This runs in each control step of each motor, and most motors hold or cruise. So terms
        # that are 0 are left out, and a clamp is called only where something is to be clamped.
        forward = 0
        if speed:
            half_friction = self.friction_unm // 2
            if not -MAX_SPEED <= speed <= MAX_SPEED:
                speed = _clamp(speed, MAX_SPEED)
            forward = trunc(PRESCALE_SPEED * speed / self.torque_by_speed)
            forward += half_friction if speed > 0 else -half_friction
        if acceleration:
            if not -MAX_ACCELERATION <= acceleration <= MAX_ACCELERATION:
                acceleration = _clamp(acceleration, MAX_ACCELERATION)
            forward += trunc(PRESCALE_ACCELERATION * acceleration / self.torque_by_acceleration)
        if -MAX_TORQUE_UNM <= forward <= MAX_TORQUE_UNM:
            return forward
        return _clamp(forward, MAX_TORQUE_UNM)


@dataclass(frozen=True, slots=True)
class MotorType:
    """Properties of a kind of motor in the firmware.

    Attributes:
        precision_deg: position tolerance, which determines the gains.
        observer_gain: feedback of the observer for small errors, mV/deg.
        low_kp_speed_deg_s: slower commands use a reduced position gain.
        gain_shares: kp, ki and kd as shares of those that follow from the precision, each a
            numerator and a denominator (``pbio_servo_override_settings``).
    """

    model: ObserverModel
    max_speed_deg_s: int
    observer_gain: int
    precision_deg: int
    low_kp_speed_deg_s: int
    max_voltage_mv: int = 9000
    gain_shares: tuple[tuple[int, int], ...] = ((1, 1), (1, 1), (1, 1))


def _clamp(value: int, limit: int) -> int:
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


# Each line is a row of the model's matrix, which the formatter would take apart.
_TYPES = {
    "spike-small": MotorType(ObserverModel(
        (179217, 1950303, 5654927, -425928), (956, 7666, 11702, -1085),
        (-249247, -9356019, 349105, 383927),
        22334, 17203, 12282, 35129, 9182,
    ), 620, 30, 11, 150, max_voltage_mv=6000,),
    "spike-medium": MotorType(ObserverModel(
        (177194, 2407354, 7431528, -919183), (934, 8311, 14444, -2332),
        (-165023, 1058029, 225610, 629020),
        47606, 8071, 5903, 16163, 21413,
    ), 1000, 45, 11, 150,),
    "spike-large": MotorType(ObserverModel(
        (174943, 8368268, 13442903, -3690545), (904, 26508, 25105, -9310),
        (-58045, 396164, 86900, 975141),
        133763, 2872, 1919, 3997, 23239,
    ), 1000, 45, 11, 150,),
    "technic-l": MotorType(ObserverModel(
        (175977, 5728019, 6164994, -1377701), (912, 22787, 12888, -3482),
        (-159828, -44152415, 142828, 794862),
        62889, 6110, 6837, 10751, 26430,
    ), 1500, 45, 20, 250,),
    "technic-xl": MotorType(ObserverModel(
        (176559, 8098298, 5471477, -1282598), (916, 35736, 12148, -3244),
        (-175173, -7606150, 156891, 729279),
        55617, 6908, 7713, 11578, 12893,
    ), 1500, 45, 20, 250,),
    "interactive": MotorType(ObserverModel(
        (179110, 7311289, 4603893, -728461), (941, 35750, 10967, -1850),
        (-316164, -12014584, 355664, 668004),
        32225, 11923, 10599, 20588, 11227,
    ), 1200, 45, 12, 0,),
    "move-hub": MotorType(ObserverModel(
        (176283, 7437051, 5022928, -966059), (913, 32807, 11156, -2442),
        (-202833, -8118383, 157720, 636829),
        45536, 8438, 10851, 15357, 24835,
    ), 1500, 45, 20, 250,),
    "ev3-large": MotorType(ObserverModel(
        (88290, 5755278, 5240040, -1887437), (921, 44574, 21582, -9555),
        (-61626, 21338185, 106130, 861143),
        107106, 3587, 2083, 1965, 16476,
    ), 800, 30, 10, 100, gain_shares=((2, 3), (2, 3), (1, 6)),),
    "ev3-medium": MotorType(ObserverModel(
        (89465, 1568301, 2220112, -399652), (950, 12886, 9410, -2034),
        (-197440, -5095199, 209263, 546357),
        49219, 7806, 7365, 9355, 24593,
    ), 1200, 45, 10, 0, gain_shares=((1, 3), (1, 2), (1, 10)),),
}  # fmt: skip
MOTOR_TYPES = {kind: _TYPES[kind.model.like or kind.value] for kind in MotorKind}
"""Properties by kind of motor; some kinds have those of another, as in the firmware."""


class ObserverSettings(NamedTuple):
    """Settings that a program may tune, in the firmware's order (``pbio_observer_settings_t``).

    A motor stalls while it is slower than ``stall_speed`` (mdeg/s) and the feedback exceeds
    ``stall_ratio_pct`` of a voltage above ``negligible_mv``; after ``stall_time`` (ticks of 0.1 ms)
    it counts as stalled. The feedback has ``gain_low`` (mV/deg) up to ``gain_threshold`` (mdeg) and
    ``gain_high`` beyond. Friction decreases to 0 below ``friction_cutoff`` (mdeg/s).
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
        angle, speed, current: state of the model, mdeg, mdeg/s and 0.1 mA.
        history: angles measured at the last steps, mdeg.
        measured_speed: mean of the measured speed over 100 ms, mdeg/s.
        stalled_since: time of the first of the steps in which the motor stalls; after the stall
            time it counts as stalled.
    """

    def __init__(
        self,
        motor: MotorType,
        settings: ControlSettings,
    ) -> None:
        model = motor.model
        gain = motor.observer_gain
        # A feedback that friction alone explains is no sign of a load.
        friction_mv = model.voltage_mv(model.friction_unm)
        self.tune(
            ObserverSettings(
                stall_speed=settings.stall_speed,
                stall_time=settings.stall_time,
                negligible_mv=trunc(friction_mv * 5 / 2),
                stall_ratio_pct=_STALL_RATIO_PCT,
                gain_low=gain,
                gain_high=gain * _HIGH_GAIN_FACTOR,
                gain_threshold=_GAIN_THRESHOLD_MDEG,
                friction_cutoff=_FRICTION_CUTOFF,
            )
        )
        # One tuple of all nine entries is unpacked at once in a step. The column of the torque is
        # apart, because friction is nearly always the full one, whose effect is computed here.
        self._rows = *model.angle[:3], *model.speed[:3], *model.current[:3]
        self._friction_unm = model.friction_unm
        self._friction_columns = model.angle[3], model.speed[3], model.current[3]
        self._full_friction = self._friction(model.friction_unm)
        self.history: deque[int] = deque(maxlen=_HISTORY + 1)
        self.measured_speed = 0
        self.reset(0)

    def reset(self, angle: int) -> None:
        """Restart at rest at a measured angle (mdeg). As in the firmware, the measured speed stays
        until the next step."""
        self.angle = angle
        self.speed = 0
        self.current = 0
        self.stalled_since: int | None = None
        self.history.clear()
        self.history.extend([angle] * (_HISTORY + 1))

    def tune(self, settings: ObserverSettings) -> None:
        """Use these settings from now on."""
        self.settings = settings
        # Settings become attributes of the observer itself, because a step reads all of them and
        # each lookup counts.
        self._stall_speed = settings.stall_speed
        self._stall_time = settings.stall_time
        self._negligible_mv = settings.negligible_mv
        self._stall_ratio_pct = settings.stall_ratio_pct
        self._gain = settings.gain_low
        self._high_gain = settings.gain_high
        self._threshold = settings.gain_threshold
        # The observer divides by it, and a program may set it to 0.
        self._friction_cutoff = max(settings.friction_cutoff, 1)

    def feedback_mv(self, angle: int) -> int:
        """Voltage that pulls the model towards a measured angle: the effect of unmodelled load."""
        error = angle - self.angle
        threshold = self._threshold
        if -threshold <= error <= threshold:
            return trunc(error * self._gain / 1000)
        # The magnitude is used, as in the firmware, so that both directions round alike.
        beyond = (abs(error) - threshold) * self._high_gain
        voltage = (threshold * self._gain + beyond) // 1000
        voltage = min(voltage, MAX_VOLTAGE_MV)
        return voltage if error > 0 else -voltage

    def update(
        self,
        time: int,
        angle: int,
        voltage_mv: int,
    ) -> None:
        """One 5 ms step with the measured angle and the applied voltage."""
        history = self.history
        history.append(angle)
        self.measured_speed = (angle - history[_WINDOW_START]) * 10
        speed = self.speed
        feedback = self.feedback_mv(angle)
        # The motor stalls if three things are true: the model runs ahead, so that the feedback
        # pulls it back; the motor is slow in the direction of the voltage; and the feedback is
        # large, by itself and for the voltage. The first is false in nearly all steps.
        if (
            voltage_mv * feedback < 0
            and (speed if voltage_mv > 0 else -speed) < self._stall_speed
            and abs(feedback) * 100 > abs(voltage_mv) * self._stall_ratio_pct
            and abs(voltage_mv) > self._negligible_mv
        ):
            if self.stalled_since is None:
                self.stalled_since = time
        else:
            self.stalled_since = None
        # The feedback is added to the applied voltage, which keeps the model at the real motor.
        voltage = voltage_mv + feedback
        if voltage > MAX_VOLTAGE_MV:
            voltage = MAX_VOLTAGE_MV
        elif voltage < -MAX_VOLTAGE_MV:
            voltage = -MAX_VOLTAGE_MV
        cutoff = self._friction_cutoff
        if -cutoff <= speed <= cutoff:
            slip, friction, drop = self._friction(trunc(abs(speed) * self._friction_unm / cutoff))
        else:
            slip, friction, drop = self._full_friction
        if speed < 0:
            slip = -slip
            friction = -friction
            drop = -drop
        # This is x(k+1) = A x(k) + B u(k), with each product truncated on its own.
        ps = PRESCALE_SPEED * speed
        pc = PRESCALE_CURRENT * self.current
        pv = PRESCALE_VOLTAGE * voltage
        a0, a1, a2, s0, s1, s2, c0, c1, c2 = self._rows
        self.angle += trunc(ps / a0) + trunc(pc / a1) + trunc(pv / a2) + slip
        next_speed = trunc(ps / s0) + trunc(pc / s1) + trunc(pv / s2) + friction
        current = trunc(ps / c0) + trunc(pc / c1) + trunc(pv / c2) + drop
        # Friction brakes a motor to rest, but not beyond.
        if (speed < 0) is not (next_speed < 0):
            next_speed -= friction
        if next_speed > MAX_SPEED:
            next_speed = MAX_SPEED
        elif next_speed < -MAX_SPEED:
            next_speed = -MAX_SPEED
        self.speed = next_speed
        if current > MAX_CURRENT:
            current = MAX_CURRENT
        elif current < -MAX_CURRENT:
            current = -MAX_CURRENT
        self.current = current

    def _friction(self, torque_unm: int) -> tuple[int, int, int]:
        """Changes of angle, speed and current by a torque against the motion."""
        torque = PRESCALE_TORQUE * torque_unm
        angle, speed, current = self._friction_columns
        return trunc(torque / angle), trunc(torque / speed), trunc(torque / current)

    def window_speed(self, window_ms: int) -> int:
        """Mean measured speed over a window, mdeg/s. Raises ValueError for one shorter than a tick
        or longer than 300 ms."""
        # The firmware keeps eight bits of this number of 5 ms steps, rounded.
        ticks = (window_ms + 2) // 5 & 0xFF
        if not 1 <= ticks <= _HISTORY:
            raise RefusedError("the window is out of range")
        turned_mdeg = self.history[-1] - self.history[-1 - ticks]
        return trunc(turned_mdeg * 1000 / (ticks * 5))

    def is_stalled(self, time: int) -> bool:
        if self.stalled_since is None:
            return False
        return time - self.stalled_since > self._stall_time
