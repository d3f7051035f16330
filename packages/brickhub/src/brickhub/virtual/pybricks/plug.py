"""A device on a port: its stimuli as the values that LEGO's devices send, and the modes in
which they send them.

Raw colors are those from which the firmware computes what a program reads.
"""

import colorsys
import enum
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from brickhub.robot import Sense, UltrasonicSensor
from brickhub.virtual.machine import Machine
from brickhub.virtual.stimuli import (
    Hsv,
    Sensed,
    brightness_pct,
    color,
    number,
    pitch_and_roll,
)

MAX_FORCE_MN = 10_000
_MAX_TILT_DEG = 45
_INFRARED_MAX_RAW = 500
_BOOST_FULL_RAW = 440
_SPIKE_FULL_RAW = 1024


class DataType(enum.IntEnum):
    """Signed integers of 8, 16 and 32 bits, by number in the protocol."""

    INT8 = 0
    INT16 = 1
    INT32 = 2

    @property
    def bits(self) -> int:
        return 8 << self


class Plug:
    """Device on a port, and its stimuli."""

    def __init__(
        self,
        machine: Machine,
        port: str,
    ) -> None:
        self.machine = machine
        self.port = port
        self._last_sample = (0, 0)

    def color(self, sense: Sense = Sense.SURFACE) -> Hsv:
        return color(self.sensed(sense))

    def ambient_pct(self) -> float:
        return brightness_pct(self.sensed(Sense.AMBIENT))

    def proximity(self) -> int:
        """Distance in tenths of the largest."""
        distance_pct = number(self.sensed(Sense.DISTANCE))
        return min(max(round(distance_pct / 10), 0), 10)

    def raw_rgb(self, is_boost: bool) -> tuple[int, int, int]:
        """Reflected light as a color sensor sends it: the BOOST sensor up to 440, that of SPIKE up
        to 1024."""
        hue, saturation, value = self.color()
        # The firmware bends saturation and value by parabolas, in reflected_hsv. These are their
        # inverses, so that a program reads the color that is there.
        raw_saturation: float
        if is_boost:
            raw_saturation = saturation
            raw_value = 100 - math.sqrt(10_000 - 100 * value)
            full = _BOOST_FULL_RAW
        else:
            raw_saturation = 100 - math.sqrt(10_000 - 100 * saturation)
            raw_value = 150 - math.sqrt(22_500 - 200 * value)
            full = _SPIKE_FULL_RAW
        red, green, blue = colorsys.hsv_to_rgb(hue / 360, raw_saturation / 100, raw_value / 100)
        return (
            round(red * full),
            round(green * full),
            round(blue * full),
        )

    def reflected_hsv(self, is_boost: bool) -> Hsv:
        """Color that the firmware computes from the raw one, in eight bits (``get_hsv_reflected``,
        ``get_hsv_data``)."""
        raw = self.raw_rgb(is_boost)
        if is_boost:
            # The firmware multiplies and shifts, which turns 440 into 255 without a division.
            red, green, blue = (1187 * channel // 2048 for channel in raw)
            hue, saturation, value = _hsv_of_bytes(red, green, blue)
            return hue, saturation, value * (200 - value) // 100
        # The value 1024 itself would not fit into a byte.
        red, green, blue = (min(channel >> 2, 255) for channel in raw)
        hue, saturation, value = _hsv_of_bytes(red, green, blue)
        bent_saturation = saturation * (200 - saturation) // 100
        return hue, bent_saturation, value * (150 - value // 2) // 100

    def distance_mm(self) -> int | None:
        """Distance for an ultrasonic sensor; ``None`` if nothing is near."""
        # The body tells its farthest distance where there is nothing.
        distance_mm = self.machine.body.distance_mm(self.port)
        return distance_mm if distance_mm < UltrasonicSensor.FARTHEST_MM else None

    def infrared_raw(self) -> int:
        """Reflected infrared light: the more, the nearer
        (``pb_type_pupdevices_infraredsensor.c``)."""
        distance_pct = number(self.sensed(Sense.DISTANCE))
        # The formula divides by the distance, so it has no value at 0.
        distance_pct = min(max(distance_pct, 1.0), 100.0)
        return min(round(1100 / distance_pct) - 10, _INFRARED_MAX_RAW)

    def passed(self) -> int:
        return int(number(self.sensed(Sense.COUNT)))

    def force_mn(self) -> int:
        force_mn = round(number(self.sensed(Sense.FORCE)) * 1000)
        return min(max(force_mn, 0), MAX_FORCE_MN)

    def tilt_deg(self) -> tuple[int, int]:
        """Pitch and roll."""
        pitch, roll = pitch_and_roll(self.sensed(Sense.TILT))
        return _limited_tilt(pitch), _limited_tilt(roll)

    def angle_mdeg(self) -> int:
        """Angle of a motor's shaft."""
        return self.machine.body.angle_mdeg(self.port)

    def speed_pct(self) -> int:
        """Mean speed of a motor since the last call, in % of its kind's maximum; at first 0."""
        last_ms, last_mdeg = self._last_sample
        now_ms = self.machine.time_ms
        now_mdeg = self.angle_mdeg()
        self._last_sample = (now_ms, now_mdeg)
        elapsed_ms = now_ms - last_ms
        if not last_ms or not elapsed_ms:
            return 0
        # mdeg/ms equals deg/s, so the number needs no conversion.
        max_deg_s = self.machine.servos[self.port].type.max_speed_deg_s
        speed_pct = 100 * (now_mdeg - last_mdeg) / (elapsed_ms * max_deg_s)
        return max(-100, min(100, round(speed_pct)))

    def sensed(self, sense: Sense) -> Sensed:
        return self.machine.body.sensed(self.port, sense)


def _hsv_of_bytes(
    red: int,
    green: int,
    blue: int,
) -> Hsv:
    """Hue, saturation and value with the firmware's integers, low hues shifted to make yellow more
    accurate (``pb_color_map_rgb_to_hsv``)."""
    largest = max(red, green, blue)
    chroma = largest - min(red, green, blue)
    if not chroma:
        hue = 0
    elif largest == red:
        lead = green - blue
        hue = math.trunc(60 * lead / chroma) % 360
    elif largest == green:
        lead = blue - red
        hue = math.trunc(60 * lead / chroma) + 120
    else:
        lead = red - green
        hue = math.trunc(60 * lead / chroma) + 240
    saturation = 100 * chroma // largest if chroma else 0
    return _shifted_hue(hue), saturation, 101 * largest // 256


def _shifted_hue(hue: int) -> int:
    """The hue with the firmware's correction of what is near red: by 10 degrees from 0 to 40,
    less and less down to 350 and up to 60."""
    if hue >= 350:
        return (350 + 2 * (hue - 350)) % 360
    # From 40 on, the correction shrinks by half a degree a degree; at 60 nothing is left of it.
    return max(hue, min(hue + 10, 30 + hue // 2))


def _limited_tilt(angle_deg: float) -> int:
    return min(max(round(angle_deg), -_MAX_TILT_DEG), _MAX_TILT_DEG)


Read = Callable[[Plug], Iterable[int]]


@dataclass(frozen=True)
class DeviceMode:
    """One mode: its name, number and type of values, whether it can be written, what is read
    (``None``: zeros)."""

    name: str
    count: int
    data_type: DataType
    read: Read | None = None
    is_writable: bool = False

    def values(self, plug: Plug) -> tuple[int, ...]:
        """Present values, with zeros for unknown ones."""
        readings: tuple[int, ...] = ()
        if self.read is not None:
            readings = tuple(self.read(plug))
        unknown = self.count - len(readings)
        return readings + (0,) * unknown


class DeviceModes:
    """Modes of a kind of device.

    Attributes:
        modes: all of them, by number; none of a passive device, such as a light.
        first_mode: name of the mode after plugging in (``pbio_port_lump_sync_thread``), of number
            ``first``: of motors, where the firmware reads their angle.
    """

    def __init__(
        self,
        *modes: DeviceMode,
        first: int = 0,
        stale_ms: int = 0,
    ) -> None:
        self.modes = modes
        self._stale_ms = stale_ms
        self.first_mode = modes[first].name if modes else ""

    def stale_ms(self, mode: str) -> int:
        """Time after a change to a mode until values are fresh
        (``lego_device_stale_data_delay``)."""
        # In these modes a device only listens and sends nothing that could be stale.
        return 0 if mode in ("LIGHT", "IR Tx") else self._stale_ms
