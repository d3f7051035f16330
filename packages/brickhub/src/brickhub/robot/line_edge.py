"""The edge of a black line on a pale floor, as each kind of color sensor reads it."""

from collections.abc import Mapping
from dataclasses import dataclass

from brickhub.robot.hardware import SensorKind
from brickhub.robot.spec import Robot

_NOISE_PCT = 2.0
"""Difference from the reading over bare line or floor at which the sensor sees only that."""


@dataclass(frozen=True)
class LineEdge:
    """The edge of a line by a sensor's reflection.

    Attributes:
        line_pct, floor_pct: what the sensor reads over the line and over the floor.
    """

    line_pct: float
    floor_pct: float

    @property
    def edge_pct(self) -> float:
        """Reading on the edge, halfway between line and floor."""
        return (self.line_pct + self.floor_pct) / 2

    @property
    def bare_pct(self) -> float:
        """Difference from it at which the sensor sees only the line or only the floor."""
        return (self.floor_pct - self.line_pct) / 2 - _NOISE_PCT


LINE_EDGES: Mapping[SensorKind, LineEdge] = {
    SensorKind.COLOR: LineEdge(5.0, 71.0),
    SensorKind.COLOR_DISTANCE: LineEdge(4.0, 63.0),
    SensorKind.EV3_COLOR: LineEdge(8.0, 82.0),
}
"""What the kinds of color sensors read of a line and a floor that reflect 8 and 82 % of the
light."""


def edge_of(robot: Robot, sensor: str = "light") -> LineEdge:
    """The edge of a line as a robot's color sensor reads it."""
    return LINE_EDGES[robot.sensor(sensor).kind]
