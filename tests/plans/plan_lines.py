"""Lines of test plans."""

from __future__ import annotations

from pathlib import Path

from bricksrl.finding import Finding
from bricksrl.plans import ldraw_file
from bricksrl.plans.check import check
from bricksrl.plans.plan import Plan, make_plan
from bricksrl.robots import plans
from bricksrl.robots.planned import check_named

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
