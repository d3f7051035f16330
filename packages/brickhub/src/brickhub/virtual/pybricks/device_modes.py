"""Modes of LEGO's Powered Up devices: names, values, and what the devices send in them.

Sources: messages of devices 37, 38, 46 and 47 in the firmware's ``test_lump.c``, and its list of
modes in ``lego/device.h`` (v4.0.1); the Raspberry Pi Build HAT's lists of 48 and 64; users' lists
of 34 and 35, of 61 and 62 (of set 51515), and of 63. All motors with an absolute angle are taken to
be alike. Raw colors are those from which the firmware computes saturation and value of ``hsv()``.
Unknown values, such as a calibration, are zero.
"""

import math
from collections.abc import Iterable, Mapping

from brickhub.robot import MotorKind, Sense, SensorKind
from brickhub.virtual.pybricks.ev3.ev3_modes import EV3_MODES
from brickhub.virtual.pybricks.parameters import nearest
from brickhub.virtual.pybricks.plug import MAX_FORCE_MN, DataType, DeviceMode, DeviceModes, Plug
from brickhub.virtual.stimuli import Hsv, reflection_pct

_DISTS_MAX_MM = 320
_NOTHING_NEAR = -1
_ECHO_US_PER_MM = 2 / 0.343
"""There and back, at the speed of sound, 0.343 mm/us."""
_MAX_ECHO_US = 14_577
# CALIB reports these values, which each force sensor has for itself; they are of one sensor.
_FORCE_RELEASED_RAW = 384
_FORCE_MAX_RAW = 701
# The sensors' own color modes tell these numbers of LEGO's colors, and -1 for none.
_LEGO_COLORS: Mapping[int, Hsv] = {
    -1: (0, 0, 0), 0: (0, 0, 10), 3: (240, 100, 100), 4: (180, 100, 100), 5: (120, 100, 100),
    7: (60, 100, 100), 9: (0, 100, 100),
    10: (0, 0, 100),
}  # fmt: skip


def _lego_color(plug: Plug) -> Iterable[int]:
    index = nearest(plug.color(), list(_LEGO_COLORS.values()))
    return () if index is None else (list(_LEGO_COLORS)[index],)


def _hsv(plug: Plug, sense: Sense) -> Iterable[int]:
    hue, saturation, value = plug.color(sense)
    return hue, saturation * 10, value * 10


def _millimetres(plug: Plug, max_mm: float = math.inf) -> Iterable[int]:
    distance_mm = plug.distance_mm()
    if distance_mm is None or distance_mm > max_mm:
        return (_NOTHING_NEAR,)
    return (distance_mm,)


def _echo_us(plug: Plug) -> Iterable[int]:
    distance_mm = plug.distance_mm()
    if distance_mm is None:
        return (_MAX_ECHO_US,)
    return (round(distance_mm * _ECHO_US_PER_MM),)


def _force_raw(plug: Plug) -> Iterable[int]:
    raw_range = _FORCE_MAX_RAW - _FORCE_RELEASED_RAW
    raw = _FORCE_RELEASED_RAW + raw_range * plug.force_mn() // MAX_FORCE_MN
    return (raw,)


