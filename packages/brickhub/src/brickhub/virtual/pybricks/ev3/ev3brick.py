"""Parts of ``EV3Brick`` that are other than those of the hubs of Powered Up."""

import colorsys

from brickhub.virtual import error_numbers
from brickhub.virtual.pybricks.arguments import os_error
from brickhub.virtual.pybricks.hub_panel import ColorLight, Speaker
from brickhub.virtual.pybricks.hub_system import Battery

_GREEN_HUE = 120
"""Hue of the green lamps; that of the red ones is 0, and there are no blue ones."""


class BrickLight(ColorLight):
    """Red and green lamps behind the buttons: the blue share of a color is lost."""

    @staticmethod
    def _lit(light: tuple[int, int, int]) -> tuple[int, int, int] | None:
        hue, saturation, value = light
        red, green, _ = colorsys.hsv_to_rgb(hue / 360, saturation / 100, value / 100)
        brightest = max(red, green)
        if not brightest:
            return None
        # Between red and green, the weaker lamp pulls the hue towards its own, up to yellow.
        towards_yellow = min(red, green) / brightest * _GREEN_HUE / 2
        shown_hue = towards_yellow if red >= green else _GREEN_HUE - towards_yellow
        return round(shown_hue), 100, round(100 * brightest)


class BrickSpeaker(Speaker):
    """Loudspeaker; a program reads 75, but until it sets a volume all is loud."""

    _volume = 75


class BrickBattery(Battery):
    def temperature(self) -> int:
        raise os_error(error_numbers.EOPNOTSUPP)


# Their classes have the firmware's names.
BrickLight.__name__ = ColorLight.__name__
BrickSpeaker.__name__ = BrickSpeaker.__qualname__ = Speaker.__name__
