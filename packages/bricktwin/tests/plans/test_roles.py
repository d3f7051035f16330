"""What a motor of a plan moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from plan_lines import BEAM, plan_of

from bricktwin.plans.geometry import M_PER_LDU
from bricktwin.plans.mechanism.articulation import Articulation, Drive, Geared, Rod
from bricktwin.plans.mechanism.kinematics import Hinge, Link
from bricktwin.plans.mechanism.roles import _lowest_on_its_way_m, moved_by

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
