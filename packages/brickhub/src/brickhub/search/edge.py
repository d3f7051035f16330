"""Following the edge of a line at one speed: the turn is in proportion to how much brighter than
the edge it is below the sensor (proportional control)."""

from collections.abc import Callable, Sequence
from typing import Literal

from brickhub.entry import Entry
from brickhub.errors import DescriptionError
from brickhub.hub.commands import DriveSpeed, DriveTurnRate
from brickhub.hub.interface import Interface, SensorReading, YawRate
from brickhub.search.onboard.follow_edge import follow_edge
from brickhub.search.structure import formula_source

_follow_edge: Callable[..., float] = follow_edge
_MOST_GAIN = 5.0
"""Turn for each percent, deg/s, beyond which a robot swings from side to side."""
_MOST_DAMPING = 1.0
"""Beyond it a robot that turns would turn back at once."""
Side = Literal["left", "right"]


class EdgeFollowing:
    """Following of an edge by a robot with two commands, its speed and its turn rate, whose first
    channel is a reflection.

    A robot that observes how fast it turns also turns less, the faster it already does: as its
    motors lag, it would swing otherwise (a derivative term).

    Args:
        edge_pct: reflection halfway between line and floor.
        speeds_mm_s: speeds of the actions -1 and 1.
        top_deg_s: turn rate of an action of 1.
        side: the line's edge, where that is known: the other one is followed by turns to the other
            side.
        yaw_rate: index of the yaw rate among what is observed; ``None`` where it is not.

    Attributes:
        middle_mm_s, half_mm_s: speed of the action 0, and what an action of 1 adds to it.
    """

    def __init__(
        self,
        edge_pct: float,
        speeds_mm_s: tuple[float, float],
        top_deg_s: float,
        side: Side | None = None,
        yaw_rate: int | None = None,
    ) -> None:
        self.edge_pct = edge_pct
        self.top_deg_s = top_deg_s
        low_mm_s, high_mm_s = speeds_mm_s
        self.middle_mm_s = (low_mm_s + high_mm_s) / 2
        self.half_mm_s = (high_mm_s - low_mm_s) / 2
        # Clockwise is positive: beside the left edge, brighter is where a right turn leads back.
        most = 0.0 if side == "right" else _MOST_GAIN
        least = 0.0 if side == "left" else -_MOST_GAIN
        self.numbers: tuple[Entry, ...] = (
            Entry("speed", low_mm_s, high_mm_s, "mm/s"),
            Entry("gain", least, most, "deg/s"),
        )
        self.yaw_rate = yaw_rate
        if yaw_rate is not None:
            self.numbers += (Entry("damping", 0.0, _MOST_DAMPING),)

    def act(
        self,
        observed: Sequence[float],
        numbers: Sequence[float],
    ) -> list[float]:
        """Actions, speed and turn, on a reflection by the numbers, in their units."""
        speed_mm_s, gain = numbers[:2]
        # Counter-clockwise is positive for the yaw rate, clockwise for the turn.
        back_deg_s = 0.0
        if self.yaw_rate is not None:
            back_deg_s = numbers[2] * observed[self.yaw_rate]
        turn = _follow_edge(
            observed[0],
            self.edge_pct,
            gain,
            self.top_deg_s,
            back_deg_s,
        )
        return [(speed_mm_s - self.middle_mm_s) / self.half_mm_s, turn]

    def hub_source(self) -> str:
        """MicroPython that defines ``act_by(observed, numbers)``, as `act`."""
        back = "0.0" if self.yaw_rate is None else f"numbers[2] * observed[{self.yaw_rate}]"
        top = f"{self.top_deg_s:g}"
        lines = [
            formula_source("follow_edge"),
            "def act_by(observed, numbers):",
            "    speed, gain = numbers[:2]",
            f"    back = {back}",
            f"    turn = follow_edge(observed[0], {self.edge_pct:g}, gain, {top}, back)",
            f"    return [(speed - {self.middle_mm_s:g}) / {self.half_mm_s:g}, turn]",
        ]
        return "\n".join(lines) + "\n"


def edge_following(
    interface: Interface,
    edge_pct: float,
    side: Side | None = None,
) -> EdgeFollowing:
    """Following of an edge of that reflection by a robot that commands its speed and its turn rate,
    and observes a reflection first. ``side``: the edge, where it is known. Raises DescriptionError
    for any other interface."""
    first = interface.channels[0]
    if not isinstance(first, SensorReading) or first.method != "reflection":
        raise DescriptionError("who follows an edge observes a reflection first")
    match interface.commands:
        case (DriveSpeed() as speed, DriveTurnRate(low=low, high=top_deg_s)) if low == -top_deg_s:
            speeds_mm_s = (speed.low, speed.high)
            rates = [
                index
                for index, channel in enumerate(interface.channels)
                if isinstance(channel, YawRate)
            ]
            return EdgeFollowing(
                edge_pct,
                speeds_mm_s,
                top_deg_s,
                side,
                next(iter(rates), None),
            )
    raise DescriptionError("who follows an edge commands a speed, and a turn rate to both sides")
