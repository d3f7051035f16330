"""Modes of EV3's sensors: names, values, and what the sensors send in them.

Sources: the firmware's list of modes (``lego/device.h``) and the conversions of
``pybricks.ev3devices``; ranges of ev3dev's ``ev3_uart_sensor_defs.c``. What a program does not
read, such as a calibration, is zero.
"""

import colorsys
import math
from collections.abc import Iterable, Mapping

from brickhub.robot import Sense, SensorKind
from brickhub.virtual.pybricks.parameters import nearest
from brickhub.virtual.pybricks.plug import DataType, DeviceMode, DeviceModes, Plug
from brickhub.virtual.stimuli import COLORS, Hsv, beacon, number, rotation

RGB_SCALES = ((0.258, 0.3), (0.280, 0.8), (0.523, 3.7))
"""Factor and offset of red, green and blue, by which the firmware makes percents of raw values."""
KNOWN_COLORS = ("BLACK", "BLUE", "GREEN", "YELLOW", "RED", "WHITE", "BROWN")
"""Colors that the sensor itself tells apart, from number 1 on; 0 for none."""
NOTHING_MM = 2550
NO_BEACON = -128
CHANNELS = 4
BEACON_DEG_PER_UNIT = 3
"""Degrees of a unit of a beacon's direction."""
# Numbers of the pairs of the remote's buttons that the sensor tells apart.
BUTTONS_OF_CODE: Mapping[int, tuple[str, ...]] = {
    0: (),
    1: ("left_up",),
    2: ("left_down",),
    3: ("right_up",),
    4: ("right_down",),
    5: ("left_up", "right_up"),
    6: ("left_up", "right_down"),
    7: ("left_down", "right_up"),
    8: ("left_down", "right_down"),
    9: ("beacon",),
    10: ("left_up", "left_down"),
    11: ("right_up", "right_down"),
}
KEYPAD_BITS = {"left_up": 16, "left_down": 32, "right_up": 64, "right_down": 128}
KEYPAD_NONE = 384
_LARGEST_ANGLE_DEG = 32_767
_LARGEST_RATE_DEG_S = 440
_LARGEST_DIRECTION = 25
_COLORS: list[Hsv] = [COLORS["NONE"], *(COLORS[name] for name in KNOWN_COLORS)]


def red_pct(plug: Plug) -> int:
    """What a surface reflects of red light."""
    red, _, _ = _channels(plug)
    return round(100 * red)


def color_number(plug: Plug) -> int:
    """Number of the color of a surface, as the sensor tells it."""
    return nearest(plug.color(), _COLORS) or 0


def raw_rgb(plug: Plug) -> tuple[int, ...]:
    """Reflected light, raw: such that the firmware makes the percents of the surface of it."""
    channels = zip(_channels(plug), RGB_SCALES, strict=True)
    return tuple(
        math.ceil((100 * channel + offset) / factor) if channel else 0
        for channel, (factor, offset) in channels
    )


def _channels(plug: Plug) -> tuple[float, float, float]:
    hue, saturation, value = plug.color()
    return colorsys.hsv_to_rgb(hue / 360, saturation / 100, value / 100)


def turned(plug: Plug) -> tuple[int, int]:
    """Angle and rate of a gyroscope."""
    return sent_rotation(*rotation(plug.sensed(Sense.ROTATION)))


def sent_rotation(angle_deg: float, rate_deg_s: float) -> tuple[int, int]:
    """An angle and a rate as a gyroscope sends them."""
    return (
        _limited(angle_deg, _LARGEST_ANGLE_DEG),
        _limited(rate_deg_s, _LARGEST_RATE_DEG_S),
    )


def proximity_pct(plug: Plug) -> int:
    """Distance by infrared light."""
    return min(max(round(number(plug.sensed(Sense.DISTANCE))), 0), 100)


