"""Following the edge of a line at one speed: the turn is in proportion to how much brighter than
the edge it is below the sensor (proportional control)."""

from collections.abc import Callable, Sequence

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.commands import DriveSpeed, DriveTurnRate
from brickhub.hub.interface import Interface, SensorReading
from brickhub.search.onboard.follow_edge import follow_edge
from brickhub.search.structure import formula_source

_follow_edge: Callable[..., float] = follow_edge
_MOST_GAIN = 5.0
"""Turn for each percent, deg/s, beyond which a robot swings from side to side."""


class EdgeFollowing:
    """Following of an edge by a robot with two commands, its speed and its turn rate, whose first
    channel is a reflection.

    Args:
        edge_pct: reflection halfway between line and floor.
        top_mm_s: speed of an action of 1; 0 is that of -1.
        top_deg_s: turn rate of an action of 1.
    """

    def __init__(
        self,
        edge_pct: float,
        top_mm_s: float,
        top_deg_s: float,
    ) -> None:
        self.edge_pct = edge_pct
        self.top_mm_s = top_mm_s
        self.top_deg_s = top_deg_s
        self.numbers: tuple[Entry, ...] = (
            Entry("speed", 0.0, top_mm_s, "mm/s"),
            Entry("gain", -_MOST_GAIN, _MOST_GAIN, "deg/s"),
        )

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """Actions, speed and turn, on a reflection by the numbers, in their units."""
        speed_mm_s, gain = numbers
        turn = _follow_edge(
            observed[0],
            self.edge_pct,
            gain,
            self.top_deg_s,
        )
        return [2 * speed_mm_s / self.top_mm_s - 1, turn]

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        lines = [
            formula_source("follow_edge"),
            "def act_by(observed, numbers):",
            "    speed, gain = numbers",
            f"    turn = follow_edge(observed[0], {self.edge_pct:g}, gain, {self.top_deg_s:g})",
            f"    return [2 * speed / {self.top_mm_s:g} - 1, turn]",
        ]
        return "\n".join(lines) + "\n"


def edge_following(interface: Interface, edge_pct: float) -> EdgeFollowing:
    """Following of an edge of that reflection by a robot that commands its speed and its turn rate,
    and observes a reflection first. Raises DescriptionError for any other interface."""
    first = interface.channels[0]
    if not isinstance(first, SensorReading) or first.method != "reflection":
        raise DescriptionError("who follows an edge observes a reflection first")
    match interface.commands:
        case (DriveSpeed(low=0, high=top_mm_s), DriveTurnRate(low=low, high=top_deg_s)) if (
            low == -top_deg_s
        ):
            return EdgeFollowing(edge_pct, top_mm_s, top_deg_s)
    raise DescriptionError(
        "who follows an edge commands a speed from 0 on, and a turn rate to both sides"
    )
