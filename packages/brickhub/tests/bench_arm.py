"""The RoboArm on the bench: unloaded joints between their end stops, at first at the angles of a
built arm."""

from __future__ import annotations

from described import ROBO_ARM

from brickhub.virtual.bench_body import BenchBody

STOPS_DEG = {"low": (-5, 85), "high": (-165, 25), "grab": (-163, -30)}
START_DEG = {"low": 40, "high": -70, "grab": -96}


class BenchArm(BenchBody):
    """The arm, whose joints are blocked at their ends."""

    def __init__(self) -> None:
        super().__init__(ROBO_ARM, end_stops=STOPS_DEG)
        for name, angle_deg in START_DEG.items():
            self._motors[ROBO_ARM.motor(name).port].angle = 1000.0 * angle_deg
