"""End stops: how far each motor can turn from the plan's position before parts collide."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from bricktwin.plans.contact import Occupancy
from bricktwin.plans.geometry import M_PER_LDU, Floats, rotation
from bricktwin.plans.mechanism.articulation import Articulation, Drive
from bricktwin.plans.mechanism.kinematics import TO_TWIN
from bricktwin.plans.plan import Placed
from bricktwin.plans.planned_robot import PlannedRobot

_STEP_DEG, _FINE_DEG = 5.0, 0.5
"""Steps of the search, degrees of the driven part: coarse and fine."""


@functools.lru_cache(maxsize=64)
def free_deg(planned: PlannedRobot, port: str, low: float, high: float) -> tuple[float, float]:
    """Collision-free range of a motor's angle within ``low`` and ``high``, degrees; other motors as in the plan.

    Angles are readings of the rotation sensor; the range includes the plan's angle.
    """
    drive = next(drive for drive in planned.articulation.drives if drive.port == port)
    start = planned.device(port).angle_deg
    sweep = _Sweep(planned, drive)
    ends = []
    for end in (low, high):
        travel_deg = (end - start) / drive.gear
        ends.append(start + sweep.reach(travel_deg) * drive.gear)
    return min(start, ends[0]), max(start, ends[1])


class _Sweep:
    """Collision test of the parts that a motor moves."""

    def __init__(self, planned: PlannedRobot, drive: Drive) -> None:
        articulation = planned.articulation
        number = planned.device(drive.port).index
        self._parts = tuple(_case(part) if part.index == number else part for part in planned.plan.parts)
        # In the plan's frame, LDU.
        self._axis, self._point = TO_TWIN.T @ drive.joint.axis, TO_TWIN.T @ drive.joint.point_m / M_PER_LDU
        self._moved = {part for body in _carried(articulation, drive.joint.child) for part in articulation.bodies[body].parts}
        self._others = np.ones(len(self._parts), dtype=bool)
        self._others[list(self._moved)] = False
        # Geared parts and rods move away, so they are not tested.
        coupled = [articulation.bodies[geared.joint.child].parts for geared in articulation.geared if geared.port == drive.port]
        for parts in (*coupled, *(rod.parts for rod in articulation.rods)):
            self._others[list(parts)] = False
        self._is_clear_at_start = self._is_clear(0.0)

    def reach(self, travel_deg: float) -> float:
        """Collision-free part of a travel, degrees of the driven part."""
        if not self._is_clear_at_start:
            return 0.0
        sign, reached = math.copysign(1.0, travel_deg), 0.0
        while reached < abs(travel_deg):
            target = min(reached + _STEP_DEG, abs(travel_deg))
            if not self._is_clear(sign * target):
                return sign * self._bisect(sign, reached, target)
            reached = target
        return travel_deg

    def _bisect(self, sign: float, free: float, blocked: float) -> float:
        while blocked - free > _FINE_DEG:
            middle = (free + blocked) / 2
            free, blocked = (middle, blocked) if self._is_clear(sign * middle) else (free, middle)
        return free

    def _is_clear(self, angle_deg: float) -> bool:
        turn = rotation(self._axis, math.radians(angle_deg))
        parts = [self._turned(placed, turn) if placed.index in self._moved else placed for placed in self._parts]
        return Occupancy(parts).is_free(self._moved, self._others, np.zeros(3))

    def _turned(self, placed: Placed, turn: Floats) -> Placed:
        position = turn @ (placed.position - self._point) + self._point
        return replace(placed, rotation=turn @ placed.rotation, position=position)


def _case(motor: Placed) -> Placed:
    """A motor without its disc, which turns with the driven parts."""
    sites = tuple(site for site in motor.part.sites if not site.turns)
    return replace(motor, part=replace(motor.part, turning=(), sites=sites))


def _carried(articulation: Articulation, body: int) -> set[int]:
    """A body and all its descendants."""
    carried = {body}
    for joint in articulation.joints:
        if joint.parent in carried:
            carried.add(joint.child)
    return carried
