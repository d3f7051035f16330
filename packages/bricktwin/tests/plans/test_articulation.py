"""Gear trains, articulations, poses and end stops of plans."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from plan_lines import PLANS, plan_of
from test_bodies import FLAT, PLATE, shaft

from brickhub.errors import PlanError
from bricktwin.plans.check import structure_of
from bricktwin.plans.mechanism.kinematics import mechanism, merged
from bricktwin.plans.planned_robot import PlannedRobot, free_deg, planned, planned_robot
from bricktwin.twin.models.linkage import Linkage

WALKERS = Path(__file__).parents[4] / "examples" / "walkers"
HUB = "1 15 200 0 0 1 0 0 0 1 0 0 0 1 67718.dat"


def robot(name: str) -> PlannedRobot:
    """The robot of one of our plans."""
    return planned_robot(PLANS / f"{name}.ldr")


@pytest.mark.parametrize(
    ("name", "port", "gears", "gear"),
    [
        ("two_wheeler", "A", (), 1),
        ("walker", "D", (), 1),
        ("robo_arm", "B", (20, 60), 3),
        ("robo_arm", "D", (12, 36), 3),
        ("robo_arm", "A", (12, 24), -2),
        ("robo_arm", "E", (12, 24), -2),
    ],
)
def test_motors_drive_same_as_manual_twins(name, port, gears, gear):
    made = robot(name)
    assert [train.gears for train in made.trains if train.port == port] == [gears]
    (drive,) = [one for one in made.articulation.drives if one.port == port]
    assert drive.gear == pytest.approx(gear)


def test_gear_pairs_multiply_idler_does_not():
    def gears(*teeth: int) -> tuple[int, ...]:
        from bricktwin.plans.mechanism.kinematics import Train

        return Train("A", 1, 1.0, teeth, ()).gears

    assert gears(12, 20, 20, 60) == (12, 60)
    assert gears(8, 24, 8, 40) == (1, 15)
    assert gears(12, 36) == (12, 36)
    assert gears() == ()


@pytest.mark.parametrize(
    ("name", "bodies", "drives", "rods", "geared", "followers", "is_fixed"),
    [
        ("two_wheeler", 3, 2, 0, 0, 0, False),
        ("walker", 9, 4, 4, 0, 0, False),
        ("robo_arm", 6, 4, 0, 1, 6, True),
    ],
)
def test_simplification_keeps_all_parts(name, bodies, drives, rods, geared, followers, is_fixed):
    made = robot(name)
    found = made.articulation
    counts = tuple(
        map(len, (found.bodies, found.drives, found.rods, found.geared, found.followers))
    )
    assert counts == (bodies, drives, rods, geared, followers)
    assert (found.loops, found.is_fixed) == ((), is_fixed)
    whole, before = (
        merged(list(found.bodies)),
        merged(list(mechanism(made.plan, structure_of(made.plan).bodies).links)),
    )
    assert whole.mass_kg == pytest.approx(before.mass_kg)
    # A rod has half of its mass at either pin, so its own middle may be elsewhere by a little.
    assert np.allclose(whole.centre_m, before.centre_m, atol=1e-4)
    parts = [part for body in found.bodies for part in body.parts] + [
        part for rod in found.rods for part in rod.parts
    ]
    assert sorted(parts) == list(range(len(made.plan.parts)))


@pytest.mark.parametrize(
    ("name", "swings", "rods"),
    [("four_legs_two_motors", 4, 4), ("klann_legs", 8, 8), ("six_legs_two_motors", 0, 0)],
)
def test_cranks_behind_gears_are_geared_and_their_legs_are_not(name, swings, rods):
    made = planned_robot(WALKERS / f"{name}.ldr")
    found = made.articulation
    assert (len(found.drives), len(found.swings), len(found.rods)) == (2, swings, rods)
    assert found.loops == ()
    cranks = [found.bodies[geared.joint.child] for geared in found.geared]
    for crank in cranks:
        assert any(made.plan.parts[part].part.gears for part in crank.parts)
    assert {abs(geared.ratio) for geared in found.geared} == {1.0}
    # A leg is as light as a rod, but its foot is beyond its pins.
    rod_parts = {made.plan.parts[part].part.number for rod in found.rods for part in rod.parts}
    assert not rod_parts & {"41239", "32009"}


def test_free_wheel_is_a_swing():
    axle = [PLATE, *shaft(0, 0, "39367p02")]
    made = planned(plan_of(*axle))
    assert len(made.articulation.swings) == 1
    assert made.articulation.drives == ()


def test_free_axle_is_no_swing():
    made = planned(plan_of(PLATE, *shaft(0, 0, "3713")))
    assert (len(made.articulation.bodies), made.articulation.swings) == (1, ())


def test_two_motors_on_one_axle_raise():
    motors = [
        "0 !BRICKSRL PORT A",
        "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
        "0 !BRICKSRL PORT B",
        "1 15 0 -120 0 1 0 0 0 -1 0 0 0 -1 54696p02.dat",
        "1 0 0 -60 0 0 -1 0 1 0 0 0 0 1 3706.dat",
        f"1 7 0 -60 0 {FLAT} 39367p02.dat",
        *(f"1 0 30 {y} 20 1 0 0 0 0 -1 0 1 0 2780.dat" for y in (20, -20, -100, -140)),
        "1 4 40 -60 20 0 1 0 0 0 1 1 0 0 40490.dat",
    ]
    with pytest.raises(PlanError, match="the same part") as caught:
        planned(plan_of(*motors))
    assert "\n" not in str(caught.value)


def motors_side_by_side(*gears: str) -> list[str]:
    """Two motors with shared pins, 60 LDU apart, each with an axle and a gear."""
    lines: list[str] = []
    for port, x, gear in zip("AB", (0, 60), gears, strict=True):
        lines += [
            f"0 !BRICKSRL PORT {port}",
            f"1 15 {x} 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
            f"1 0 {x} -60 0 0 -1 0 1 0 0 0 0 1 3706.dat",
            f"1 7 {x} -60 0 {FLAT} {gear}.dat",
        ]
    return lines + [f"1 0 30 {y} 20 1 0 0 0 0 -1 0 1 0 2780.dat" for y in (20, -20)]


@pytest.mark.parametrize(
    ("gears", "together"),
    [(("3648b", "3648b"), (("A", "B"),)), (("3648b", "10928"), ())],
)
def test_motors_whose_gears_mesh_are_geared_together(gears, together):
    assert planned(plan_of(*motors_side_by_side(*gears))).geared_together == together


def test_motor_whose_shaft_is_pinned_to_its_case_raises():
    motor = ["0 !BRICKSRL PORT A", "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"]
    beam = [f"1 0 30 {y} 20 1 0 0 0 0 -1 0 1 0 2780.dat" for y in (20, -20, -60)]
    beam += [
        "1 4 40 -60 20 0 1 0 0 0 1 1 0 0 40490.dat",
        "1 7 20 -60 20 0 0 1 0 1 0 -1 0 0 3167.dat",
    ]
    with pytest.raises(
        PlanError, match="the motor of port A drives the same part as another one, or nothing"
    ):
        planned(plan_of(*motor, *beam, "1 0 20 -50 0 0 0 1 1 0 0 0 1 0 2780.dat"))


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([HUB, "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"], "line 2: .* has no port"),
        (
            [
                "0 !BRICKSRL PORT A",
                "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
                "0 !BRICKSRL PORT A",
                "1 15 90 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat",
            ],
            "line 4: port A is used twice",
        ),
        (["1 15 0 0 0 1 0 0 0 1 0 0 0 1 99999.dat"], "no part that the catalogue knows"),
    ],
)
def test_plan_without_robot_raises(lines, says):
    with pytest.raises(PlanError, match=says):
        planned(plan_of(*lines))


def test_error_names_the_file_as_it_was_given(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.ldr").write_text("1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat")
    with pytest.raises(PlanError, match=r"^arm.ldr, line 1: .* has no port"):
        planned_robot(Path("arm.ldr"))


def moved(linkage, part, point):
    """Place of a point of a part."""
    turn, shift = linkage.motion(part)
    return turn @ point + shift


def test_walker_legs_turn_fully():
    made = robot("walker").articulation
    linkage = Linkage(made)
    assert linkage.free == ()
    leg = next(drive.joint.child for drive in made.drives if drive.port == "C")
    leg = next(swing.child for swing in made.swings if swing.parent == leg)
    foot = np.array([0.0674, -0.056, -0.0840])
    parts = [body.parts[0] for body in made.bodies]
    places = []
    for turned in range(0, 360, 20):
        linkage.turn({"motor_C": math.radians(turned)})
        places.append(moved(linkage, parts[leg], foot))
        for rod in made.rods:
            apart = moved(linkage, parts[rod.far], rod.far_m) - moved(
                linkage, parts[rod.near], rod.near_m
            )
            assert np.linalg.norm(apart) == pytest.approx(
                np.linalg.norm(rod.far_m - rod.near_m), abs=2e-5
            )
            for end, point in ((rod.near, rod.near_m), (rod.far, rod.far_m)):
                assert moved(linkage, rod.parts[0], point) == pytest.approx(
                    moved(linkage, parts[end], point), abs=2e-5
                )
    stride, across, lift = np.ptp(places, axis=0) * 1000
    assert (stride, across, lift) == (
        pytest.approx(38.4, abs=1.0),
        pytest.approx(0, abs=1e-6),
        pytest.approx(16.0, abs=0.5),
    )


def test_visual_gears_counter_rotate():
    made = robot("robo_arm").articulation
    linkage = Linkage(made)
    linkage.turn({"motor_A": math.radians(90.0)})
    (motor_gear,) = [one for one in made.followers if one.port == "A"]
    shaft_turn, _ = linkage.motion(motor_gear.parts[0])
    drive = next(one for one in made.drives if one.port == "A")
    forearm, _ = linkage.motion(made.bodies[drive.joint.child].parts[0])
    assert np.allclose(shaft_turn @ [0, 1, 0], [0, 1, 0])
    # The motor turns by 90 degrees, the forearm by half of that the other way.
    first, second = (
        math.degrees(math.atan2(turn[0, 2], turn[0, 0])) for turn in (shaft_turn, forearm)
    )
    assert abs(first) == pytest.approx(90.0)
    assert second == pytest.approx(-first / 2)


def test_arm_stops_at_collision():
    made = robot("robo_arm")
    assert free_deg(made, "D", 0.0, 80.0)[1] == 80.0
    low, high = free_deg(made, "A", -300.0, 20.0)
    assert -200 < low < -170
    assert high == 20.0