# These are the modes of each device in the order of their numbers: name, number and type of values,
# and how they are read. The short names keep them a table.
_8, _16, _32 = DataType
_REFLECTION = DeviceMode(
    "REFLT",
    1,
    _8,
    lambda plug: (reflection_pct(plug.color()),),
)
_AMBIENT = DeviceMode(
    "AMBI",
    1,
    _8,
    lambda plug: (round(plug.ambient_pct()),),
)
_POWER = DeviceMode("POWER", 1, _8, is_writable=True)
_ABSOLUTE_MOTOR = DeviceModes(
    _POWER,
    DeviceMode(
        "SPEED",
        1,
        _8,
        lambda plug: (plug.speed_pct(),),
        is_writable=True,
    ),
    DeviceMode(
        "POS",
        1,
        _32,
        lambda plug: (plug.angle_mdeg() // 1000,),
        is_writable=True,
    ),
    DeviceMode(
        "APOS",
        1,
        _16,
        lambda plug: ((plug.angle_mdeg() // 1000 + 180) % 360 - 180,),
        is_writable=True,
    ),
    DeviceMode(
        "CALIB",
        2,
        _16,
        lambda plug: (0, plug.angle_mdeg() // 100 % 3600),
    ),
    DeviceMode("STATS", 14, _16),
    first=4,
)
_RELATIVE_MOTOR = DeviceModes(
    _POWER,
    DeviceMode(
        "SPEED",
        1,
        _8,
        lambda plug: (plug.speed_pct(),),
    ),
    DeviceMode(
        "POS",
        1,
        _32,
        lambda plug: (plug.angle_mdeg() // 1000,),
    ),
    DeviceMode("TEST", 5, _16),
    first=2,
)
SENSOR_MODES: Mapping[SensorKind, DeviceModes] = {
    SensorKind.LIGHT: DeviceModes(),
    SensorKind.TILT: DeviceModes(
        DeviceMode(
            "LPF2-ANGLE",
            2,
            _8,
            lambda plug: reversed(plug.tilt_deg()),
        ),
        DeviceMode("LPF2-TILT", 1, _8),
        DeviceMode("LPF2-CRASH", 3, _8),
        DeviceMode("LPF2-CAL", 3, _8),
    ),
    SensorKind.INFRARED: DeviceModes(
        DeviceMode(
            "LPF2-DETECT",
            1,
            _8,
            lambda plug: (plug.proximity(),),
        ),
        DeviceMode(
            "LPF2-COUNT",
            1,
            _32,
            lambda plug: (plug.passed(),),
        ),
        DeviceMode(
            "LPF2-CAL",
            3,
            _16,
            lambda plug: (plug.infrared_raw(),),
        ),
    ),
    SensorKind.COLOR_DISTANCE: DeviceModes(
        DeviceMode("COLOR", 1, _8, _lego_color),
        DeviceMode(
            "PROX",
            1,
            _8,
            lambda plug: (plug.proximity(),),
        ),
        DeviceMode("COUNT", 1, _32),
        _REFLECTION,
        _AMBIENT,
        DeviceMode("COL O", 1, _8, is_writable=True),
        DeviceMode(
            "RGB I",
            3,
            _16,
            lambda plug: plug.raw_rgb(is_boost=True),
        ),
        DeviceMode(
            "IR Tx",
            1,
            _16,
            is_writable=True,
        ),
        DeviceMode("SPEC 1", 4, _8),
        DeviceMode("DEBUG", 2, _16),
        DeviceMode("CALIB", 8, _16),
        first=6,
        stale_ms=30,
    ),
    SensorKind.COLOR: DeviceModes(
        DeviceMode("COLOR", 1, _8, _lego_color),
        _REFLECTION,
        _AMBIENT,
        DeviceMode("LIGHT", 3, _8, is_writable=True),
        DeviceMode("RREFL", 2, _16),
        DeviceMode(
            "RGB I",
            4,
            _16,
            lambda plug: plug.raw_rgb(is_boost=False),
        ),
        DeviceMode(
            "HSV",
            3,
            _16,
            lambda plug: _hsv(plug, Sense.SURFACE),
        ),
        DeviceMode(
            "SHSV",
            4,
            _16,
            lambda plug: _hsv(plug, Sense.AMBIENT),
        ),
        DeviceMode("DEBUG", 4, _16),
        DeviceMode("CALIB", 7, _16),
        stale_ms=30,
    ),
    SensorKind.FORCE: DeviceModes(
        DeviceMode(
            "FORCE",
            1,
            _8,
            lambda plug: (plug.force_mn() * 100 // MAX_FORCE_MN,),
        ),
        DeviceMode(
            "TOUCH",
            1,
            _8,
            lambda plug: (int(plug.force_mn() > 0),),
        ),
        DeviceMode("TAP", 1, _8),
        DeviceMode("FPEAK", 1, _8),
        DeviceMode("FRAW", 1, _16, _force_raw),
        DeviceMode("FPRAW", 1, _16),
        DeviceMode(
            "CALIB",
            8,
            _16,
            lambda plug: (0, 0, _FORCE_RELEASED_RAW, 0, 0, 0, _FORCE_MAX_RAW),
        ),
    ),
    SensorKind.COLOR_LIGHT_MATRIX: DeviceModes(
        DeviceMode("LEV O", 1, _8, is_writable=True),
        DeviceMode("COL O", 1, _8, is_writable=True),
        DeviceMode("PIX O", 9, _8, is_writable=True),
        DeviceMode("TRANS", 1, _8, is_writable=True),
    ),
    SensorKind.ULTRASONIC: DeviceModes(
        DeviceMode("DISTL", 1, _16, _millimetres),
        DeviceMode(
            "DISTS",
            1,
            _16,
            lambda plug: _millimetres(plug, _DISTS_MAX_MM),
        ),
        DeviceMode("SINGL", 1, _16, _millimetres),
        DeviceMode("LISTN", 1, _8),
        DeviceMode("TRAW", 1, _32, _echo_us),
        DeviceMode("LIGHT", 4, _8, is_writable=True),
        DeviceMode("PING", 1, _8, is_writable=True),
        DeviceMode("ADRAW", 1, _16),
        DeviceMode("CALIB", 7, _16),
        stale_ms=50,
    ),
    **EV3_MODES,
}


def _modes_by_device() -> dict[int, DeviceModes]:
    modes = {}
    for motor_kind in MotorKind:
        model = motor_kind.model
        # A motor without an encoder is a passive device, which has no modes.
        if model.has_encoder:
            modes[model.device_id] = _ABSOLUTE_MOTOR if model.is_absolute else _RELATIVE_MOTOR
    for sensor_kind, sensor_modes in SENSOR_MODES.items():
        modes[sensor_kind.model.device_id] = sensor_modes
    return modes


MODES: Mapping[int, DeviceModes] = _modes_by_device()
"""Modes by the number of the device."""


def reports_angle(kind: MotorKind, mode: str | None) -> bool:
    """Whether the firmware gets a motor's angle in its mode; ``None``: the mode after plugging
    in."""
    if not kind.model.has_encoder:
        return False
    first_mode = MODES[kind.model.device_id].first_mode
    return mode in (None, first_mode)
