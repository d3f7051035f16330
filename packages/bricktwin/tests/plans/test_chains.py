"""Chains over gears."""

from __future__ import annotations

import math

import numpy as np
import pytest
from chain_lines import chain
from plan_lines import body_of, plan_of
from test_bodies import PLATE, shaft

from brickhub.robot import HubKind
from bricktwin.plans.check import check, structure_of
from bricktwin.plans.connections import chain_meshes
from bricktwin.plans.planned_robot import planned
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.mujoco_body import MujocoBody
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

DRIVEN = [
    "0 !BRICKSRL FIXED",
    "0 !BRICKSRL PORT A motor",
    "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
    "1 0 0 -60 0 0 -1 0 1 0 0 0 0 1 4519.dat",
    "1 4 0 -70 0 1 0 0 0 0 1 0 -1 0 3648b.dat",
    "1 0 0 30 140 0 0 1 1 0 0 0 1 0 2780.dat",
    "1 1 0 40 -20 0 0 1 1 0 0 0 1 0 6558.dat",
    "1 0 0 40 80 1 0 0 0 1 0 0 0 1 32278.dat",
    "1 0 0 50 180 0 0 1 1 0 0 0 1 0 2780.dat",
    "1 15 20 50 80 -1 0 0 0 -1 0 0 0 1 67718.dat",
    "1 0 0 -10 220 0 -1 0 1 0 0 0 0 1 3707.dat",
    "1 7 0 60 220 1 0 0 0 0 1 0 -1 0 3713.dat",
    "1 7 0 20 220 1 0 0 0 0 1 0 -1 0 3713.dat",
    "1 4 0 -70 220 1 0 0 0 0 1 0 -1 0 3649.dat",
    *chain((0, 0, 24), (0, 220, 40), -70),
]
"""A motor turns an axle with a gear of 40 teeth by a chain over its own gear of 24; both axles are
vertical."""


@pytest.mark.parametrize(
    ("first", "second", "teeth"),
    [("3648b", "3648b", (24, 24)), ("10928", "3649", (8, 40)), ("3649", "94925", (40, 16))],
)
def test_chained_gears_turn_the_same_way_at_the_ratio_of_their_teeth(first, second, teeth):
    links = chain((0, -80, teeth[0]), (20, 80, teeth[1]), -20)
    plan = plan_of(PLATE, *shaft(0, -80, first), *shaft(20, 80, second), *links)
    structure = structure_of(plan)
    (mesh,) = structure.meshes
    motions = structure.bodies.motions()
    assert motions.shape[1] == 1
    one, two = (
        float(motions[6 * body_of(structure.bodies, part) + 4, 0])
        for part in (mesh.first, mesh.second)
    )
    assert one * teeth[0] == pytest.approx(two * teeth[1])
    assert {found.name for found in check(plan)} <= {"half-held"}  # the gears turn freely


@pytest.mark.parametrize(
    ("first", "second", "teeth"), [("3648b", "3649", (24, 40)), ("3649", "10928", (40, 8))]
)
def test_a_chain_pulls_along_the_line_that_touches_both_gears(first, second, teeth):
    links = chain((0, -80, teeth[0]), (20, 80, teeth[1]), -20)
    (mesh,) = chain_meshes(
        plan_of(PLATE, *shaft(0, -80, first), *shaft(20, 80, second), *links).parts
    )
    assert mesh.error == mesh.parted == 0.0 and mesh.engaged == 1.0 and mesh.is_good
    row, other_row = mesh.motion
    tangent = row[:3]
    assert np.linalg.norm(tangent) == pytest.approx(1.0) and tangent[1] == pytest.approx(0.0)
    assert other_row[:3] == pytest.approx(-tangent)
    # Of a force along the tangent, the arm about each axle is the gear's radius.
    for (x, z), count, moment in (((0, -80), teeth[0], row), ((20, 80), teeth[1], -other_row)):
        about_axle = moment[3:] - np.cross([x, 0.0, z], tangent)
        assert abs(about_axle[1]) == pytest.approx(1.25 * count)
    # It touches the first gear in its point, and both on the same side of it.
    from_axle = mesh.point - np.array([0.0, mesh.point[1], -80.0])
    assert np.linalg.norm(from_axle) == pytest.approx(1.25 * teeth[0])
    assert from_axle @ tangent == pytest.approx(0.0)
    # A carrier that turns both as one body strains no link.
    assert mesh.motion.sum(axis=0)[3:] == pytest.approx([0.0] * 3, abs=1e-6)


