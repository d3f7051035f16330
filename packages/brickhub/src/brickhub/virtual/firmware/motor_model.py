"""Motor models of the firmware: discrete linear systems with friction, in steps of 5 ms.

Figures: motor curves measured by Pybricks, as stored in the firmware (``servo_settings.c``, v4). Each entry is a denominator:
``PRESCALE[column] * value / entry`` is the contribution of a column to the next state.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import trunc

from brickhub.robot import MotorKind

PRESCALE_SPEED = 858
PRESCALE_ACCELERATION = 85
PRESCALE_CURRENT = 71_582
PRESCALE_VOLTAGE = 178_956
PRESCALE_TORQUE = 2_147
MAX_SPEED = 2_500_000
MAX_ACCELERATION = 25_000_000
MAX_CURRENT = 30_000
MAX_VOLTAGE_MV = 12_000
MAX_TORQUE_UNM = 1_000_000


@dataclass(frozen=True, slots=True)
class ObserverModel:
    """Rows (angle, speed, current) by columns (speed, current, voltage, torque), then the inverse relations."""

    angle: tuple[int, int, int, int]
    speed: tuple[int, int, int, int]
    current: tuple[int, int, int, int]
    voltage_by_torque: int
    torque_by_voltage: int
    torque_by_speed: int
    torque_by_acceleration: int
    friction_unm: int

    def voltage_mv(self, torque_unm: int) -> int:
        return trunc(PRESCALE_TORQUE * _clamp(torque_unm, MAX_TORQUE_UNM) / self.voltage_by_torque)

    def torque_unm(self, voltage_mv: int) -> int:
        return trunc(PRESCALE_VOLTAGE * _clamp(voltage_mv, MAX_VOLTAGE_MV) / self.torque_by_voltage)

    def drive_mv(self, torque_unm: int, speed: int, acceleration: int, limit_unm: int = MAX_TORQUE_UNM) -> int:
        """Voltage for a torque plus the feedforward of a reference; their sum is limited, to at most MAX_TORQUE_UNM."""
        torque = torque_unm + self.feedforward_unm(speed, acceleration)
        torque = limit_unm if torque > limit_unm else -limit_unm if torque < -limit_unm else torque
        return trunc(PRESCALE_TORQUE * torque / self.voltage_by_torque)

    def feedforward_unm(self, speed: int, acceleration: int) -> int:
        """Torque to follow a reference: half the friction, back-EMF, inertia."""
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
        return forward if -MAX_TORQUE_UNM <= forward <= MAX_TORQUE_UNM else _clamp(forward, MAX_TORQUE_UNM)


@dataclass(frozen=True, slots=True)
class MotorType:
    """Properties of a kind of motor in the firmware.

    Attributes:
        precision_deg: position tolerance, which determines the gains.
        observer_gain: feedback of the observer for small errors, mV/deg.
        low_kp_speed_deg_s: slower commands use a reduced position gain.
    """

    model: ObserverModel
    max_speed_deg_s: int
    observer_gain: int
    precision_deg: int
    low_kp_speed_deg_s: int
    max_voltage_mv: int = 9000


def _clamp(value: int, limit: int) -> int:
    return limit if value > limit else -limit if value < -limit else value


_S_ANGULAR = ObserverModel(
    angle=(179217, 1950303, 5654927, -425928),
    speed=(956, 7666, 11702, -1085),
    current=(-249247, -9356019, 349105, 383927),
    voltage_by_torque=22334,
    torque_by_voltage=17203,
    torque_by_speed=12282,
    torque_by_acceleration=35129,
    friction_unm=9182,
)
_M_ANGULAR = ObserverModel(
    angle=(177194, 2407354, 7431528, -919183),
    speed=(934, 8311, 14444, -2332),
    current=(-165023, 1058029, 225610, 629020),
    voltage_by_torque=47606,
    torque_by_voltage=8071,
    torque_by_speed=5903,
    torque_by_acceleration=16163,
    friction_unm=21413,
)
_L_ANGULAR = ObserverModel(
    angle=(174943, 8368268, 13442903, -3690545),
    speed=(904, 26508, 25105, -9310),
    current=(-58045, 396164, 86900, 975141),
    voltage_by_torque=133763,
    torque_by_voltage=2872,
    torque_by_speed=1919,
    torque_by_acceleration=3997,
    friction_unm=23239,
)
_INTERACTIVE = ObserverModel(
    angle=(179110, 7311289, 4603893, -728461),
    speed=(941, 35750, 10967, -1850),
    current=(-316164, -12014584, 355664, 668004),
    voltage_by_torque=32225,
    torque_by_voltage=11923,
    torque_by_speed=10599,
    torque_by_acceleration=20588,
    friction_unm=11227,
)
_TECHNIC_L = ObserverModel(
    angle=(175977, 5728019, 6164994, -1377701),
    speed=(912, 22787, 12888, -3482),
    current=(-159828, -44152415, 142828, 794862),
    voltage_by_torque=62889,
    torque_by_voltage=6110,
    torque_by_speed=6837,
    torque_by_acceleration=10751,
    friction_unm=26430,
)
_TECHNIC_XL = ObserverModel(
    angle=(176559, 8098298, 5471477, -1282598),
    speed=(916, 35736, 12148, -3244),
    current=(-175173, -7606150, 156891, 729279),
    voltage_by_torque=55617,
    torque_by_voltage=6908,
    torque_by_speed=7713,
    torque_by_acceleration=11578,
    friction_unm=12893,
)
_TYPES = {
    "spike-small": MotorType(_S_ANGULAR, 620, 30, 11, 150, max_voltage_mv=6000),
    "spike-medium": MotorType(_M_ANGULAR, 1000, 45, 11, 150),
    "spike-large": MotorType(_L_ANGULAR, 1000, 45, 11, 150),
    "technic-l": MotorType(_TECHNIC_L, 1500, 45, 20, 250),
    "technic-xl": MotorType(_TECHNIC_XL, 1500, 45, 20, 250),
    "interactive": MotorType(_INTERACTIVE, 1000, 45, 12, 0),
}
MOTOR_TYPES = {kind: _TYPES[kind.model.like or kind.value] for kind in MotorKind}
