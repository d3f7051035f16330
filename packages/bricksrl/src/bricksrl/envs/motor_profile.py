"""Motion profile of the firmware: the angle that a motor covers in a fixed time when it gets a new target while it turns.

The firmware's ``run_angle`` starts at the position and speed of the previous command's reference and follows a trapezoidal speed
profile (accelerate, cruise, decelerate) to the target, which is relative to that position. This is the trajectory in closed form
(as in Pybricks' ``pbio/trajectory.c``), without the firmware's integer rounding and the motor's lag behind its reference:
together less than two degrees, which a test checks against the firmware's values.
"""

from __future__ import annotations

import torch
from torch import Tensor

ACCELERATION_DEG_S2 = 2000.0
"""Acceleration and deceleration in Pybricks, for every motor of our robots."""


def turned_angle(turn_deg: Tensor, speed_deg_s: Tensor, limit_deg_s: Tensor, time_s: float) -> tuple[Tensor, Tensor]:
    """Angle turned after ``time_s`` (deg) and the speed then (deg/s).

    Args:
        turn_deg: commanded angle ``[*batch]``, relative to the present position; signed.
        speed_deg_s: speed when the command arrives ``[*batch]``.
        limit_deg_s: speed limit of the command, above 0; broadcast against the others.
    """
    a = ACCELERATION_DEG_S2
    sign = turn_deg.sign()
    distance = turn_deg.abs()
    # A start speed too high to stop in time is clipped to the highest from which stopping is possible.
    start = torch.minimum(sign * speed_deg_s, (2.0 * a * distance).sqrt())
    back = torch.where(start < 0, start.square() / (2.0 * a), 0.0)
    top = torch.minimum((2.0 * a * (distance + back)).sqrt(), limit_deg_s)
    first = torch.where(start < top, a, -a)
    origin = -start.square() / (2.0 * first)  # position where the first ramp, extrapolated, has speed zero
    ramped = origin + top.square() / (2.0 * first)
    braking = distance - top.square() / (2.0 * a)
    is_triangular = braking < ramped  # too short to reach the limit: triangular profile, without a cruise
    ramped = torch.where(is_triangular, (origin + distance) / 2.0, ramped)
    braking = torch.where(is_triangular, ramped, braking)
    top = torch.where(is_triangular, (2.0 * first * (ramped - origin)).clamp_min(0.0).sqrt(), top)
    t1 = (top - start) / first
    t2 = t1 + torch.where(top > 0, (braking - ramped) / top.clamp_min(1e-6), 0.0)
    u1, u3 = t1.clamp_max(time_s), (time_s - t2).clamp_min(0.0).minimum(top / a)
    cruise = (time_s - t1).clamp_min(0.0).minimum(t2 - t1)
    turned = start * u1 + first * u1.square() / 2.0 + top * (cruise + u3) - a * u3.square() / 2.0
    speed = torch.where(time_s < t1, start + first * u1, top - a * u3)
    return sign * turned, sign * speed
