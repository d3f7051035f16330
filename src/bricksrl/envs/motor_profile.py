"""Motion profile of the firmware: the angle that a motor covers in a fixed time when it gets a new target while it turns.

A new command of the firmware's ``run_angle`` starts where the reference of the last one is, at its speed: speed up, cruise, slow
down, each with constant acceleration, towards the place that is so many degrees further on. This is that trajectory in closed
form (as in Pybricks' ``pbio/trajectory.c``), without the rounding of the firmware's integers and without the motor's lag behind
its reference: together less than two degrees, which a test holds against the firmware's own answers.
"""

from __future__ import annotations

import torch
from torch import Tensor

ACCELERATION_DEG_S2 = 2000.0
"""What Pybricks speeds up and slows down with, for every motor of the robots here."""


def turn_on(turn_deg: Tensor, speed_deg_s: Tensor, limit_deg_s: Tensor, time_s: float) -> tuple[Tensor, Tensor]:
    """Degrees turned after ``time_s``, and the speed then.

    Args:
        turn_deg: the command ``[*batch]``, from where the motor is; negative for the other direction.
        speed_deg_s: when the command comes ``[*batch]``.
        limit_deg_s: of the command, above 0; broadcast against the others.
    """
    a = ACCELERATION_DEG_S2
    sign = turn_deg.sign()
    way = turn_deg.abs()
    # A start that is too fast to stop in time is taken for the fastest from which that is possible.
    start = torch.minimum(sign * speed_deg_s, (2.0 * a * way).sqrt())
    back = torch.where(start < 0, start.square() / (2.0 * a), 0.0)
    top = torch.minimum((2.0 * a * (way + back)).sqrt(), limit_deg_s)
    first = torch.where(start < top, a, -a)
    origin = -start.square() / (2.0 * first)  # where the first ramp, drawn on, has speed zero
    ramped = origin + top.square() / (2.0 * first)
    braking = way - top.square() / (2.0 * a)
    meet = braking < ramped  # too short for the limit: the ramps meet halfway, without a cruise
    ramped = torch.where(meet, (origin + way) / 2.0, ramped)
    braking = torch.where(meet, ramped, braking)
    top = torch.where(meet, (2.0 * first * (ramped - origin)).clamp_min(0.0).sqrt(), top)
    t1 = (top - start) / first
    t2 = t1 + torch.where(top > 0, (braking - ramped) / top.clamp_min(1e-6), 0.0)
    u1, u3 = t1.clamp_max(time_s), (time_s - t2).clamp_min(0.0).minimum(top / a)
    cruise = (time_s - t1).clamp_min(0.0).minimum(t2 - t1)
    turned = start * u1 + first * u1.square() / 2.0 + top * (cruise + u3) - a * u3.square() / 2.0
    speed = torch.where(time_s < t1, start + first * u1, top - a * u3)
    return sign * turned, sign * speed
