"""Rigid bodies, motions and gears."""

from __future__ import annotations

import numpy as np
import pytest
from plan_lines import body_of, plan_of

from bricktwin.plans.check import Structure, structure_of
from bricktwin.plans.connections import meshes
from bricktwin.plans.mechanism.kinematics import mechanism
from bricktwin.plans.plan import Plan

PLATE = "1 7 0 0 0 1 0 0 0 1 0 0 0 1 39369.dat"
UPRIGHT = "0 -1 0 1 0 0 0 0 1"
FLAT = "1 0 0 0 0 1 0 -1 0"


def shaft(x: float, z: float, *gears: str) -> list[str]:
    """A vertical axle of 4 in the plate with a bush below and gears above."""
    lines = [f"1 0 {x} -10 {z} {UPRIGHT} 3705.dat", f"1 0 {x} 20 {z} {FLAT} 3713.dat"]
    return lines + [
        f"1 4 {x} {-20 - 20 * level} {z} {FLAT} {number}.dat" for level, number in enumerate(gears)
    ]


def solved(*lines: str) -> tuple[Plan, Structure]:
    """A plan and its structure."""
    plan = plan_of(*lines)
    return plan, structure_of(plan)


def test_axle_with_gear_and_bush_does_not_slide():
    _, structure = solved(PLATE, *shaft(0, 0, "3648b"))
    assert [len(members) for members in structure.bodies.members] == [1, 3]
    assert structure.bodies.motions().shape == (12, 1)


def test_axle_without_bush_slides():
    _, structure = solved(PLATE, *(line for line in shaft(0, 0, "3648b") if "3713" not in line))
    assert structure.bodies.motions().shape[1] == 2


@pytest.mark.parametrize(
    ("first", "second", "distance"),
    [
        ("10928", "3648b", 40),
        ("3648b", "3648b", 60),
        ("94925", "94925", 40),
        ("32270", "32498", 60),
        ("18575", "46372", 60),
    ],
)
def test_gear_ratio_follows_teeth(first, second, distance):
    plan, structure = solved(PLATE, *shaft(0, 0, first), *shaft(distance, 0, second))
    assert [mesh.is_good for mesh in structure.meshes] == [True]
    motions = structure.bodies.motions()
    assert motions.shape[1] == 1
    teeth = [
        plan.parts[mesh].part.gears[0].teeth
        for mesh in (structure.meshes[0].first, structure.meshes[0].second)
    ]
    one, two = (
        body_of(structure.bodies, structure.meshes[0].first),
        body_of(structure.bodies, structure.meshes[0].second),
    )
    rates = [float(motions[6 * body + 4, 0]) for body in (one, two)]
    assert rates[0] * teeth[0] == pytest.approx(-rates[1] * teeth[1])


def test_ratio_follows_teeth_with_small_distance_error():
    # 12 and 24 teeth, 2 modules along and 1 across: 17.9 mm instead of 18.
    _, structure = solved(PLATE, *shaft(0, 0, "32270"), *shaft(40, 20, "3648b"))
    motions = structure.bodies.motions()
    bodies = [
        body_of(structure.bodies, part)
        for part in (structure.meshes[0].first, structure.meshes[0].second)
    ]
    first, second = (float(motions[6 * body + 4, 0]) for body in bodies)
    assert first == pytest.approx(-2 * second)


def test_three_gears_in_ring_lock():
    two = [PLATE, *shaft(0, 0, "94925"), *shaft(40, 0, "94925")]
    ring = [*two, *shaft(20, 40, "18575")]
    assert solved(*two)[1].bodies.motions().shape[1] == 1
    _, structure = solved(*ring)
    assert [mesh.is_good for mesh in structure.meshes] == [True] * 3
    assert structure.bodies.motions().shape[1] == 0


@pytest.mark.parametrize(
    ("first", "second", "at", "ahead"),
    [
        *(
            ("32270", "32270", 20, 20),
            ("32270", "18575", 30, 20),
            ("18575", "32270", 20, 30),
            ("32270", "32498", 50, 20),
        ),
        # A crown gear's teeth are in front of its hub, which is 2 LDU from its origin.
        *(
            ("3650c", "10928", 22, 20),
            ("3650c", "10928", 22, 40),
            ("3650c", "3648b", 42, 40),
            ("3650c", "32270", 27, 35),
        ),
    ],
)
def test_gears_at_right_angle_turn_at_the_ratio_of_their_teeth(first, second, at, ahead):
    # The axes, along z and x, meet at the origin; the teeth meet towards +x and -z.
    plan = plan_of(
        f"1 4 0 0 {-at} 1 0 0 0 1 0 0 0 1 {first}.dat",
        f"1 4 {ahead} 0 0 0 0 1 0 1 0 -1 0 0 {second}.dat",
    )
    (mesh,) = meshes(plan.parts)
    assert mesh.is_good
    about_z, about_x = mesh.motion[0][5], mesh.motion[1][3]
    teeth, other_teeth = (placed.part.gears[0].teeth for placed in plan.parts)
    # If the first turns by the other's teeth, counter-clockwise about +z, its teeth move towards
    # +y, and so do the other's.
    assert about_z * other_teeth + about_x * teeth == pytest.approx(0.0)
    # A carrier that turns both as one body does not strain the teeth.
    assert mesh.motion.sum(axis=0) == pytest.approx(np.zeros(6))


