"""Balance of robots from plans: why one tips over."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from brickhub.finding import Outcome
from bricktwin.plans import ldraw_file
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.mechanism.roles import roles_of
from bricktwin.plans.plan import Plan, make_plan, read_plan
from bricktwin.plans.planned_robot import planned_as_drawn, planned_robot
from bricktwin.robots import plans
from bricktwin.twin.models.balance import (
    Balance,
    lean_on_one_axle_deg,
    plan_balance,
    plan_stance,
)

OURS = sorted(Path(plans.__path__[0]).glob("*.ldr"))
DRAWN = Path(__file__).parents[5] / "examples"
BALANCER = DRAWN / "drawings" / "balancer.ldr"
EXAMPLES = sorted(path for path in DRAWN.glob("**/*.ldr") if path != BALANCER)
STANDS = Balance(
    mass_g=400.0,
    height_mm=60.0,
    inside_mm=-34.0,
    side="forwards",
    tilt_deg=3.0,
    largest_tilt_deg=8.0,
    on_wheels=False,
)


def without(path: Path, *numbers: str) -> Plan:
    """A plan without some parts, and without what it says about them."""
    unwanted = (*numbers, "!BRICKSRL ROBOT", "!BRICKSRL PARTS")
    lines = path.read_text().splitlines()
    kept = [line for line in lines if not any(word in line for word in unwanted)]
    return make_plan(ldraw_file.parse("\n".join(kept), "try.ldr"))


def fault_of(plan: Plan) -> str:
    balance = plan_balance(plan)
    assert balance is not None
    (finding,) = balance.findings
    assert finding.name == "balance"
    assert "\n" not in finding.detail
    return finding.detail


@pytest.mark.parametrize("path", [*OURS, *EXAMPLES], ids=lambda path: path.stem)
def test_our_robots_stand(path: Path) -> None:
    assert plan_stance(read_plan(path)) == []


def test_robot_on_one_axle_falls_unless_its_motors_keep_it_upright() -> None:
    (finding,) = plan_stance(read_plan(BALANCER))
    assert finding.outcome is Outcome.WARNING
    assert finding.detail == (
        "it stands on one axle alone, and falls; add a caster, or let it learn to keep upright"
    )


def test_lean_of_a_robot_is_that_with_its_mass_above_its_axle() -> None:
    assert lean_on_one_axle_deg(planned_robot(BALANCER)) == pytest.approx(0.0, abs=0.5)
    for path in (*OURS, *EXAMPLES):
        assert lean_on_one_axle_deg(planned_robot(path)) is None


def test_wheels_that_hang_in_the_air_are_a_finding() -> None:
    rover = next(path for path in EXAMPLES if path.stem == "rover")
    # With smaller wheels it stands on its caster and its color sensor.
    text = rover.read_text().replace(" 49295p02.dat", " 39367p02.dat")
    plan = make_plan(ldraw_file.parse(text, "try.ldr"))
    (finding,) = plan_stance(plan)
    assert finding.name == "wheels"
    assert "its driven wheels do not touch the floor" in finding.detail


def test_robot_without_its_caster_tips_over() -> None:
    path = next(path for path in OURS if path.stem == "two_wheeler")
    detail = fault_of(without(path, "39370"))
    assert "tips over backwards" in detail
    # It would be in balance where its wheels cannot get below it any more.
    assert detail.endswith("behind its back wheels; move the hub forwards, or add a caster")


def test_robot_without_its_tail_tips_over() -> None:
    path = next(path for path in EXAMPLES if path.stem == "two_legs")
    assert "behind its back feet" in fault_of(without(path, "32526.dat"))


def test_caster_or_feet_that_carry_the_robot_are_no_finding() -> None:
    path = next(path for path in EXAMPLES if path.stem == "six_legs_two_motors")
    balance = plan_balance(read_plan(path))
    assert balance is not None
    # Its six legs are 120 mm apart from front to back.
    assert 20 < balance.inside_mm < 60
    assert balance.tilt_deg < 3


def test_balance_is_of_robots_that_can_move_around() -> None:
    arm = next(path for path in OURS if path.stem == "robo_arm")
    assert plan_balance(read_plan(arm)) is None
    assert plan_balance(without(OURS[0], "95646", "54696", "67718")) is None


def test_crane_that_stands_on_its_hub_has_no_legs() -> None:
    path = next(path for path in EXAMPLES if path.stem == "crane")
    free = without(path, "FIXED", "STOPS")
    robot = planned_as_drawn(free)
    assert set(roles_of(robot.plan, robot.articulation).values()) == {Role.JOINT}
    assert plan_balance(free) is None


def test_an_unknown_part_may_be_the_caster() -> None:
    path = next(path for path in OURS if path.stem == "two_wheeler")
    text = path.read_text().replace("39370c01", "99999c01").replace("!BRICKSRL ROBOT", "//")
    plan = make_plan(ldraw_file.parse(text, "try.ldr"))
    assert plan.unknown
    assert plan_balance(plan) is None


def test_what_is_said_names_side_and_remedy() -> None:
    assert STANDS.fault is None
    assert replace(STANDS, tilt_deg=30.0).fault == (
        "it tips over forwards by 30 degrees: its centre of mass, 60 mm high, is 34 mm in front of "
        "its front feet; move the hub back, or make its feet longer there"
    )
    falls = replace(STANDS, side="to the left", largest_tilt_deg=80.0)
    assert falls.fault is not None
    assert falls.fault.startswith("it falls to the left while its legs turn (400 g): its centre")
    assert str(replace(STANDS, inside_mm=12.0)) == (
        "its centre of mass is 60 mm high, 12 mm inside of its feet"
    )


def test_robot_whose_mass_is_above_the_edge_is_not_beyond_it() -> None:
    above = replace(STANDS, inside_mm=0.2, tilt_deg=16.0)
    assert above.fault is not None
    assert "60 mm high, is right above the edge of its feet; move the hub" in above.fault