def seen_beacon(plug: Plug) -> tuple[int, int]:
    """Direction, in the sensor's units, and distance (%) of the beacon on channel 1."""
    seen = beacon(plug.sensed(Sense.BEACON))
    if seen is None:
        return 0, NO_BEACON
    distance_pct, direction_deg = seen
    direction = _limited(direction_deg / BEACON_DEG_PER_UNIT, _LARGEST_DIRECTION)
    return direction, min(max(round(distance_pct), 0), 100)


def remote_buttons(plug: Plug) -> frozenset[str]:
    """Buttons of the infrared remote that are down; it is on channel 1."""
    machine = plug.machine
    return machine.panel.pressed_on("infrared", machine.time_ms)


def button_code(plug: Plug) -> int:
    """Number of the buttons that are down; 0 for a set that the sensor does not know."""
    down = remote_buttons(plug)
    for code, names in BUTTONS_OF_CODE.items():
        if down == set(names):
            return code
    return 0


def keypad_bits(plug: Plug) -> int:
    """Sum of the bits of the buttons that are down."""
    down = remote_buttons(plug)
    return sum(bit for name, bit in KEYPAD_BITS.items() if name in down) or KEYPAD_NONE


def _limited(value: float, limit: int) -> int:
    return min(max(round(value), -limit), limit)


def _millimetres(plug: Plug) -> Iterable[int]:
    return (plug.machine.body.distance_mm(plug.port),)


def _inches(plug: Plug) -> Iterable[int]:
    tenths = 10 / 25.4
    return (round(plug.machine.body.distance_mm(plug.port) * tenths),)


_8, _16, _32 = DataType
EV3_MODES: Mapping[SensorKind, DeviceModes] = {
    # The brick measures the voltage of the button's pin, and asks it nothing.
    SensorKind.EV3_TOUCH: DeviceModes(),
    SensorKind.EV3_COLOR: DeviceModes(
        DeviceMode("COL-REFLECT", 1, _8, lambda plug: (red_pct(plug),)),
        DeviceMode("COL-AMBIENT", 1, _8, lambda plug: (round(plug.ambient_pct()),)),
        DeviceMode("COL-COLOR", 1, _8, lambda plug: (color_number(plug),)),
        DeviceMode("REF-RAW", 2, _16),
        DeviceMode("RGB-RAW", 3, _16, raw_rgb),
        DeviceMode("COL-CAL", 4, _16),
        stale_ms=30,
    ),
    SensorKind.EV3_ULTRASONIC: DeviceModes(
        DeviceMode("US-DIST-CM", 1, _16, _millimetres),
        DeviceMode("US-DIST-IN", 1, _16, _inches),
        DeviceMode("US-LISTEN", 1, _8),
        DeviceMode("US-SI-CM", 1, _16, _millimetres),
        DeviceMode("US-SI-IN", 1, _16, _inches),
        DeviceMode("US-DC-CM", 1, _16, _millimetres),
        DeviceMode("US-DC-IN", 1, _16, _inches),
    ),
    SensorKind.EV3_GYRO: DeviceModes(
        DeviceMode("GYRO-ANG", 1, _16, lambda plug: turned(plug)[:1]),
        DeviceMode("GYRO-RATE", 1, _16, lambda plug: turned(plug)[1:]),
        DeviceMode("GYRO-FAS", 1, _16),
        DeviceMode("GYRO-G&A", 2, _16, turned),
        DeviceMode("GYRO-CAL", 4, _16),
    ),
    SensorKind.EV3_INFRARED: DeviceModes(
        DeviceMode("IR-PROX", 1, _8, lambda plug: (proximity_pct(plug),)),
        DeviceMode("IR-SEEK", 8, _8, seen_beacon),
        DeviceMode("IR-REMOTE", 4, _8, lambda plug: (button_code(plug),)),
        DeviceMode("IR-REM-A", 1, _16, lambda plug: (keypad_bits(plug),)),
        DeviceMode("IR-S-ALT", 4, _8),
        DeviceMode("IR-CAL", 2, _16),
        stale_ms=1100,
    ),
}
