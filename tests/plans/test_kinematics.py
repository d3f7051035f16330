"""Mechanisms of our plans against descriptions and manual twins."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from plan_lines import BEAM, PLANS, plan_of

from bricksrl import robots
from bricksrl.plans.check import structure_of
from bricksrl.plans.mechanism.kinematics import Mechanism, mechanism
from bricksrl.plans.plan import read_plan
from bricksrl.twin.models import two_wheeler, walker
from bricksrl.twin.scene import Scene


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
    assert made.mass_kg == pytest.approx(0.001226, abs=1e-6)
    assert np.allclose(link.centre_m, 0, atol=1e-9)
    length, width = 0.0392, 0.008
    full = link.mass_kg * (length**2 + width**2) / 12
    assert 0.85 * full < link.inertia[1, 1] < full  # its ends are round, and it has holes
    assert np.linalg.eigvalsh(link.inertia).min() > 0


def test_two_wheeler_plan_matches_description_and_twin():
    made, robot = mechanism_of("two_wheeler"), robots.TWO_WHEELER
    spec = two_wheeler.build(robot, Scene())
    model = spec.compile()
    assert len(made.links) == 3
    assert made.ports == ("A", "E")
    assert np.allclose(made.ratios, np.eye(2))
    for wheel in made.wheels[1:]:
        assert wheel.diameter_mm == robot.drive_base.wheel_diameter_mm
        assert abs(wheel.centre_m[1]) * 2000 == pytest.approx(robot.drive_base.axle_track_mm)
    at = {one.name: one.point_m for one in made.mounted}
    assert np.allclose(at["prime"], model.site("imu").pos, atol=1e-3)
    assert np.allclose(at["eyes"], model.site("ultrasonic_C").pos, atol=2e-3)
    caster = made.wheels[0].centre_m - np.array([0, 0, 0.0184])
    assert np.allclose(caster, model.geom("caster").pos, atol=1e-3)
    twin_kg = float(model.body_subtreemass[model.body("chassis").id])
    assert made.mass_kg == pytest.approx(twin_kg, rel=0.12)
    centre = made.links[0].centre_m - model.body("chassis").ipos
    assert np.abs(centre).max() < 0.006


def test_walker_plan_legs_match_twin():
    made = mechanism_of("walker")
    model = walker.build(robots.WALKER, Scene()).compile()
    assert len(made.links) == 13
    assert sum(hinge.closes_loop for hinge in made.hinges) == 4
    assert sorted(made.ports) == ["A", "B", "C", "D"]
    places = np.round([hinge.point_m * 1000 for hinge in made.hinges], 1)
    for port, end in (("C", 1), ("A", -1)):
        crank = model.body(f"rotor_{port}").pos * 1000
        assert np.allclose(crank[[0, 2]], [end * 64, -20])
        for x, z in ((end * 64, -20), (end * 64, -28), (end * 32, 20)):
            assert np.any(np.all(np.isclose(places[:, [0, 2]], [x, z], atol=0.1), axis=1)), (port, x, z)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    top = next(hinge.point_m for hinge in made.hinges if hinge.closes_loop and hinge.point_m[0] > 0 > hinge.point_m[1])
    leg = data.body("leg_C")
    above = data.body("chassis").xpos + np.append(top[:1], [0, top[2]])
    end_of_thigh = leg.xpos + leg.xmat.reshape(3, 3) @ [0, 0, 0.040]
    assert np.allclose((above - end_of_thigh)[[0, 2]], 0, atol=1e-3)


@pytest.mark.parametrize("name", ["two_wheeler", "walker", "robo_arm"])
def test_the_order_of_the_lines_changes_no_hinge(name):
    plan = read_plan(PLANS / f"{name}.ldr")
    backwards = replace(plan, parts=tuple(replace(part, index=at) for at, part in enumerate(reversed(plan.parts))))
    places = []
    for one in (plan, backwards):
        made = mechanism(one, structure_of(one).bodies)
        places.append(sorted((*np.round(hinge.point_m, 6), *np.round(np.abs(hinge.axis), 6)) for hinge in made.hinges))
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
    assert abs(ratios["B", 0, 0, 0]) == pytest.approx(arm.motor("rotation").gears[0] / arm.motor("rotation").gears[-1])


def test_bare_motor_turns_its_shaft():
    plan = plan_of("0 !BRICKSRL PORT A arm", "1 4 0 0 0 1 0 0 0 1 0 0 0 1 54696.dat")
    made = mechanism(plan, structure_of(plan).bodies)
    assert [link.parts for link in made.links] == [(0,), ()]
    assert made.ratios.tolist() == [[1.0]]
