"""Lines of test plans."""

from __future__ import annotations

import math
from pathlib import Path

from brickhub.finding import Finding
from bricktwin.plans import ldraw_file
from bricktwin.plans.bodies import Bodies
from bricktwin.plans.check import check
from bricktwin.plans.geometry import Form
from bricktwin.plans.part import Part
from bricktwin.plans.plan import Plan, make_plan
from bricktwin.robots import plans
from bricktwin.robots.planned import check_named

PLANS = Path(plans.__path__[0])
ROBOTS = sorted(path.stem for path in PLANS.glob("*.ldr"))
BEAM = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat"


def pin(x: float, y: float, z: float) -> str:
    """A pin along y."""
    return f"1 0 {x} {y} {z} 0 0 1 1 0 0 0 1 0 2780.dat"


def plan_of(*lines: str) -> Plan:
    """A plan from lines."""
    return make_plan(ldraw_file.parse("\n".join(lines), "try.ldr"))


def findings_of(plan: Plan) -> list[Finding]:
    """All findings, including those against the robot's description."""
    return check(plan) + check_named(plan)


def body_of(bodies: Bodies, part: int) -> int:
    """Index of the body with a part or a motor's case."""
    return next(number for number, members in enumerate(bodies.members) if part in members)


def solid_volume(part: Part) -> float:
    """Volume of a part's solids, LDU³; they may overlap."""
    volume = 0.0
    for solid in (*part.solids, *part.turning):
        first, second, third = solid.half
        volume += {
            Form.BOX: 8 * first * second * third,
            Form.BALL: 4 / 3 * math.pi * first**3,
            Form.CYLINDER: 2 * math.pi * first**2 * third,
            Form.RING: 2 * math.pi * (first**2 - second**2) * third,
        }[solid.form]
    return volume
