"""What a motor of a plan moves."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, plan_of

from bricktwin.plans.geometry import M_PER_LDU
from bricktwin.plans.mechanism.articulation import Articulation, Drive, Geared, Rod
from bricktwin.plans.mechanism.kinematics import Hinge, Link, Wheel
from bricktwin.plans.mechanism.motor_role import Role
from bricktwin.plans.mechanism.roles import (
    _lowest_on_its_way_m,
    lowest_point_m,
    moved_by,
    roles_of,
)

X = np.array([1.0, 0.0, 0.0])
ORIGIN = np.zeros(3)


def hinge(parent: int, child: int, port: str | None = None) -> Hinge:
    return Hinge(parent, child, ORIGIN, X, port, closes_loop=False)


def drive(port: str, child: int) -> Drive:
    return Drive(port, hinge(0, child, port), 1.0, 0.0, ())


def legs(*linked: tuple[int, int], rods: tuple[tuple[int, int], ...] = ()) -> Articulation:
    """A chassis, 0, with the cranks 1 and 2 of the motors A and B; the crank 3, geared to A; the
    legs 4, 5 and 6, which hang on the cranks 1, 2 and 3; and the link 7, on the chassis."""
    return Articulation(
        bodies=(),
        is_fixed=False,
        drives=(drive("A", 1), drive("B", 2)),
        geared=(Geared("A", hinge(0, 3), -1.0),),
        swings=(hinge(1, 4), hinge(2, 5), hinge(3, 6), hinge(0, 7)),
        loops=tuple(hinge(*ends) for ends in linked),
        followers=(),
        rods=tuple(Rod(near, ORIGIN, far, ORIGIN, ()) for near, far in rods),
        wheels=(),
    )


def test_a_motor_moves_what_its_cranks_carry() -> None:
    found = [moved_by(legs(), one) for one in legs().drives]
    assert found == [{1, 3, 4, 6}, {2, 5}]


@pytest.mark.parametrize("ends", [(4, 7), (7, 4)])
def test_a_motor_moves_what_a_loop_or_a_rod_takes_along(ends: tuple[int, int]) -> None:
    for made in (legs(ends), legs(rods=(ends,))):
        assert [moved_by(made, one) for one in made.drives] == [{1, 3, 4, 6, 7}, {2, 5}]


def test_a_motor_moves_neither_the_chassis_nor_the_crank_of_another() -> None:
    made = legs((0, 4), (5, 1))
    assert [moved_by(made, one) for one in made.drives] == [{1, 3, 4, 5, 6}, {2, 5}]


def test_lowest_point_on_a_way_all_around_is_straight_below_the_axis() -> None:
    # A beam of 5 modules that lies on its motor's axis, and a bush in its middle.
    plan = plan_of(BEAM, "1 7 0 0 0 1 0 0 0 1 0 0 0 1 3713.dat")
    body = Link((0, 1), 0.0, ORIGIN, np.eye(3))
    along_y = replace(hinge(0, 1, "A"), axis=np.array([0.0, 1.0, 0.0]))
    level = replace(drive("A", 1), joint=along_y)
    made = replace(legs(), bodies=(body, body))
    half_m = np.abs(plan.parts[0].part.bounds[1]) * M_PER_LDU
    reach_m = math.hypot(half_m[1], half_m[2])
    assert _lowest_on_its_way_m(plan, made, level) == pytest.approx(-reach_m)
    # About an upright axis it stays as high as it is.
    upright = replace(level, joint=replace(along_y, axis=np.array([0.0, 0.0, 1.0])))
    assert _lowest_on_its_way_m(plan, made, upright) == pytest.approx(-half_m[1], abs=1e-3)


def part_at(low_mm: float, **marks: Any) -> Any:
    """A part whose lowest corner is at a height, 10 mm ahead of the origin; in the plan's axes."""
    corners = np.array([[0.0, -low_mm / 0.4, 25.0], [0.0, -(low_mm + 8.0) / 0.4, -25.0]])
    marked = {"port": None, "stops_deg": None, **marks}
    return SimpleNamespace(
        part=SimpleNamespace(corners=corners), to_plan=lambda points: points, **marked
    )


def robot_of(
    lows_mm: tuple[float, ...],
    axis: Any = (0.0, 1.0, 0.0),
    height_mm: float = 0.0,
    wheels: tuple[int, ...] = (),
    **values: Any,
) -> tuple[Any, Articulation]:
    """A chassis and bodies that motors A, B, ... turn, each of one part with its lowest point at a
    height; the axes of all are at one height, and ahead of it by as much as the parts."""
    parts = [part_at(low, port=port) for low, port in zip(lows_mm, "?ABCD", strict=False)]
    point_m = np.array([0.01, 0.0, height_mm / 1000])
    drives = tuple(
        Drive(
            "ABCD"[number],
            replace(hinge(0, number + 1), point_m=point_m, axis=np.array(axis)),
            1.0,
            0.0,
            (),
        )
        for number in range(len(lows_mm) - 1)
    )
    made = Articulation(
        bodies=tuple(Link((number,), 0.1, ORIGIN, np.eye(3)) for number in range(len(parts))),
        is_fixed=False,
        drives=drives,
        geared=(),
        swings=(),
        loops=(),
        followers=(),
        rods=(),
        wheels=tuple(Wheel(link, ORIGIN, 56.0, link) for link in wheels),
    )
    return SimpleNamespace(parts=parts), replace(made, **values)


