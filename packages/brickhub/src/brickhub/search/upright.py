"""Keeping upright on two wheels, an inverted pendulum: the wheels get a share of the battery's
voltage by linear feedback of pitch, pitch rate, and the wheels' angle and speed.

Who falls forwards has to drive forwards, and who has rolled forwards, too: only so does the robot
lean back. So no gain is negative.
"""

from collections.abc import Callable, Sequence

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.interface import (
    Channel,
    Interface,
    Pitch,
    PitchRate,
    RunDuty,
    WheelsAngle,
    WheelsSpeed,
)
from brickhub.search.onboard.keep_upright import keep_upright
from brickhub.search.structure import formula_source

_keep_upright: Callable[..., float] = keep_upright
_CHANNELS: tuple[type[Channel], ...] = (Pitch, PitchRate, WheelsAngle, WheelsSpeed)
_MOST_BY_PITCH = 40.0
"""Beyond it all of the voltage is for 2.5 degrees, and a robot only trembles."""
_MOST_BY_RATE = 2.0
_MOST_BY_ANGLE = 0.2
_MOST_BY_SPEED = 0.2
"""A LEGO motor turns by some 10 deg/s for each percent: beyond twice that, it runs away."""


class Upright:
    """Keeping upright, of a robot with two commands, the voltages of its wheels, and four channels:
    pitch, pitch rate, the wheels' angle and speed.

    Args:
        most_lean_deg: largest pitch at which the robot is in balance.
    """

    def __init__(self, most_lean_deg: float) -> None:
        self.numbers: tuple[Entry, ...] = (
            Entry("lean", -most_lean_deg, most_lean_deg, "deg"),
            Entry("by_pitch", 0.0, _MOST_BY_PITCH, "%/deg"),
            Entry("by_rate", 0.0, _MOST_BY_RATE, "%/(deg/s)"),
            Entry("by_angle", 0.0, _MOST_BY_ANGLE, "%/deg"),
            Entry("by_speed", 0.0, _MOST_BY_SPEED, "%/(deg/s)"),
        )

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """Actions ``[2]``, equal ones, on an observation ``[4]`` by numbers ``[5]``."""
        share = _keep_upright(observed, numbers)
        return [share, share]

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        lines = [
            formula_source("keep_upright"),
            "def act_by(observed, numbers):",
            "    share = keep_upright(observed, numbers)",
            "    return [share, share]",
        ]
        return "\n".join(lines) + "\n"


def upright(interface: Interface, most_lean_deg: float = 6.0) -> Upright:
    """Keeping upright by an interface. Raises DescriptionError unless it commands the voltages of
    two wheels and observes what that needs, in the order of `Upright`."""
    kinds = tuple(type(channel) for channel in interface.channels)
    voltages = [command for command in interface.commands if isinstance(command, RunDuty)]
    if kinds != _CHANNELS or not len(voltages) == len(interface.commands) == 2:
        raise DescriptionError(
            "who keeps upright commands the voltages of two wheels, and observes pitch, pitch "
            "rate, and the wheels' angle and speed"
        )
    return Upright(most_lean_deg)