def test_gear_in_the_place_of_another_is_a_finding():
    number = next(number for number, line in enumerate(DRIVEN) if "3648b" in line)
    assert [found.name for found in check(plan_of(*DRIVEN[: number + 1], *DRIVEN[number:]))] == [
        "collision"
    ]


def test_motor_drives_twin_through_chain(tmp_path):
    plan = plan_of(*DRIVEN)
    assert check(plan) == []
    made = planned(plan)
    assert [train.gears for train in made.trains if train.port == "A"] == [(24, 40)]
    assert sorted(part for body in made.articulation.bodies for part in body.parts) == list(
        range(len(plan.parts))
    )
    path = tmp_path / "driven.ldr"
    path.write_text("\n".join(DRIVEN))
    quiet = Physics(distance_noise_mm=0, distance_noise_ratio=0, tilt_noise_deg=0, backlash_deg=0)
    one = MujocoBody(robot_of_plan(path, hub=HubKind.PRIME), OPEN_FLOOR, quiet, 0)
    one.set_voltage("A", 4000)
    one.advance_to(700)
    motor = one.angle_mdeg("A") / 1000
    driven = one.data.body("driven_A").xmat.reshape(3, 3)
    assert motor > 60
    # Clockwise from above is negative about the vertical; a chain keeps the direction.
    assert math.degrees(math.atan2(driven[1, 0], driven[0, 0])) == pytest.approx(
        -motor * 24 / 40, abs=1.5
    )


def test_broken_chain_turns_nothing():
    gears = [PLATE, *shaft(0, -80, "3648b"), *shaft(0, 80, "3648b")]
    links = chain((0, -80, 24), (0, 80, 24), -20)
    assert len(links) == 32
    assert len(chain_meshes(plan_of(*gears, *links).parts)) == 1
    assert chain_meshes(plan_of(*gears, *links[:-1]).parts) == []


def test_gear_beside_a_chain_is_not_turned():
    gears = [PLATE, *shaft(0, -80, "3648b"), *shaft(0, 80, "3648b"), *shaft(60, 0, "3648b")]
    plan = plan_of(*gears, *chain((0, -80, 24), (0, 80, 24), -20))
    (mesh,) = chain_meshes(plan.parts)
    assert {round(plan.parts[part].position[2]) for part in (mesh.first, mesh.second)} == {-80, 80}


def test_gear_inside_a_chain_that_no_link_touches_is_not_turned():
    gears = [PLATE, *shaft(0, -80, "3648b"), *shaft(0, 80, "3648b"), *shaft(0, 0, "94925")]
    plan = plan_of(*gears, *chain((0, -80, 24), (0, 80, 24), -20))
    assert len(chain_meshes(plan.parts)) == 1
    assert structure_of(plan).bodies.motions().shape[1] == 2


def test_two_equal_chains_turn_together():
    gears = [PLATE, *shaft(0, -80, "3648b", "10928"), *shaft(0, 80, "3648b", "10928")]
    plan = plan_of(
        *gears, *chain((0, -80, 24), (0, 80, 24), -20), *chain((0, -80, 8), (0, 80, 8), -40)
    )
    assert len(chain_meshes(plan.parts)) == 2
    assert structure_of(plan).bodies.motions().shape[1] == 1


def test_gear_across_a_chain_is_not_turned():
    """Its middle is in the plane of the chain, and links lie on its teeth, but its axle does not
    point as theirs do."""
    gears = [PLATE, *shaft(0, -80, "3648b"), *shaft(0, 80, "3648b")]
    links = chain((0, -80, 24), (0, 80, 24), -20)
    plan = plan_of(*gears, *links)
    (mesh,) = chain_meshes(plan.parts)
    upright = plan.parts[mesh.first]
    x, y, z = upright.position
    across = f"1 4 {x:g} {y:g} {z:g} 1 0 0 0 1 0 0 0 1 3648b.dat"
    lines = [line for line in gears if f" {x:g} {y:g} {z:g} " not in line]
    assert len(lines) == len(gears) - 1
    assert chain_meshes(plan_of(*lines, across, *links).parts) == []
