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
    return float(_SINGLE.unpack(_SINGLE.pack(value))[0])


def split(mdeg: int) -> Angle:
    """Turns and rest of an angle in mdeg."""
    turns = trunc(mdeg / TURN_MDEG)
    return turns, mdeg - turns * TURN_MDEG


def to_mdeg(angle: Angle) -> int:
    """The angle in mdeg."""
    return angle[0] * TURN_MDEG + angle[1]


def difference(a: Angle, b: Angle) -> Angle:
    return _normalized(a[0] - b[0], a[1] - b[1])


def mean(a: Angle, b: Angle) -> Angle:
    turns, mdeg = _normalized(a[0] + b[0], a[1] + b[1])
    half = trunc(turns / 2)
    return half, trunc(mdeg / 2) + (turns - 2 * half) * TURN_MDEG // 2


def from_unit(value: int, steps_per_unit: int) -> Angle:
    """The angle from the program's units (deg or mm)."""
    turns = trunc(value / (TURN_MDEG // steps_per_unit)) if steps_per_unit <= TURN_MDEG else 0
    return turns, value * steps_per_unit - turns * TURN_MDEG


def to_unit(angle: Angle, steps_per_unit: int) -> int:
    """The angle in the program's units: turns truncated, the rest rounded."""
    turns, mdeg = angle
    half = trunc(steps_per_unit / 2) if mdeg >= 0 else -trunc(steps_per_unit / 2)
    return trunc(turns * TURN_MDEG / steps_per_unit) + trunc((mdeg + half) / steps_per_unit)


def to_unit_float(angle: Angle, steps_per_unit: int) -> float:
    """The angle in the program's units, in single precision."""
    turns = single(angle[0] * single(TURN_MDEG / steps_per_unit))
    return single(turns + single(angle[1] / steps_per_unit))


def _normalized(turns: int, mdeg: int) -> Angle:
    while mdeg > TURN_MDEG:
        turns = turns + 1
        mdeg = mdeg - TURN_MDEG
    while mdeg < -TURN_MDEG:
        turns = turns - 1
        mdeg = mdeg + TURN_MDEG
    return turns, mdeg
