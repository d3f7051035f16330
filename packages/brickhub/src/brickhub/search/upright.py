"""Keeping upright on two wheels, an inverted pendulum: the wheels get a share of the battery's
voltage in proportion to how far the robot is off its balance.

That is linear feedback of pitch, pitch rate, and the wheels' angle and speed. Who falls forwards
has to drive forwards, and who has rolled forwards, too: only so does the robot lean back. So no
number but the lean is negative. All but one are in degrees of pitch, and that one is the gain of
their sum, so that a search can find them one by one.
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
_GAINS = (2.0, 40.0)
"""Below, a robot falls from where a hand holds it; beyond, it trembles: all of the voltage is for
2.5 degrees."""
_MOST_AHEAD_S = 0.1
"""In that time, a robot of LEGO's height falls twice as far."""
_MOST_BY_ANGLE = 0.03
"""After a turn of the wheels it leans by 10 degrees."""
_MOST_BY_SPEED = 0.03
"""At a turn of the wheels in a second it leans by 10 degrees."""


class Upright:
    """Keeping upright, of a robot with two commands, the voltages of its wheels, and four channels:
    pitch, pitch rate, the wheels' angle and speed.

    Args:
        most_lean_deg: largest pitch at which the robot is in balance.
    """

    def __init__(self, most_lean_deg: float) -> None:
        self.numbers: tuple[Entry, ...] = (
            Entry("lean", -most_lean_deg, most_lean_deg, "deg"),
            Entry("gain", *_GAINS, "%/deg"),
            Entry("ahead", 0.0, _MOST_AHEAD_S, "s"),
            Entry("by_angle", 0.0, _MOST_BY_ANGLE, "deg/deg"),
            Entry("by_speed", 0.0, _MOST_BY_SPEED, "deg/(deg/s)"),
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
