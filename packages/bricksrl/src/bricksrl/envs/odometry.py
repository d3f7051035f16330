"""Odometry: distance travelled, from a virtual robot's true pose or estimated from the ultrasonic sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from brickhub.hub.interface import Distance, Interface

if TYPE_CHECKING:
    from bricktwin.twin.mujoco_body import Pose


class TrueOdometer:
    """Odometer of a virtual robot, along its heading at the start of the episode."""

    def __init__(self, pose: Callable[[], Pose]) -> None:
        self._pose = pose

    def start(self, time_s: float) -> None:
        """Begin an episode."""
        self._start = self._last = self._pose()
        self._start_s = self._now_s = time_s
        self._path_m = self._forward_m = 0.0

    def forward_mm(self, time_s: float, _values: Sequence[float]) -> float:
        """Distance forward since the last call, in mm; ``time_s`` is the time of this one."""
        pose, heading = self._pose(), math.radians(self._start.heading_deg)
        self._path_m += math.hypot(pose.x_m - self._last.x_m, pose.y_m - self._last.y_m)
        # Headings are clockwise, y points left.
        forward_m = (pose.x_m - self._start.x_m) * math.cos(heading) - (pose.y_m - self._start.y_m) * math.sin(heading)
        step_mm = (forward_m - self._forward_m) * 1000
        self._forward_m, self._last, self._now_s = forward_m, pose, time_s
        return step_mm

    def metrics(self) -> dict[str, float]:
        """Metrics of the episode's motion; straightness is the distance forward over the path length, at most 1."""
        time_s = self._now_s - self._start_s
        return {
            "forward_m": self._forward_m,
            "forward_speed_m_s": self._forward_m / time_s if time_s > 0 else 0.0,
            "straightness": self._forward_m / self._path_m if self._path_m > 0 else 0.0,
            "turned_deg": self._last.heading_deg - self._start.heading_deg,
        }


class SonarOdometer:
    """Odometer of a real robot that walks towards a wall, from its ultrasonic distance.

    It measures nothing while the wall is out of range, and takes a turn for a distance.
    """

    def __init__(self, interface: Interface) -> None:
        self._column = interface.distance_index
        self._last_mm = Distance.FARTHEST_MM

    def start(self, _time_s: float) -> None:
        self._last_mm = Distance.FARTHEST_MM

    def forward_mm(self, _time_s: float, values: Sequence[float]) -> float:
        """Decrease of the distance to the wall since the last call, in mm; 0 where it was out of range."""
        now_mm = Distance.FARTHEST_MM if self._column is None else values[self._column]
        in_range = max(now_mm, self._last_mm) < Distance.FARTHEST_MM
        step_mm = self._last_mm - now_mm if in_range else 0.0
        self._last_mm = now_mm
        return step_mm

    def metrics(self) -> dict[str, float]:
        """Empty: an estimate is not reported as a measurement."""
        return {}


Odometer = TrueOdometer | SonarOdometer
