"""Motors as LEGO makes them: what a twin's actuators do, apart from what the hub's firmware
believes of them.

The curve of a motor is the straight line between its free speed and its stall. LEGO's sheets give a
third point, under load, that is not on the line of the other two: ours misses all three by the same
share, 4 % (medium) and 5 % (large). Motors without a sheet have the curves that the Pybricks
authors measured and their firmware stores; so have all motors their friction and inertia. Those of
EV3 have the constants from which these curves were computed, as their firmware stores them for
steps of another length than it makes.
"""

import functools
import math
from dataclasses import dataclass

from brickhub.robot import MotorKind
from brickhub.virtual.bench_motor import CONSTANTS
from brickhub.virtual.firmware.motor_model import (
    MOTOR_TYPES,
    PRESCALE_ACCELERATION,
    PRESCALE_CURRENT,
    PRESCALE_SPEED,
    PRESCALE_TORQUE,
    PRESCALE_VOLTAGE,
)

SHEET_V = 7.2
"""Voltage of LEGO's data sheets."""
LIMIT_A = 1.4
"""Largest current of a port; an estimate: the largest that LEGO's sheets state for a motor, the
large one's at its stall."""
_EV3_LIMIT_A = 1.63
"""Likewise of an EV3 Brick: that of its large motor at its stall at 9 V; nobody has published one
of the brick's."""
PLAY_DEG = 2.5
"""Play between a motor of SPIKE and what it drives, to either side."""
_EV3_PLAY_DEG = {
    # 3 degrees at the hub in all, says robotics.benedettelli.com, where the medium motor has almost
    # none: its gears are planetary.
    MotorKind.EV3_LARGE: 1.5,
    MotorKind.EV3_MEDIUM: 0.25,
    MotorKind.NXT: 1.5,
}
RAD_S_PER_RPM = math.pi / 30


@dataclass(frozen=True)
class MotorSheet:
    """Data of a motor at 7.2 V, each speed within 15 % as LEGO says.

    Attributes:
        free_rpm: speed without load.
        loaded_rpm, load_nm: speed at the torque of the best efficiency.
        stall_nm: torque at standstill.
        ohm: resistance of the winding.
    """

    free_rpm: float
    loaded_rpm: float
    load_nm: float
    stall_nm: float
    ohm: float

    def line(self) -> tuple[float, float]:
        """Free speed (rad/s) and stall torque (Nm) of the straight line that misses the three
        points by the same share: both are ``share`` times the sheet's, and the loaded speed ``2 -
        share`` times."""
        # With both ends times `share`, the line's speed at the load is `share * free_rpm -
        # at_load_rpm`. Setting that equal to `(2 - share) * loaded_rpm` gives this share.
        at_load_rpm = self.free_rpm * self.load_nm / self.stall_nm
        both_rpm = self.free_rpm + self.loaded_rpm
        share = (2.0 * self.loaded_rpm + at_load_rpm) / both_rpm
        free_rad_s = share * self.free_rpm * RAD_S_PER_RPM
        stall_nm = share * self.stall_nm
        return free_rad_s, stall_nm


SHEETS = {
    "spike-medium": MotorSheet(
        free_rpm=185.0,
        loaded_rpm=135.0,
        load_nm=0.035,
        stall_nm=0.18,
        ohm=10.7,
    ),
    "spike-large": MotorSheet(
        free_rpm=175.0,
        loaded_rpm=135.0,
        load_nm=0.08,
        stall_nm=0.25,
        ohm=SHEET_V / 1.4,
    ),
}
"""LEGO Education's data sheets of 45603 (medium; its resistance is of Pybricks' curve) and 45602
(large; 1.4 A at its stall)."""


@dataclass(frozen=True)
class MotorConstants:
    """Constants of a motor with its gear train, at its shaft. Inductance is neglected: it decays in
    a millisecond.

    Attributes:
        torque_nm_v: stall torque per volt.
        drag_nm_s: loss of torque per rad/s, by back-EMF.
        inertia_kg_m2: inertia of the rotor, through the gears.
        friction_nm: dry friction.
        ohm: resistance of the winding.
        limit_a: largest current that its port gives it.
        play_share: play of its gears, as a share of that of a SPIKE motor.
    """

    torque_nm_v: float
    drag_nm_s: float
    inertia_kg_m2: float
    friction_nm: float
    ohm: float
    limit_a: float = LIMIT_A
    play_share: float = 1.0

    @property
    def torque_nm_a(self) -> float:
        """Torque per ampere."""
        return self.torque_nm_v * self.ohm


@functools.cache
def motor_constants(kind: MotorKind) -> MotorConstants:
    """Constants of a kind of motor: by LEGO's sheet if there is one, else by Pybricks' curve
    (``servo_settings.c`` v4) or, of EV3's, by what that was made from."""
    if kind in CONSTANTS:
        return _ev3_constants(kind)
    model = MOTOR_TYPES[kind].model
    # The firmware counts mdeg and uNm, but here are rad and Nm.
    per_rad = 180.0 / math.pi * 1e-3
    torque_nm_v = PRESCALE_VOLTAGE / model.torque_by_voltage * 1e-3
    drag_nm_s = PRESCALE_SPEED / model.torque_by_speed * per_rad
    friction_nm = model.friction_unm * 1e-6
    ohm = _blocked_ohm(kind)
    sheet = SHEETS.get(kind.model.like or kind.value)
    if sheet is not None:
        free_rad_s, stall_nm = sheet.line()
        # A sheet gives the torque at the shaft, which is what friction has left over, so the
        # friction is added.
        torque_nm_v = (stall_nm + friction_nm) / SHEET_V
        drag_nm_s = stall_nm / free_rad_s
        ohm = sheet.ohm
    inertia_kg_m2 = PRESCALE_ACCELERATION / model.torque_by_acceleration * per_rad
    return MotorConstants(
        torque_nm_v,
        drag_nm_s,
        inertia_kg_m2,
        friction_nm,
        ohm,
    )


def _ev3_constants(kind: MotorKind) -> MotorConstants:
    constants = CONSTANTS[kind]
    torque_nm_v = constants.torque_nm_a / constants.resistance_ohm
    return MotorConstants(
        torque_nm_v,
        torque_nm_v * constants.emf_v_s,
        constants.inertia_kg_m2,
        constants.friction_unm * 1e-6,
        constants.resistance_ohm,
        _EV3_LIMIT_A,
        _EV3_PLAY_DEG[kind] / PLAY_DEG,
    )


def _blocked_ohm(kind: MotorKind) -> float:
    """Resistance of a winding by Pybricks' curve: voltage by current in the state in which a torque
    keeps the speed at 0."""
    model = MOTOR_TYPES[kind].model
    # A current (0.1 mA), a voltage (mV) and a torque (uNm) contribute to the next step as follows:
    # next speed = a * current + b * voltage + c * torque
    a = PRESCALE_CURRENT / model.speed[1]
    b = PRESCALE_VOLTAGE / model.speed[2]
    c = PRESCALE_TORQUE / model.speed[3]
    # next current = d * current + e * voltage + f * torque
    d = PRESCALE_CURRENT / model.current[1]
    e = PRESCALE_VOLTAGE / model.current[2]
    f = PRESCALE_TORQUE / model.current[3]
    # At rest the next speed is 0 and the next current equals the present one, which eliminates the
    # torque.
    by_voltage = e - b * f / c
    by_current = 1.0 - d + a * f / c
    current_per_mv = by_voltage / by_current
    # 1 mV / 0.1 mA is 10 ohm.
    return 10.0 / current_per_mv
