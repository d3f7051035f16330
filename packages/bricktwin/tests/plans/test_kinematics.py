"""Mechanisms of our plans against descriptions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plan_lines import BEAM, PLANS, plan_of

from bricktwin import robots
from bricktwin.plans.check import structure_of
from bricktwin.plans.mechanism.kinematics import Mechanism, mechanism
from bricktwin.plans.plan import read_plan


def mechanism_of(name: str) -> Mechanism:
    """The mechanism in the plan of a robot."""
    plan = read_plan(PLANS / f"{name}.ldr")
    return mechanism(plan, structure_of(plan).bodies)


def _ratios(name: str) -> dict[tuple[str, float, float, float], float]:
    """Turns of each hinge per turn of its motor, by port and position in mm."""
    made = mechanism_of(name)
    found = {}
    for hinge, row in zip(made.hinges, made.ratios, strict=True):
        motor = int(np.argmax(np.abs(row)))
        x, y, z = np.round(hinge.point_m * 1000, 1)
        found[made.ports[motor], x, y, z] = row[motor]
    return found


def test_single_part_has_mass_and_inertia_of_bar():
    plan = plan_of(BEAM)
    made = mechanism(plan, structure_of(plan).bodies)
    (link,) = made.links
    assert (made.hinges, made.ports) == ((), ())
    assert link.mass_kg == pytest.approx(0.001226, abs=1e-6)
    assert np.allclose(link.centre_m, 0, atol=1e-9)
    length, width = 0.0392, 0.008
    full = link.mass_kg * (length**2 + width**2) / 12
    assert 0.85 * full < link.inertia[1, 1] < full  # its ends are round, and it has holes
    assert np.linalg.eigvalsh(link.inertia).min() > 0


def test_two_wheeler_plan_matches_description():
    made, robot = mechanism_of("two_wheeler"), robots.TWO_WHEELER
    assert len(made.links) == 3
    assert made.ports == ("A", "E")
    assert np.allclose(made.ratios, np.eye(2))
    for wheel in made.wheels[1:]:
        assert wheel.diameter_mm == robot.drive_base.wheel_diameter_mm
        assert abs(wheel.centre_m[1]) * 2000 == pytest.approx(robot.drive_base.axle_track_mm)


def test_walker_plan_has_four_four_bar_legs():
    made = mechanism_of("walker")
    assert len(made.links) == 13
    assert sum(hinge.closes_loop for hinge in made.hinges) == 4
    assert sorted(made.ports) == ["A", "B", "C", "D"]
    places = np.round([hinge.point_m * 1000 for hinge in made.hinges], 1)
    # crank's axis and pin, and the rocker's pin on the chassis, from the hub's middle at -16 mm
    for end in (1, -1):
        for x, z in ((end * 64, -20), (end * 64, -28), (end * 32, 20)):
            assert np.sum(np.all(np.isclose(places[:, [0, 2]], [x, z], atol=0.1), axis=1)) >= 2, (
                end,
                x,
                z,
            )


@pytest.mark.parametrize("name", ["two_wheeler", "walker", "robo_arm"])
def test_the_order_of_the_lines_changes_no_hinge(name):
    plan = read_plan(PLANS / f"{name}.ldr")
    backwards = replace(
        plan, parts=tuple(replace(part, index=at) for at, part in enumerate(reversed(plan.parts)))
    )
    places = []
    for one in (plan, backwards):
        made = mechanism(one, structure_of(one).bodies)
        places.append(
            sorted(
                (*np.round(hinge.point_m, 6), *np.round(np.abs(hinge.axis), 6))
                for hinge in made.hinges
            )
        )
    assert np.allclose(places[0], places[1], atol=1e-6)


def test_robo_arm_plan_gears_match_description():
    ratios = _ratios("robo_arm")
    # the motor on the turntable walks around the teeth that stand fast
    assert ratios["B", 0, 0, 0] == pytest.approx(20 / 60)
    # the two beams of the lower arm turn on one axle: the hinge is in the middle between them
    assert ratios["D", 0, 0, 96] == pytest.approx(12 / 36)
    assert ratios["A", 0.0, 0.0, 208.0] == pytest.approx(-12 / 24)
    fingers = [ratios["E", 104.0, y, 208.0] for y in (24.0, -24.0)]
    assert fingers == [pytest.approx(0.5), pytest.approx(-0.5)]
    arm = robots.ROBO_ARM
    assert abs(ratios["B", 0, 0, 0]) == pytest.approx(
        arm.motor("rotation").gears[0] / arm.motor("rotation").gears[-1]
    )


def test_bare_motor_turns_its_shaft():
    plan = plan_of("0 !BRICKSRL PORT A arm", "1 4 0 0 0 1 0 0 0 1 0 0 0 1 54696.dat")
    made = mechanism(plan, structure_of(plan).bodies)
    assert [link.parts for link in made.links] == [(0,), ()]
    assert made.ratios.tolist() == [[1.0]]
