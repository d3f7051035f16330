"""Approach to a place at some distance: the speed is in proportion to the way that is left
(proportional control), forwards and backwards."""

from collections.abc import Callable, Sequence

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.interface import Distance, DriveSpeed, Interface
from brickhub.search.onboard.approach_at import approach_at
from brickhub.search.structure import formula_source

_approach_at: Callable[..., float] = approach_at
_FARTHEST_GOAL_MM = 800.0
_MOST_GAIN = 6.0
"""Beyond it a robot swings: a step is too long for it."""


class Approach:
    """Approach of a robot with one command, a speed, and one channel, a distance.

    Args:
        top_mm_s: speed of an action of 1.
        farthest_mm: largest distance of a goal.
        most_gain: largest speed for each mm of way, 1/s.
    """

    def __init__(
        self,
        top_mm_s: float,
        farthest_mm: float,
        most_gain: float,
    ) -> None:
        self.top_mm_s = top_mm_s
        self.numbers: tuple[Entry, ...] = (
            Entry("goal", 0.0, farthest_mm, "mm"),
            Entry("gain", 0.0, most_gain, "1/s"),
        )

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """The action on a distance by the numbers, in their units."""
        goal_mm, gain = numbers
        return [
            _approach_at(
                observed[0],
                goal_mm,
                gain,
                self.top_mm_s,
            )
        ]

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        lines = [
            formula_source("approach_at"),
            "def act_by(observed, numbers):",
            f"    return [approach_at(observed[0], numbers[0], numbers[1], {self.top_mm_s:g})]",
        ]
        return "\n".join(lines) + "\n"


def approach(interface: Interface) -> Approach:
    """The approach of a robot that commands one speed and observes one distance, and nothing else.
    Raises DescriptionError for any other interface."""
    commands = interface.commands
    channels = interface.channels
    is_one_each = len(commands) == len(channels) == 1
    if not is_one_each or not isinstance(channels[0], Distance):
        raise DescriptionError("an approach observes one distance, and nothing else")
    if not isinstance(commands[0], DriveSpeed) or commands[0].low != -commands[0].high:
        raise DescriptionError("an approach commands one speed, as fast backwards as forwards")
    return Approach(commands[0].high, _FARTHEST_GOAL_MM, _MOST_GAIN)