@pytest.mark.parametrize(
    ("axis", "role"),
    [
        ((0.0, 1.0, 0.0), Role.WHEEL),
        ((0.0, -1.0, 0.0), Role.WHEEL),
        # A wheel that is a little askew still rolls; one that lies turns like a top.
        ((0.0, 0.88, 0.475), Role.WHEEL),
        ((0.0, 0.86, 0.51), Role.STEERING),
        ((0.0, 0.0, -1.0), Role.STEERING),
    ],
)
def test_a_motor_rolls_a_wheel_about_a_level_axis(axis: Any, role: Role) -> None:
    plan, made = robot_of((0.0, 0.0), axis, wheels=(1,))
    assert roles_of(plan, made) == {"A": role}


def test_a_motor_that_carries_wheels_about_an_upright_axis_steers() -> None:
    plan, made = robot_of((0.0, 10.0, 10.0), (0.0, 0.0, 1.0), wheels=(3,))
    made = replace(made, swings=(hinge(1, 3),), bodies=(*made.bodies, made.bodies[0]))
    # The wheel hangs on what A turns; what B turns carries none.
    assert roles_of(plan, made) == {"A": Role.STEERING, "B": Role.JOINT}
    level = tuple(
        replace(one, joint=replace(one.joint, axis=np.array([0.0, 1.0, 0.0])))
        for one in made.drives
    )
    assert roles_of(plan, replace(made, drives=level)) == {"A": Role.JOINT, "B": Role.JOINT}


def test_what_comes_below_the_chassis_on_its_way_is_a_leg() -> None:
    """A part 10 mm before and behind its axis, which is 30 mm high, reaches below the chassis."""
    plan, made = robot_of((20.0, 18.0, 18.0), height_mm=30.0)
    lowest_mm = 1000 * _lowest_on_its_way_m(plan, made, made.drives[0])
    assert lowest_mm < 18.0
    assert roles_of(plan, made) == {"A": Role.LEG, "B": Role.LEG}
    # A robot that rolls does not walk, nor one on a table.
    assert roles_of(plan, replace(made, wheels=(Wheel(0, ORIGIN, 56.0, 0),))) == {
        "A": Role.JOINT,
        "B": Role.JOINT,
    }
    assert set(roles_of(plan, replace(made, is_fixed=True)).values()) == {Role.JOINT}
    # What has end stops turns back before it has made a step.
    plan.parts[1].stops_deg = (-30.0, 30.0)
    assert roles_of(plan, made) == {"A": Role.JOINT, "B": Role.LEG}


def test_the_only_leg_above_the_floor_is_the_boom_of_a_crane() -> None:
    # Its way goes below the chassis, but it is drawn above.
    for low_mm, role in ((21.2, Role.JOINT), (20.8, Role.LEG), (19.0, Role.LEG)):
        plan, made = robot_of((20.0, low_mm), height_mm=5.0)
        assert roles_of(plan, made) == {"A": role}, low_mm
    # Two of them are legs.
    plan, made = robot_of((20.0, 21.2, 21.2), height_mm=5.0)
    assert set(roles_of(plan, made).values()) == {Role.LEG}


@pytest.mark.parametrize(
    ("foot_mm", "is_leg"), [(40.0, True), (40.9, True), (41.1, False), (63.0, False)]
)
def test_feet_of_a_linkage_are_where_they_are_drawn(foot_mm: float, is_leg: bool) -> None:
    """About an upright axis nothing goes down; a foot hangs on the second motor's crank."""
    plan, made = robot_of((40.0, 90.0, 90.0), (0.0, 0.0, 1.0))
    plan.parts.append(part_at(foot_mm))
    foot = Link((3,), 0.1, ORIGIN, np.eye(3))
    made = replace(made, bodies=(*made.bodies, foot), swings=(hinge(2, 3),))
    found = roles_of(plan, made)
    assert found["A"] is Role.JOINT
    # Alone it must not be drawn above what stands still, like a boom.
    assert found["B"] is (Role.LEG if is_leg else Role.JOINT)


def test_a_foot_is_no_higher_than_a_crank_lifts_it() -> None:
    """24 mm above the lowest point of all."""
    for floor_mm, is_leg in ((16.1, True), (15.9, False)):
        plan, made = robot_of((50.0, 90.0, 90.0, 90.0), (0.0, 0.0, 1.0))
        for low_mm in (floor_mm, 40.0):
            plan.parts.append(part_at(low_mm))
        feet = tuple(Link((number,), 0.1, ORIGIN, np.eye(3)) for number in (4, 5))
        made = replace(made, bodies=(*made.bodies, *feet), swings=(hinge(1, 4), hinge(2, 5)))
        found = roles_of(plan, made)
        assert found["A"] is Role.LEG and found["C"] is Role.JOINT
        assert found["B"] is (Role.LEG if is_leg else Role.JOINT)
    assert lowest_point_m(plan, made) == pytest.approx(0.0159)
