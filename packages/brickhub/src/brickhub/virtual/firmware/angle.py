"""Angles as the firmware stores them: whole turns of a motor plus millidegrees (``pbio/angle.c``,
v4).

The two parts may differ in sign; they are rounded and halved separately.
"""

import struct
from math import trunc

from brickhub.virtual.firmware.trajectory import TURN_MDEG

Angle = tuple[int, int]
"""Turns and mdeg."""

_SINGLE = struct.Struct("<f")


def single(value: float) -> float:
    """The nearest 32-bit float."""
    # A hub computes in 32 bits and Python in 64. Only packing and unpacking gives the hub's
    # rounding.
    packed = _SINGLE.pack(value)
    return float(_SINGLE.unpack(packed)[0])


def split(mdeg: int) -> Angle:
    """Turns and rest of an angle in mdeg."""
    turns = trunc(mdeg / TURN_MDEG)
    rest_mdeg = mdeg - turns * TURN_MDEG
    return turns, rest_mdeg


def to_mdeg(angle: Angle) -> int:
    """The angle in mdeg."""
    turns, mdeg = angle
    return turns * TURN_MDEG + mdeg


def difference(a: Angle, b: Angle) -> Angle:
    """The angle ``a - b`` (``pbio_angle_diff``)."""
    turns = a[0] - b[0]
    mdeg = a[1] - b[1]
    return _normalized(turns, mdeg)


def mean(a: Angle, b: Angle) -> Angle:
    """The angle half way between two (``pbio_angle_avg``)."""
    turns, mdeg = _normalized(a[0] + b[0], a[1] + b[1])
    half_turns = trunc(turns / 2)
    # Half of an odd number of turns is no whole number of them: it goes into the millidegrees,
    # which are halved on their own. Halving the sum in mdeg would round differently.
    odd_turns = turns - 2 * half_turns
    half_mdeg = trunc(mdeg / 2)
    return half_turns, half_mdeg + odd_turns * TURN_MDEG // 2


def from_unit(value: int, steps_per_unit: int) -> Angle:
    """The angle from the program's units (deg or mm)."""
    # With more steps in a unit than in a turn, no number of units is a whole turn: the firmware
    # leaves the turns alone then (``pbio_angle_from_low_res``).
    turns = 0
    if steps_per_unit <= TURN_MDEG:
        units_per_turn = TURN_MDEG // steps_per_unit
        turns = trunc(value / units_per_turn)
    rest_mdeg = value * steps_per_unit - turns * TURN_MDEG
    return turns, rest_mdeg


def to_unit(angle: Angle, steps_per_unit: int) -> int:
    """The angle in the program's units: turns truncated, the rest rounded."""
    turns, mdeg = angle
    # Adding half a unit away from zero before the division truncates makes it round to the nearest
    # (`pbio_angle_to_low_res`).
    half_unit = trunc(steps_per_unit / 2)
    if mdeg < 0:
        half_unit = -half_unit
    units_of_turns = trunc(turns * TURN_MDEG / steps_per_unit)
    units_of_rest = trunc((mdeg + half_unit) / steps_per_unit)
    return units_of_turns + units_of_rest


def to_unit_float(angle: Angle, steps_per_unit: int) -> float:
    """The angle in the program's units, in single precision."""
    turns, mdeg = angle
    # Each operation is rounded to 32 bits, as by the hub's processor.
    units_per_turn = single(TURN_MDEG / steps_per_unit)
    units_of_turns = single(turns * units_per_turn)
    units_of_rest = single(mdeg / steps_per_unit)
    return single(units_of_turns + units_of_rest)


def _normalized(turns: int, mdeg: int) -> Angle:
    # Turns are taken one at a time and with ">", as `pbio_angle_flush` does: exactly one turn stays
    # in the millidegrees, and the sign of the rest is kept. `divmod` would decide both otherwise.
    while mdeg > TURN_MDEG:
        turns = turns + 1
        mdeg = mdeg - TURN_MDEG
    while mdeg < -TURN_MDEG:
        turns = turns - 1
        mdeg = mdeg + TURN_MDEG
    return turns, mdeg
