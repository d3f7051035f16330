"""Nearest detectable color, in the firmware's integer arithmetic (``pbio/color``, v4)."""

from __future__ import annotations

from collections.abc import Sequence
from math import trunc

from brickhub.virtual.stimuli import Hsv

_MAX_GRAY_SATURATION_PCT = 40  # up to this saturation a color is a gray,
_MAX_GRAY_VALUE_PCT = 1  # and up to this value
_OTHER_KIND_DISTANCE = 1000  # above every distance between hues or values


def nearest(measured: Hsv, candidates: Sequence[Hsv]) -> int | None:
    """Index of the first nearest candidate, or ``None``.

    Grays are compared by value and full colors by hue, independent of the distance to the surface. If a candidate is neither,
    distances are in a double cone with black and white at the tips.
    """
    is_ideal = all(_is_gray(candidate) or _is_full(candidate) for candidate in candidates)
    distance = _ideal_distance if is_ideal else _cone_distance
    return min(range(len(candidates)), key=lambda i: distance(measured, candidates[i]), default=None)


def _is_gray(color: Hsv) -> bool:
    return color[0] == 0 and color[1] == 0


def _is_full(color: Hsv) -> bool:
    return color[1] == 100 and color[2] == 100


def _ideal_distance(measured: Hsv, candidate: Hsv) -> int:
    """Degrees of hue or percent of value; larger if only one is a gray."""
    hue, saturation, value = measured
    looks_gray = saturation <= _MAX_GRAY_SATURATION_PCT or value <= _MAX_GRAY_VALUE_PCT
    if looks_gray:
        return abs(candidate[2] - value) if _is_gray(candidate) else _OTHER_KIND_DISTANCE + _hue_distance(candidate[0], hue)
    return _hue_distance(candidate[0], hue) if _is_full(candidate) else _OTHER_KIND_DISTANCE + abs(candidate[2] - value)


def _hue_distance(a: int, b: int) -> int:
    difference = abs(a - b)
    return min(difference, 360 - difference)


def _cone_distance(a: Hsv, b: Hsv) -> int:
    """Squared distance in a double cone, 20 000 high and wide. Negative values are below black, far from all colors."""
    ax, ay, az = _in_cone(a)
    bx, by, bz = _in_cone(b)
    dx, dy = trunc((bx - ax) / 10_000), trunc((by - ay) / 10_000)
    return dx * dx + dy * dy + (bz - az) ** 2


def _in_cone(color: Hsv) -> tuple[int, int, int]:
    """Two chroma coordinates, times 10 000, and lightness."""
    hue, saturation, value = color
    radius = max(value, 0) * saturation
    return radius * _sine(hue + 90), radius * _sine(hue), (200 - saturation) * value


def _sine(angle_deg: int) -> int:
    """10 000 times the sine, by parabolas."""
    x = angle_deg % 360
    x, sign = (x - 180, -1) if x >= 180 else (x, 1)
    x = 180 - x if x >= 90 else x
    return sign * (201 - x) * x