@pytest.mark.parametrize(
    ("first", "second", "at", "ahead", "is_good"),
    [
        # Of 20 teeth and 36, the cones are 29 and 61 degrees wide to a side.
        ("18575", "32498", 51.9, 30.0, True),
        ("18575", "32498", 52.2, 30.0, False),
        ("18575", "32498", 50.0, 31.1, True),
        ("18575", "32498", 50.0, 31.2, False),
        # The teeth of a crown gear stand along its axis.
        ("3650c", "10928", 22.9, 30.0, True),
        ("3650c", "10928", 23.1, 30.0, False),
    ],
)
def test_gear_that_is_off_along_its_axle_parts_its_teeth_by_the_slope_of_its_cone(
    first, second, at, ahead, is_good
):
    plan = plan_of(
        f"1 4 0 0 {-at} 1 0 0 0 1 0 0 0 1 {first}.dat",
        f"1 4 {ahead} 0 0 0 0 1 0 1 0 -1 0 0 {second}.dat",
    )
    (mesh,) = meshes(plan.parts)
    assert mesh.is_good == is_good


@pytest.mark.parametrize(("at", "ahead"), [(30, 20), (22, 55), (-22, 20)])
def test_crown_gear_does_not_reach_a_spur_gear_that_is_not_in_front_of_its_teeth(at, ahead):
    plan = plan_of(
        f"1 4 0 0 {-at} 1 0 0 0 1 0 0 0 1 3650c.dat",
        f"1 4 {ahead} 0 0 0 0 1 0 1 0 -1 0 0 10928.dat",
    )
    assert not any(mesh.is_good for mesh in meshes(plan.parts))


def test_worm_has_a_right_handed_thread_with_one_tooth_per_turn():
    lines = [
        PLATE,
        *shaft(0, 0, "3648b"),
        "1 0 0 -20 40 1 0 0 0 1 0 0 0 1 3706.dat",
        "1 7 0 -20 40 0 0 1 0 1 0 -1 0 0 4716.dat",
    ]
    plan, structure = solved(*lines)
    (mesh,) = structure.meshes
    assert mesh.is_good
    worm = mesh.motion[0 if plan.parts[mesh.first].part.number == "4716" else 1]
    gear = mesh.motion[1 if plan.parts[mesh.first].part.number == "4716" else 0]
    # A bolt that turns about its +x drives a nut that only slides towards -x.
    bolt, nut = worm @ [0, 0, 0, 1.0, 0, 0], gear @ [1.0, 0, 0, 0, 0, 0]
    assert -bolt / nut < 0
    # The gear, whose teeth meet the worm at +z, turns so that they move towards -x: about -y.
    assert -bolt / (gear @ [0, 0, 0, 0, 1.0, 0]) == pytest.approx(-1 / 24, rel=1e-3)


def _pinion(x: float, y: float, z: float, matrix: str = "1 0 0 0 1 0 0 0 1") -> list[str]:
    """A rack of 18 teeth along x, whose teeth are above it, and a gear of 8 teeth."""
    return ["1 4 0 0 0 1 0 0 0 1 0 0 0 1 87761.dat", f"1 7 {x} {y} {z} {matrix} 10928.dat"]


@pytest.mark.parametrize("x", [-69.0, 0.0, 69.0])
def test_gear_rolls_on_a_rack(x):
    (mesh,) = meshes(plan_of(*_pinion(x, -17.5, 5)).parts)
    assert mesh.is_good
    rack, gear = mesh.motion
    # A gear of radius 10, whose lowest teeth go along with a rack that slides by 1.
    turn = -0.1
    rolling = [-17.5 * turn, -x * turn, 0, 0, 0, turn]
    assert rack @ [1.0, 0, 0, 0, 0, 0] + gear @ rolling == pytest.approx(0.0)
    # A carrier that moves both as one body does not strain the teeth.
    assert mesh.motion.sum(axis=0) == pytest.approx(np.zeros(6))


@pytest.mark.parametrize(
    ("place", "matrix"),
    [
        ((-72, -17.5, 0), "1 0 0 0 1 0 0 0 1"),  # past its end
        ((72, -17.5, 0), "1 0 0 0 1 0 0 0 1"),
        ((0, -17.5, 7), "1 0 0 0 1 0 0 0 1"),  # beside it
        ((0, 17.5, 0), "1 0 0 0 1 0 0 0 1"),  # below it, where it has no teeth
        ((0, -17.5, 0), "0 0 1 0 1 0 -1 0 0"),  # turned so that it would roll across it
        ((0, -17.5, 0), "1 0 0 0 0 1 0 -1 0"),  # lying on it
    ],
)
def test_gear_beside_a_rack_does_not_mesh(place, matrix):
    assert meshes(plan_of(*_pinion(*place, matrix)).parts) == []


