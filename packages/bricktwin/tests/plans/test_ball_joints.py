"""Ball joints: towballs in the sockets of steering links."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from plan_lines import plan_of

from bricktwin.plans.check import check, structure_of
from bricktwin.plans.plan import read_plan
from bricktwin.plans.planned_robot import planned, planned_robot
from bricktwin.twin.models.linkage import Linkage

CAR = Path(__file__).with_name("link_steered.ldr")
BEAM = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 32316.dat"
TOWBALL = "1 0 0 10 40 0 0 1 -1 0 0 0 -1 0 6628.dat"
LINK = "1 71 0 20 40 1 0 0 0 1 0 0 0 1 32005.dat"


def test_car_with_ball_jointed_links_is_well():
    assert check(read_plan(CAR)) == []


def test_links_become_rods_and_steer_both_wheels():
    made = planned_robot(CAR).articulation
    knuckles = [number for number, swing in enumerate(made.swings) if abs(swing.axis[2]) > 0.9]
    assert (len(made.rods), len(knuckles), made.loops) == (2, 2, ())
    assert sorted(np.linalg.norm(rod.far_m - rod.near_m) for rod in made.rods) == pytest.approx(
        [0.040, 0.064]
    )
    linkage = Linkage(made)
    for steered in (-30, 15):
        linkage.turn({"motor_A": math.radians(steered)})
        turns = [
            linkage.motion(made.bodies[made.swings[number].child].parts[0])[0]
            for number in knuckles
        ]
        assert [
            math.degrees(math.atan2(turn[1, 0], turn[0, 0])) for turn in turns
        ] == pytest.approx([steered, steered], abs=0.01)


def test_link_on_one_ball_moves_in_three_ways():
    structure = structure_of(plan_of(BEAM, TOWBALL, LINK))
    (joint,) = [one for one in structure.connections if one.is_ball]
    assert (joint.male, joint.female) == (1, 2)
    assert joint.point == pytest.approx([0, 20, 40])
    assert structure.bodies.members == ((0, 1), (2,))
    assert structure.bodies.motions().shape == (12, 3)


def test_hanging_link_must_be_meant_to_swing():
    (found,) = check(plan_of(BEAM, TOWBALL, LINK))
    assert (found.name, found.line) == ("half-held", 3)
    assert check(plan_of(BEAM, TOWBALL, "0 !BRICKSRL FREE", LINK)) == []


def test_towball_that_is_there_twice_welds_nothing():
    bodies = structure_of(plan_of(BEAM, TOWBALL, TOWBALL, LINK)).bodies
    assert bodies.members == ((0, 1, 2), (3,))
    assert bodies.motions().shape == (12, 3)


@pytest.mark.parametrize("shift", [4, -4])
def test_ball_beside_its_socket_is_loose(shift):
    names = {
        one.name for one in check(plan_of(BEAM, TOWBALL, LINK.replace("0 20 40", f"{shift} 20 40")))
    }
    assert {"loose", "half-held", "step"} <= names


def test_ball_joint_turns_about_its_ball():
    made = planned(plan_of(BEAM, TOWBALL, "0 !BRICKSRL FREE", LINK)).articulation
    (swing,) = made.swings
    assert swing.is_ball
    linkage = Linkage(made)
    assert len(linkage.free) == 3
    linkage.turn(dict(zip(linkage.free, (0.3, -0.2, 0.5), strict=True)))
    turn, shift = linkage.motion(made.bodies[swing.child].parts[0])
    assert turn @ swing.point_m + shift == pytest.approx(swing.point_m)
    assert np.trace(turn) < 2.8
    assert np.allclose(turn @ turn.T, np.eye(3))
