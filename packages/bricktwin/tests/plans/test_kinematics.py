"""Mechanisms of our plans against descriptions."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, PLANS, plan_of

from bricktwin import robots
from bricktwin.plans import catalogue
from bricktwin.plans.check import structure_of
from bricktwin.plans.mechanism.kinematics import (
    Hinge,
    Link,
    Mechanism,
    Train,
    _ratio,
    _unit_inertia,
    is_balanced,
    mechanism,
    merged,
    share_axis,
)
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


def solid_link(part: int, mass_kg: float, centre_m: Any, moments: Any) -> Link:
    return Link((part,), mass_kg, np.array(centre_m), np.diag(moments))


def test_merged_links_are_one_body_about_their_common_centre() -> None:
    """Two weights of 1 and 3 kg, 40 cm apart along y."""
    light = solid_link(4, 1.0, (0.1, -0.3, 0.0), (0.01, 0.02, 0.03))
    heavy = solid_link(7, 3.0, (0.1, 0.1, 0.0), (0.1, 0.2, 0.3))
    both = merged([light, heavy])
    assert both.parts == (4, 7) and both.mass_kg == 4.0
    assert both.centre_m == pytest.approx([0.1, 0.0, 0.0])
    # As one mass of 0.75 kg at that distance, about x and z; along y nothing is added.
    steiner = 0.75 * 0.4**2
    assert both.inertia == pytest.approx(np.diag([0.11 + steiner, 0.22, 0.33 + steiner]))
    # It makes no difference in which order they are merged, nor whether by twos.
    third = solid_link(1, 0.5, (0.0, 0.2, 0.3), (0.0, 0.0, 0.0))
    at_once, by_twos = merged([light, heavy, third]), merged([merged([third, light]), heavy])
    assert at_once.inertia == pytest.approx(by_twos.inertia)
    assert at_once.centre_m == pytest.approx(by_twos.centre_m)


@pytest.mark.parametrize(
    ("number", "size_ldu", "centre_ldu"),
    [
        # A beam's holes take little of its bar; a plate is a box but for its studs.
        ("32525", (220.0, 20.0, 18.0), (0.0, 0.0, 0.0)),
        ("3024", (20.0, 8.0, 20.0), None),
    ],
)
def test_inertia_of_a_part_is_near_that_of_its_box(
    number: str, size_ldu: Any, centre_ldu: Any
) -> None:
    part = catalogue.get(number)
    low, high = part.bounds
    sides_m = np.sort((high - low) * 0.0004)
    centre, inertia = _unit_inertia(part)
    if centre_ldu is not None:
        assert centre == pytest.approx(centre_ldu, abs=0.5)
    assert (centre > low).all() and (centre < high).all()
    moments = np.sort(np.linalg.eigvalsh(inertia))[::-1]
    box = [(sides_m @ sides_m - side**2) / 12 for side in sides_m]
    assert moments == pytest.approx(box, rel=0.35)
    assert sorted(high - low) == pytest.approx(sorted(size_ldu), abs=8.0)


@pytest.mark.parametrize(
    ("teeth", "gears", "ratio"),
    [
        ((), (), 1.0),
        ((12, 36), (12, 36), 1 / 3),
        # An idler changes no ratio.
        ((12, 20, 20, 36), (12, 36), 1 / 3),
        ((12, 36, 20, 20), (12, 36), 1 / 3),
        # Two steps are one pair of the same ratio, in its lowest terms.
        ((12, 36, 12, 36), (1, 9), 1 / 9),
        ((8, 24, 12, 20), (1, 5), 1 / 5),
        ((36, 12, 8, 24), (1, 1), 1.0),
        ((1, 24), (1, 24), 1 / 24),
    ],
)
def test_a_train_is_a_pair_of_gears_of_the_same_ratio(teeth: Any, gears: Any, ratio: float) -> None:
    assert _ratio(teeth) == pytest.approx(ratio)
    train = Train("A", 3, ratio, teeth, ((1, 1.0), (2, -0.5)))
    assert train.gears == gears and train.hinges == {1, 2, 3}


@pytest.mark.parametrize(
    ("changes", "is_shared"),
    [
        ({}, True),
        ({"point_m": np.array([0.1, 0.2, 5.0])}, True),
        ({"point_m": np.array([0.1009, 0.2, 0.0])}, True),
        ({"point_m": np.array([0.1011, 0.2, 0.0])}, False),
        ({"axis": np.array([0.0, 0.0, -1.0])}, True),
        ({"axis": np.array([0.019, 0.0, 1.0])}, True),
        ({"axis": np.array([0.021, 0.0, 1.0])}, False),
        ({"is_ball": True}, False),
    ],
)
def test_hinges_on_one_line_share_an_axis(changes: Any, is_shared: bool) -> None:
    first = Hinge(0, 1, np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0]), None, False)
    other = replace(first, **{"point_m": np.array([0.1, 0.2, 0.3]), **changes})
    assert share_axis(first, other) is is_shared
    assert share_axis(other, first) is is_shared


@pytest.mark.parametrize(("aside_m", "balanced"), [(0.0, True), (0.019, True), (0.021, False)])
def test_a_link_is_balanced_by_its_mass_times_its_distance_from_the_axis(
    aside_m: float, balanced: bool
) -> None:
    axis = Hinge(0, 1, np.zeros(3), np.array([0.0, 1.0, 0.0]), None, False)
    link = solid_link(0, 0.5, (aside_m, 0.7, 0.0), (0.0, 0.0, 0.0))
    made: Any = SimpleNamespace(links=(link, link))
    assert is_balanced(made, axis, 1, 0.01) is balanced