def test_gear_that_is_too_high_above_a_rack_meshes_badly():
    (mesh,) = meshes(plan_of(*_pinion(0, -20.5, 0)).parts)
    assert not mesh.is_good
    assert mesh.fault == "are 1.2 mm too far apart; move one"


def test_motor_turns_parts_on_shaft():
    motor = ["0 !BRICKSRL PORT A left", "1 15 0 0 0 1 0 0 0 1 0 0 0 1 54696p02.dat"]
    axle = "1 0 0 -60 0 0 -1 0 1 0 0 0 0 1 4519.dat"
    wheel = f"1 7 0 -70 0 {FLAT} 39367p02.dat"
    plan, structure = solved(*motor, axle, wheel)
    made = mechanism(plan, structure.bodies)
    (hinge,) = made.hinges
    assert hinge.port == "A"
    assert np.allclose(hinge.axis, [0, 0, 1])  # up: the shaft points to -y in the plan
    assert np.allclose(made.ratios, [[1.0]])
    assert structure.bodies.motions(locked=[0]).shape[1] == 0


def test_differential_averages_axles():
    """Gears of 12 on both axles and on the peg."""
    plan, structure = solved(
        "1 4 0 0 0 1 0 0 0 1 0 0 0 1 62821.dat",
        "1 7 0 0 -17.5 1 0 0 0 1 0 0 0 1 6589.dat",
        "1 7 0 0 17.5 -1 0 0 0 1 0 0 0 -1 6589.dat",
        "1 7 17.5 0 0 0 0 -1 0 1 0 1 0 0 6589.dat",
        "1 0 0 0 -40 0 0 1 0 1 0 -1 0 0 4519.dat",
        "1 0 0 0 40 0 0 1 0 1 0 -1 0 0 4519.dat",
    )
    bodies = structure.bodies
    assert sum(mesh.is_good for mesh in structure.meshes) == 2
    motions = bodies.motions()
    left, right = (motions[6 * body_of(bodies, part) + 5] for part in (1, 2))
    assert np.abs(left).max() > 0.1
    # the first body, at rest, is the differential itself
    assert np.allclose(left, -right, atol=1e-6)
    assert [plan.parts[part].part.name for part in bodies.members[0]] == ["Differential 28"]


@pytest.mark.parametrize("ring", ["65413", "69761"])
def test_differential_of_five_gears_averages_axles(ring):
    """Three gears of 12 on the pegs, between those on both axles; clips hold the two halves."""
    pegs = [(0.0, -1.0), (0.866, 0.5), (-0.866, 0.5)]
    plan, structure = solved(
        "1 4 0 0 -20 1 0 0 0 1 0 0 0 1 65414.dat",
        f"1 4 0 0 20 1 0 0 0 1 0 0 0 1 {ring}.dat",
        "1 7 0 0 -17 1 0 0 0 1 0 0 0 1 6589.dat",
        "1 7 0 0 17 -1 0 0 0 1 0 0 0 -1 6589.dat",
        *(f"1 7 {17 * x} {17 * y} 0 {-y} 0 {-x} {x} 0 {-y} 0 -1 0 6589.dat" for x, y in pegs),
        "1 0 0 0 -40 0 0 1 0 1 0 -1 0 0 4519.dat",
        "1 0 0 0 40 0 0 1 0 1 0 -1 0 0 4519.dat",
    )
    bodies = structure.bodies
    assert sum(mesh.is_good for mesh in structure.meshes) == 6
    assert [plan.parts[part].part.number for part in bodies.members[0]] == ["65414", ring]
    motions = bodies.motions()
    left, right = (motions[6 * body_of(bodies, part) + 5] for part in (2, 3))
    assert np.abs(left).max() > 0.1
    assert np.allclose(left, -right, atol=1e-6)


def test_studs_connect_plates_and_bricks():
    brick, plate = "1 4 0 0 0 1 0 0 0 1 0 0 0 1 3001.dat", "1 4 20 -8 0 0 0 1 0 1 0 -1 0 0 3022.dat"
    _, structure = solved(brick, plate)
    assert len(structure.connections) == 4
    assert all(link.is_rigid and link.is_seated for link in structure.connections)
    assert structure.bodies.members == ((0, 1),)
    _, apart = solved(brick, plate.replace("-8 0", "-12 0"))
    assert apart.connections == ()


def test_pin_fits_technic_brick_not_studs():
    pin = "1 0 0 10 10 0 0 1 0 1 0 -1 0 0 2780.dat"
    _, structure = solved(
        "1 4 0 0 0 1 0 0 0 1 0 0 0 1 3700.dat", pin, pin.replace("0 10 10", "10 -2 0")
    )
    assert [(link.male, link.female) for link in structure.connections] == [(1, 0)]
