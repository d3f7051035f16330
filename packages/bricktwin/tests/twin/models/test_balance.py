"""Balance of robots from plans: why one tips over."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from brickhub.finding import Outcome
from bricktwin.plans import ldraw_file
from bricktwin.plans.geometry import Form, rotation
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.mechanism.roles import roles_of
from bricktwin.plans.plan import Plan, make_plan, read_plan
from bricktwin.plans.planned_robot import planned_as_drawn, planned_robot
from bricktwin.robots import plans
from bricktwin.twin.models import balance
from bricktwin.twin.models.balance import (
    Balance,
    lean_on_one_axle_deg,
    plan_balance,
    plan_stance,
)
from bricktwin.twin.models.feet import Shape

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
    found = plan_balance(plan)
    assert found is not None
    (finding,) = found.findings
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


def post(ahead_mm: float, left_mm: float, half_height_mm: float = 50.0) -> Shape:
    """A thin post from the floor up, of a body that does not turn."""
    centre_m = np.array([ahead_mm, left_mm, half_height_mm]) / 1000
    return Shape(0, 0, Form.BOX, centre_m, np.eye(3), np.array([0.0, 0.0, half_height_mm]) / 1000)


FOUR = [post(x, y) for x in (100.0, -60.0) for y in (40.0, -50.0)]
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.mark.parametrize(
    ("centre_mm", "inside_mm", "side"),
    [
        ((20.0, -10.0), 40.0, "to the right"),
        ((20.0, 0.0), 40.0, "to the left"),
        ((70.0, -5.0), 30.0, "forwards"),
        ((-50.0, 0.0), 10.0, "backwards"),
        ((120.0, 0.0), -20.0, "forwards"),
        ((0.0, -70.0), -20.0, "to the right"),
    ],
)
def test_a_centre_of_mass_is_inside_of_the_nearest_side(
    centre_mm: tuple[float, float], inside_mm: float, side: str
) -> None:
    centre_m = np.array([*centre_mm, 80.0]) / 1000
    inside_m, nearest = balance._inside_m(FOUR, centre_m, DOWN)
    assert (1000 * inside_m, nearest) == (pytest.approx(inside_mm, abs=0.3), side)
    # A shape that ends 4 mm above the floor touches it not.
    raised = post(300.0, 0.0)
    raised = raised._replace(centre_m=raised.centre_m + np.array([0.0, 0.0, 0.004]))
    assert balance._inside_m([*FOUR, raised], centre_m, DOWN) == (inside_m, nearest)
    lower = post(300.0, 0.0)
    lower = lower._replace(centre_m=lower.centre_m + np.array([0.0, 0.0, 0.002]))
    if side == "forwards":
        assert balance._inside_m([*FOUR, lower], centre_m, DOWN)[0] > inside_m


@pytest.mark.parametrize("high_mm", [30.0, 80.0])
def test_a_robot_stands_if_its_mass_is_above_its_feet_and_tips_if_not(high_mm: float) -> None:
    stands = balance._rest(FOUR, np.array([0.0, 0.0, high_mm]) / 1000)
    assert balance._tilt_deg(stands) == 0.0
    # A robot on a tail behind, of 100 mm, and no feet in front: it rolls over its feet until
    # what is in front touches the floor.
    nose = post(200.0, 0.0, 30.0)
    nose = nose._replace(centre_m=nose.centre_m + np.array([0.0, 0.0, 0.040]))
    ahead_m = np.array([120.0, 0.0, high_mm]) / 1000
    rest = balance._rest([*FOUR, nose], ahead_m)
    # From the feet at 100 mm to the nose at 200 mm, which is 40 mm higher: atan(40 / 100).
    assert balance._tilt_deg(rest) == pytest.approx(math.degrees(math.atan(0.4)), abs=1.5)
    assert rest[0] > 0 and abs(rest[1]) < 0.05
    (height_m,) = balance._heights_m([*FOUR, nose], ahead_m, DOWN[None])
    assert height_m == pytest.approx(high_mm / 1000)


def test_what_touches_a_floor_is_the_lowest_of_each_form() -> None:
    half = np.array([0.01, 0.01, 0.03])
    lying = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    centre = np.array([0.1, 0.2, 0.3])
    ball = Shape(0, 0, Form.BALL, centre, np.eye(3), np.full(3, 0.01))
    assert balance._contacts_m(ball).tolist() == [pytest.approx([0.1, 0.2, 0.29])]
    wheel = Shape(0, 0, Form.CYLINDER, centre, lying, half, is_level=True)
    assert balance._contacts_m(wheel) == pytest.approx(
        np.array([[0.1, 0.17, 0.29], [0.1, 0.23, 0.29]])
    )
    box = Shape(0, 0, Form.BOX, centre, np.eye(3), half)
    corners = balance._contacts_m(box)
    assert sorted({round(float(z), 6) for z in corners[:, 2]}) == [0.27, 0.33]
    assert len({tuple(corner) for corner in corners.round(6)}) == 8


def test_a_shape_moves_with_its_body_in_a_turn() -> None:
    turn = rotation((0.0, 0.0, 1.0), math.pi / 2)
    turns = {3: (np.array([np.eye(3), turn]), np.array([[0.0] * 3, [0.0, 0.0, 0.5]]))}
    leg = post(100.0, 0.0)._replace(body=3)
    moved = balance._moved(leg, turns, 1)
    assert moved.centre_m == pytest.approx([0.0, 0.1, 0.55])
    assert moved.axes == pytest.approx(turn.T)
    assert balance._moved(leg, turns, 0).centre_m == pytest.approx(leg.centre_m)
    assert balance._moved(post(1.0, 1.0), turns, 1).body == 0
    bodies = [
        SimpleNamespace(mass_kg=3.0, centre_m=np.array([0.0, 0.0, 0.2])),
        SimpleNamespace(mass_kg=0.0, centre_m=np.zeros(3)),
        SimpleNamespace(mass_kg=0.0, centre_m=np.zeros(3)),
        SimpleNamespace(mass_kg=1.0, centre_m=np.array([0.1, 0.0, 0.1])),
    ]
    planned: Any = SimpleNamespace(articulation=SimpleNamespace(bodies=bodies))
    assert balance._centre_m(planned, turns, 1) == pytest.approx([0.0, 0.025, 0.3])


@pytest.mark.parametrize(
    ("changes", "outcome", "words"),
    [
        ({"tilt_deg": 12.0}, None, ""),
        ({"tilt_deg": 12.5}, Outcome.ERROR, "tips over forwards by 12 degrees"),
        ({"tilt_deg": 30.0, "on_wheels": True}, Outcome.ERROR, "or add a caster$"),
        ({"lean_deg": 14.0}, Outcome.WARNING, "on one axle alone.*, or let it learn to keep"),
        ({"lean_deg": -14.0}, Outcome.WARNING, "on one axle alone.*, or let it learn to keep"),
        ({"lean_deg": -16.0}, Outcome.ERROR, "on one axle alone, and falls; add a caster$"),
        ({"largest_tilt_deg": 45.0}, None, ""),
        ({"largest_tilt_deg": 46.0}, Outcome.ERROR, "falls forwards while its legs turn"),
    ],
)
def test_who_falls_by_itself_is_an_error_unless_its_motors_keep_it_upright(
    changes: dict[str, Any], outcome: Outcome | None, words: str
) -> None:
    found = replace(STANDS, **changes).findings
    assert [one.outcome for one in found] == ([] if outcome is None else [outcome])
    assert all(re.search(words, one.detail) for one in found)
