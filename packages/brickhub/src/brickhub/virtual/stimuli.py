"""Stimuli: what sensors sense, before the firmware turns it into values."""

import colorsys
from collections.abc import Callable, Mapping

from brickhub.errors import TwinError
from brickhub.robot import Sense

Sensed = float | tuple[float, ...]
"""A number, a color (hue, saturation, value), a tilt (pitch, roll), a rotation (angle, rate), or a
beacon (distance, direction); empty for no beacon."""
Reading = Callable[[Mapping[str, float]], Sensed]
"""A stimulus as a function of motor angles (deg at the output, by name)."""
Hsv = tuple[int, int, int]


COLORS: Mapping[str, Hsv] = {
    "RED": (0, 100, 100),
    "BROWN": (30, 100, 50),
    "ORANGE": (30, 100, 100),
    "YELLOW": (60, 100, 100),
    "GREEN": (120, 100, 100),
    "CYAN": (180, 100, 100),
    "BLUE": (240, 100, 100),
    "MAGENTA": (300, 100, 100),
    "VIOLET": (270, 100, 100),
    "BLACK": (0, 0, 10),
    "GRAY": (0, 0, 50),
    "WHITE": (0, 0, 100),
    "NONE": (0, 0, 0),
}
"""Pybricks' named colors, in its order."""
DEFAULT_STIMULI: Mapping[Sense, Sensed] = {
    Sense.AMBIENT: 0.0,
    Sense.DISTANCE: 100.0,
    Sense.COUNT: 0.0,
    Sense.BEACON: (),
}
"""Defaults of secondary senses: dark, nothing near, nothing passed, no beacon."""


_EXPECTED = {
    1: "a number",
    2: "(pitch, roll)",
    3: "a brightness or (hue, saturation, value)",
}
"""Descriptions, for messages, of a stimulus with this many values."""


def number(sensed: Sensed) -> float:
    """A stimulus as a number. Raises TwinError if it is not a number."""
    return float(_expect(sensed, 1)[0])


def brightness_pct(sensed: Sensed) -> float:
    """Brightness 0..100 of a color or gray. Raises TwinError if it is neither."""
    value = sensed if isinstance(sensed, int | float) else _expect(sensed, 3)[2]
    # A scene may compute more than a sensor can tell.
    return min(max(float(value), 0.0), 100.0)


def color(sensed: Sensed) -> Hsv:
    """Hue 0..359, saturation and value 0..100; a number is a gray's value. Raises TwinError if it
    is neither."""
    if isinstance(sensed, int | float):
        sensed = (0.0, 0.0, sensed)
    hue, saturation, value = _expect(sensed, 3)
    saturation_pct = min(max(round(saturation), 0), 100)
    value_pct = min(max(round(value), 0), 100)
    return round(hue) % 360, saturation_pct, value_pct


def pitch_and_roll(sensed: Sensed) -> tuple[float, float]:
    """Both angles of a tilt. Raises TwinError if it is not a tilt."""
    pitch, roll = _expect(sensed, 2)
    return pitch, roll


def rotation(sensed: Sensed) -> tuple[float, float]:
    """Angle and rate of a rotation; a number is the angle of what does not turn. Raises TwinError
    if it is neither."""
    if isinstance(sensed, int | float):
        return float(sensed), 0.0
    angle_deg, rate_deg_s = _expect(sensed, 2, "(angle, rate)")
    return angle_deg, rate_deg_s


def beacon(sensed: Sensed) -> tuple[float, float] | None:
    """Distance and direction of a beacon, ``None`` if there is none. Raises TwinError if it is no
    beacon."""
    if sensed == ():
        return None
    distance_pct, direction_deg = _expect(sensed, 2, "(distance, direction)")
    return distance_pct, direction_deg


def reflection_pct(hsv: Hsv) -> int:
    """Mean of red, green and blue, as in the firmware."""
    hue, saturation, value = hsv
    rgb = colorsys.hsv_to_rgb(hue / 360, saturation / 100, value / 100)
    mean_pct = sum(rgb) / 3 * 100
    # The firmware's integers are cut off, not rounded. Six digits keep the rounding errors of
    # floats out of that.
    return int(round(mean_pct, 6))


def _expect(sensed: Sensed, count: int, expected: str = "") -> tuple[float, ...]:
    values = sensed if isinstance(sensed, tuple) else (sensed,)
    if len(values) != count:
        wanted = expected or _EXPECTED[count]
        raise TwinError(f"the scene lets a sensor sense {sensed}; give {wanted}")
    return values
