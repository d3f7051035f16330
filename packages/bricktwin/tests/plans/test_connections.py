"""Connections between two parts: how deep, how far off, and what holds; gears by their contact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, pin, plan_of

from bricktwin.plans.connections import (
    Connection,
    Mesh,
    connections,
    graph_of,
    meshes,
    neighbours,
    open_holes,
    reached,
)
from bricktwin.plans.part import Fit

UPRIGHT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation of a pin along y, as `pin` has it."""


def placed(number: str, place: Any, turn: Any = UPRIGHT, colour: int = 0) -> str:
    values = [*place, *np.asarray(turn).ravel()]
    return " ".join(["1", str(colour), *(f"{value:.9g}" for value in values), f"{number}.dat"])


def one_of(*lines: str) -> Connection:
    (found,) = connections(plan_of(*lines).parts)
    return found


@pytest.mark.parametrize(
    ("height", "depth", "is_seated"),
    [
        # The hole is from -10 to 10, the pin is 40 long.
        (-10.0, 20.0, True),
        (0.0, 20.0, True),
        (-15.9, 14.1, True),
        (16.1, 13.9, False),
        (-26.4, 3.6, False),
        (26.4, 3.6, False),
    ],
)
def test_a_pin_is_as_deep_in_its_hole_as_both_overlap(
    height: float, depth: float, is_seated: bool
) -> None:
    found = one_of(BEAM, pin(0, height, 20))
    assert (found.male, found.female) == (1, 0)
    assert found.depth == pytest.approx(depth) and found.is_seated is is_seated
    # In the middle of what both share.
    low, high = max(-10.0, height - 20.0), min(10.0, height + 20.0)
    assert found.point == pytest.approx([0.0, (low + high) / 2, 20.0])
    assert abs(found.axis[1]) == 1.0
    assert found.fits and not found.is_axle and not found.is_ball and not found.is_rigid


@pytest.mark.parametrize("place", [(0, 26.6, 20), (0, -26.6, 20), (1.3, 0, 20), (0, 0, 21.3)])
def test_a_pin_beside_its_hole_or_hardly_in_it_does_not_hold(place: Any) -> None:
    assert connections(plan_of(BEAM, pin(*place)).parts) == []
    nearer = (0.9 * place[0], 0.98 * place[1], 20 + 0.9 * (place[2] - 20))
    assert len(connections(plan_of(BEAM, pin(*nearer)).parts)) == 1


@pytest.mark.parametrize(("tilt_deg", "holds"), [(1.6, True), (1.8, False), (-1.6, True)])
def test_a_pin_that_is_tilted_holds_up_to_a_limit(tilt_deg: float, holds: bool) -> None:
    tilt = math.radians(tilt_deg)
    turn = np.array(
        [[math.cos(tilt), -math.sin(tilt), 0], [math.sin(tilt), math.cos(tilt), 0], [0, 0, 1]]
    )
    plan = plan_of(BEAM, placed("2780", (0, 0, 20), turn @ UPRIGHT))
    assert len(connections(plan.parts)) == holds


@pytest.mark.parametrize(
    ("turn_deg", "is_crossed"),
    [
        (0.0, False),
        (5.5, False),
        (6.5, True),
        (45.0, True),
        (84.5, False),
        (90.0, False),
        (180.0, False),
        (-83.0, True),
    ],
)
def test_the_cross_of_an_axle_fits_after_a_quarter_of_a_turn(
    turn_deg: float, is_crossed: bool
) -> None:
    turn = math.radians(turn_deg)
    about_z = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    along_z = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    found = one_of(placed("3705", (0, 0, 0), along_z), placed("3648b", (0, 0, 5), about_z))
    assert found.is_crossed is is_crossed
    assert found.is_rigid and found.is_axle and found.fits
    # Of 80 and 20, all of the gear.
    assert found.depth == pytest.approx(20.0) and found.point == pytest.approx([0.0, 0.0, 5.0])


def test_a_pin_does_not_fit_where_an_axle_does_but_an_axle_turns_in_a_round_hole() -> None:
    along_z = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    in_cross = one_of(placed("2780", (0, 0, 0), along_z), placed("3648b", (0, 0, 5), np.eye(3)))
    assert not in_cross.fits and in_cross.female_site.fit is Fit.AXLE_HOLE
    in_round = one_of(BEAM, placed("3705", (0, 0, 20)))
    assert in_round.fits and in_round.is_axle and not in_round.is_rigid
    assert not in_round.is_crossed


@pytest.mark.parametrize(
    ("shift", "count"),
    [((0.0, 0.0, 0.0), 1), ((2.4, 0.0, 0.0), 1), ((2.6, 0.0, 0.0), 0), ((0.0, 90.0, 0.0), 1)],
)
def test_a_way_in_is_open_where_a_hole_is_in_line_however_far(shift: Any, count: int) -> None:
    beam, peg = plan_of(BEAM, pin(0, 0, 20)).parts
    found = open_holes(peg, np.array(shift), beam)
    assert [site.centre for site in found] == [(0.0, 0.0, 20.0)] * count
    assert open_holes(beam, np.zeros(3), peg) == []


def test_what_is_reached_in_a_graph_is_all_that_hangs_together() -> None:
    graph = graph_of([(1, 2), (2, 3), (5, 6)])
    assert sorted(graph[2]) == [1, 3]
    assert reached([1], graph) == {1, 2, 3} and reached([5, 3], graph) == {1, 2, 3, 5, 6}
    assert reached([9], graph) == {9}
    beam_and_pins = connections(plan_of(BEAM, pin(0, -10, 20), pin(0, -10, -20)).parts)
    found = neighbours(beam_and_pins)
    assert sorted(found[0]) == [1, 2] and found[1] == found[2] == [0]
    # What something unknown holds together is next to a node of its own.
    held = neighbours([], [frozenset({3, 4}), frozenset({7})])
    assert sorted(held[-1]) == [3, 4] and held[-2] == [7] and held[4] == [-1]


def pair(number: str, other: str, apart: float, along: float = 0.0) -> Mesh:
    (found,) = meshes(
        plan_of(
            placed(number, (0, 0, 0), np.eye(3)), placed(other, (apart, 0, along), np.eye(3))
        ).parts
    )
    return found


@pytest.mark.parametrize(
    ("apart", "along", "is_good", "fault"),
    [
        (40.0, 0.0, True, None),
        (40.9, 0.0, True, None),
        (39.1, 0.0, True, None),
        (41.1, 0.0, False, "are 0.4 mm too far apart; move one"),
        (36.0, 0.0, False, "are 1.6 mm too close; move one"),
        (40.0, 5.9, True, None),
        (40.0, 6.1, False, "meet over only 70 % of their width; shift one along its axle"),
        (40.0, -15.0, False, "meet over only 25 % of their width; shift one along its axle"),
        (44.0, 15.0, False, "are 1.6 mm too far apart; move one"),
    ],
)
def test_spur_gears_mesh_at_their_distance_and_over_their_width(
    apart: float, along: float, is_good: bool, fault: str | None
) -> None:
    """8 and 24 teeth, of 2.5 LDU of radius for a tooth."""
    found = pair("3647", "3648b", apart, along)
    assert found.error == found.parted == pytest.approx(apart - 40.0)
    assert found.engaged == pytest.approx(1.0 - abs(along) / 20.0)
    assert found.is_good is is_good
    if fault is not None:
        assert found.fault.replace("\N{NO-BREAK SPACE}", " ") == fault
    # Where the pitch circles touch, half way along both.
    assert found.point == pytest.approx([apart / 4, 0.0, along / 2])


@pytest.mark.parametrize(
    ("apart", "along"), [(49.5, 0.0), (30.5, 0.0), (40.0, 19.5), (40.0, -30.0), (0.0, 0.0)]
)
def test_gears_that_have_nothing_to_do_with_each_other_do_not_mesh(
    apart: float, along: float
) -> None:
    lines = (
        placed("3647", (0, 0, 0), np.eye(3)),
        placed("3648b", (apart, 0, along), np.eye(3)),
    )
    assert meshes(plan_of(*lines).parts) == []


def test_a_mesh_allows_the_rates_at_which_teeth_roll_on_one_another() -> None:
    found = pair("3647", "3648b", 40.0)

    def slip(first: float, second: float, second_at: Any = (40.0, 0.0, 0.0)) -> float:
        """Of two gears that turn about z at these rates, the second one about its own axis."""
        rates = []
        for rate, at in ((first, (0.0, 0.0, 0.0)), (second, second_at)):
            spin = np.array([0.0, 0.0, rate])
            rates.append(np.concatenate([np.cross(at, spin), spin]))
        return float((found.motion * np.array(rates)).sum())

    assert slip(3.0, -1.0) == pytest.approx(0.0) and slip(-6.0, 2.0) == pytest.approx(0.0)
    assert abs(slip(3.0, 1.0)) > 1.0 and abs(slip(0.0, 1.0)) > 1.0


@pytest.mark.parametrize(
    ("place", "holds"),
    [
        # Exactly at the limits: 1.2 LDU beside the hole, and 3.5 LDU deep in it.
        ((1.2, 0, 20), False),
        ((1.1999, 0, 20), True),
        ((0, 26.5, 20), False),
        ((0, 26.499, 20), True),
        ((0, -26.5, 20), False),
        ((0, -26.499, 20), True),
    ],
)
def test_a_pin_exactly_at_a_limit_does_not_hold(place: Any, holds: bool) -> None:
    assert len(connections(plan_of(BEAM, pin(*place)).parts)) == holds


def test_a_pin_is_seated_from_seven_tenths_of_its_hole_on() -> None:
    found = one_of(BEAM, pin(0, 16.0, 20))
    assert found.depth == 14.0 and found.is_seated
    # An axle as long as five modules needs no more than a module in its holder.
    along_z = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    for deep, is_seated in ((14.0, True), (13.9, False)):
        # The gear is 20 wide, and the axle from -40 to 40.
        gear = placed("3648b", (0, 0, 50 - deep), np.eye(3))
        axle = one_of(placed("3705", (0, 0, 0), along_z), gear)
        assert axle.depth == pytest.approx(deep) and axle.is_seated is is_seated


def test_holes_are_found_wherever_they_are_along_the_plan() -> None:
    """They are sorted along x: three beams a metre apart, with their pins in any order."""
    beams = [placed("32316", (x, 0, 0), np.eye(3)) for x in (2500, -2500, 0)]
    pins = [pin(x, -10, z) for x, z in ((0, 20), (-2500, -20), (2500, 40), (-2500, 0))]
    found = connections(plan_of(*beams, *pins).parts)
    assert [(link.male, link.female) for link in found] == [(3, 2), (4, 1), (5, 0), (6, 1)]
    assert [link.point[[0, 2]].tolist() for link in found] == [
        [0, 20],
        [-2500, -20],
        [2500, 40],
        [-2500, 0],
    ]
    # Along x, a hole is as far away from its axle's middle as both are long.
    axle = placed("3707", (0, 0, 0), np.eye(3))
    for middle, count in ((85.0, 1), (86.6, 0), (-85.0, 1), (-86.6, 0)):
        gear = placed("3648b", (middle, 0, 0), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
        assert len(connections(plan_of(axle, gear).parts)) == count, middle


@pytest.mark.parametrize(
    ("shift", "count"), [((2.5, 0.0, 0.0), 0), ((2.499, 0.0, 0.0), 1), ((0.0, 0.0, -2.5), 0)]
)
def test_a_way_in_is_closed_two_and_a_half_beside_it(shift: Any, count: int) -> None:
    beam, peg = plan_of(BEAM, pin(0, 0, 20)).parts
    assert len(open_holes(peg, np.array(shift), beam)) == count


@pytest.mark.parametrize(("sine", "count"), [(0.099, 1), (0.101, 0), (-0.099, 1)])
def test_a_way_in_may_lean_a_little(sine: float, count: int) -> None:
    cosine = math.sqrt(1 - sine**2)
    lean = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    beam, peg = plan_of(BEAM, placed("2780", (0, 0, 20), lean @ UPRIGHT)).parts
    assert len(open_holes(peg, np.zeros(3), beam)) == count


@pytest.mark.parametrize(
    ("apart", "along", "is_good"),
    [(41.0, 0.0, True), (39.0, 0.0, True), (40.0, 6.0, True), (40.0, -6.0, True)],
)
def test_gears_exactly_at_a_limit_still_mesh_well(
    apart: float, along: float, is_good: bool
) -> None:
    assert pair("3647", "3648b", apart, along).is_good is is_good


def test_gears_are_unrelated_from_nine_off_and_from_a_tenth_of_their_width() -> None:
    def count(apart: float, along: float) -> int:
        first = placed("3647", (0, 0, 0), np.eye(3))
        second = placed("3648b", (apart, 0, along), np.eye(3))
        return len(meshes(plan_of(first, second).parts))

    assert count(49.0, 0.0) == count(31.0, 0.0) == 1
    assert count(49.1, 0.0) == count(30.9, 0.0) == 0
    # Of 20 they share 1 or more.
    assert count(40.0, 18.9) == count(40.0, -18.9) == 1
    assert count(40.0, 19.0) == count(40.0, -19.0) == 0


def test_gears_in_one_place_have_no_distance_and_no_mesh() -> None:
    """Of 8 and 8 teeth the error would be 20, of a crown gear's own it is none."""
    small = [placed("10928", (x, 0, 0), np.eye(3)) for x in (0.0, 0.5)]
    assert meshes(plan_of(*small).parts) == []


@pytest.mark.parametrize(
    ("apart", "says"),
    [
        (41.5, "are 0.6 mm too far apart; move one"),
        (38.5, "are 0.6 mm too close; move one"),
    ],
)
def test_a_fault_says_how_far_and_which_way(apart: float, says: str) -> None:
    # Even where they hardly overlap, the distance is told first.
    assert pair("3647", "3648b", apart, 12.0).fault == says


def bevels(first: str, second: str, at: float, ahead: float, aside: float = 0.0) -> list[Mesh]:
    """Two gears with axles along z and x, which meet at the origin: the first one ``at`` before
    it, the second one ``ahead`` of it."""
    along_x = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    lines = (
        placed(first, (0, 0, -at), np.eye(3)),
        placed(second, (ahead, aside, 0), along_x),
    )
    return meshes(plan_of(*lines).parts)


@pytest.mark.parametrize(
    ("at", "ahead", "aside", "error", "parted"),
    [
        # Of 20 and 36 teeth: radii of 25 and 45, each 5 further from the other's axis.
        (50.0, 30.0, 0.0, 0.0, 0.0),
        # The slopes of their cones are 25 and 45 to the hypotenuse of both.
        (52.0, 30.0, 0.0, 2.0, 2.0 * 25 / math.hypot(25, 45)),
        (47.0, 30.0, 0.0, -3.0, -3.0 * 25 / math.hypot(25, 45)),
        (50.0, 31.0, 0.0, 1.0, 45 / math.hypot(25, 45)),
        (52.0, 31.5, 0.0, 2.0, 1.5 * 45 / math.hypot(25, 45)),
        # Axles that miss each other part the teeth as much.
        (50.0, 30.0, 0.8, 0.8, 0.8),
        (50.0, 30.0, -0.8, 0.8, 0.8),
    ],
)
def test_bevel_gears_meet_where_their_cones_do(
    at: float, ahead: float, aside: float, error: float, parted: float
) -> None:
    (mesh,) = bevels("18575", "32498", at, ahead, aside)
    assert mesh.error == pytest.approx(error) and mesh.parted == pytest.approx(parted)
    assert mesh.engaged == 1.0
    # As far from both axles as their radii, between the gears and the apex.
    assert mesh.point == pytest.approx([25.0, 0.0, -45.0])


@pytest.mark.parametrize(
    ("at", "ahead", "aside", "count"),
    [
        (59.0, 30.0, 0.0, 1),
        (59.1, 30.0, 0.0, 0),
        (41.0, 30.0, 0.0, 1),
        (40.9, 30.0, 0.0, 0),
        (50.0, 39.0, 0.0, 1),
        (50.0, 39.1, 0.0, 0),
        (50.0, 30.0, 9.0, 1),
        (50.0, 30.0, 9.1, 0),
        (50.0, 30.0, -9.1, 0),
    ],
)
def test_bevel_gears_are_unrelated_from_nine_off(
    at: float, ahead: float, aside: float, count: int
) -> None:
    assert len(bevels("18575", "32498", at, ahead, aside)) == count


@pytest.mark.parametrize("towards", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_bevel_gears_meet_on_the_side_of_both(towards: tuple[int, int]) -> None:
    first, second = towards
    (mesh,) = bevels("32270", "32270", 20.0 * first, 20.0 * second)
    assert mesh.is_good
    assert mesh.point == pytest.approx([15.0 * second, 0.0, -15.0 * first])


@pytest.mark.parametrize(
    ("ahead", "error"),
    [
        # The crown's teeth are 30 from its axle; the spur gear of 20 wide is from 10 below its
        # middle to 10 above.
        (20.0, 0.0),
        (40.0, 0.0),
        (41.0, 1.0),
        (19.5, 0.5),
    ],
)
def test_a_spur_gear_may_lie_anywhere_before_a_crown_gears_teeth(
    ahead: float, error: float
) -> None:
    (mesh,) = bevels("3650c", "10928", 22.0, ahead)
    assert mesh.error == pytest.approx(error) and mesh.parted == pytest.approx(error)


def test_two_spur_gears_at_a_right_angle_have_no_mesh() -> None:
    assert bevels("10928", "3648b", 35.0, 15.0) == []
    # Nor has a bevel gear with a spur gear.
    assert bevels("32270", "10928", 15.0, 20.0) == []


def worm_and_wheel(x: float, y: float, z: float, wheel_turn: Any = UPRIGHT) -> list[Mesh]:
    """A worm along z at the origin, and a gear of 24 teeth with its axle along y."""
    upright = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    turn = upright if wheel_turn is UPRIGHT else wheel_turn
    lines = (placed("4716", (0, 0, 0), np.eye(3)), placed("3648b", (x, y, z), turn))
    return meshes(plan_of(*lines).parts)


@pytest.mark.parametrize(
    ("x", "y", "z", "error"),
    [
        # Radii of 10 and 30.
        (40.0, 0.0, 0.0, 0.0),
        (-40.0, 0.0, 0.0, 0.0),
        (42.5, 0.0, 5.0, 2.5),
        (39.0, 10.0, -20.0, -1.0),
        (49.0, -10.0, 20.0, 9.0),
    ],
)
def test_a_worm_meshes_at_its_distance_along_its_length(
    x: float, y: float, z: float, error: float
) -> None:
    (mesh,) = worm_and_wheel(x, y, z)
    assert mesh.error == mesh.parted == pytest.approx(error) and mesh.engaged == 1.0
    # On the wheel's circle, towards the worm.
    assert mesh.point == pytest.approx([x - math.copysign(30.0, x), y, z])
    # A worm of one tooth: a turn moves the teeth by pi modules of 1 mm, of 2.5 LDU.
    turn, slide = mesh.motion[0][5], mesh.motion[0][2]
    assert turn / slide == pytest.approx(-math.pi * 2.5 / (2 * math.pi), rel=1e-4)


@pytest.mark.parametrize(
    "place",
    [(40.0, 10.1, 0.0), (40.0, 0.0, 20.1), (40.0, 0.0, -20.1), (49.1, 0.0, 0.0), (30.9, 0, 0)],
)
def test_a_wheel_beside_a_worm_does_not_mesh(place: Any) -> None:
    assert worm_and_wheel(*place) == []


def test_a_wheel_along_its_worm_does_not_mesh() -> None:
    assert worm_and_wheel(40.0, 0.0, 0.0, np.eye(3)) == []
    sine, cosine = math.sin(math.radians(2.0)), math.cos(math.radians(2.0))
    leaning = [[1, 0, 0], [0, -sine, cosine], [0, -cosine, -sine]]
    assert worm_and_wheel(40.0, 0.0, 0.0, leaning) == []


def on_rack(x: float, y: float, z: float) -> list[Mesh]:
    """A rack of 18 teeth along x with its teeth above it, and a gear of 8 teeth."""
    lines = (placed("87761", (0, 0, 0), np.eye(3)), placed("10928", (x, y, z), np.eye(3)))
    return meshes(plan_of(*lines).parts)


def test_a_gear_rolls_on_a_rack_as_far_as_its_teeth_go() -> None:
    (level,) = on_rack(0.0, -17.5, 0.0)
    assert level.error == pytest.approx(0.0, abs=0.3) and level.is_good
    higher, lower = on_rack(0.0, -20.5, 0.0), on_rack(0.0, -14.5, 0.0)
    assert higher[0].error - level.error == pytest.approx(3.0)
    assert lower[0].error - level.error == pytest.approx(-3.0)
    # The lowest tooth of a gear with a radius of 10.
    assert level.point == pytest.approx([0.0, -7.5, 0.0])
    # Half of 18 teeth of pi millimetres to each side.
    half = 18 * math.pi * 2.5 / 2
    for x in (half - 0.1, 0.1 - half):
        assert len(on_rack(x, -17.5, 0.0)) == 1
    for x in (half + 0.1, -half - 0.1):
        assert on_rack(x, -17.5, 0.0) == []
    # Too far above it or below, it has nothing to do with it.
    off = 9.0 - level.error
    assert len(on_rack(0.0, -17.5 - off + 0.1, 0.0)) == 1
    assert on_rack(0.0, -17.5 - off - 0.1, 0.0) == []


TURNED = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""A quarter of a turn about y: what was along z is along x."""


@pytest.mark.parametrize(
    ("rim", "tyre", "place", "is_worn"),
    [
        # Of 68 and 68; the middle of the tyre may be 4 off.
        ("56145", "44309", (0, 0, 0), True),
        ("56145", "44309", (0, 0, 4), True),
        ("56145", "44309", (4, 0, 0), True),
        ("56145", "44309", (0, 0, 4.1), False),
        # Other sizes: 84 on 84, 76 and 38 on 68.
        ("86652", "32019", (0, 0, 0), True),
        ("56145", "56898", (0, 0, 0), False),
        ("56145", "92402", (0, 0, 0), False),
    ],
)
def test_a_tyre_is_on_a_rim_of_its_size_in_its_middle(
    rim: str, tyre: str, place: Any, is_worn: bool
) -> None:
    plan = plan_of(placed(tyre, place, np.eye(3)), placed(rim, (0, 0, 0), np.eye(3)))
    found = connections(plan.parts)
    assert len(found) == is_worn
    for one in found:
        assert (one.male, one.female) == (1, 0)
        assert (one.male_site.fit, one.female_site.fit) == (Fit.RIM, Fit.TYRE)
        assert one.is_rigid and one.is_seated and not one.is_crossed
        assert one.point == pytest.approx([0.0, 0.0, one.male_site.centre[2]])


def test_a_tyre_across_a_rim_is_not_on_it() -> None:
    plan = plan_of(placed("44309", (0, 0, 0), TURNED), placed("56145", (0, 0, 0), np.eye(3)))
    assert connections(plan.parts) == []


@pytest.mark.parametrize(
    ("place", "turn", "is_one"),
    [
        ((0, 0, 0), np.eye(3), True),
        # They turn about y in any position.
        ((0, 0, 0), TURNED, True),
        ((0, 1.2, 0), np.eye(3), True),
        ((0, 1.3, 0), np.eye(3), False),
        ((1.3, 0, 0), np.eye(3), False),
        ((0, 0, 0), UPRIGHT, False),
    ],
)
def test_halves_of_a_turntable_are_one_if_they_are_in_one_place(
    place: Any, turn: Any, is_one: bool
) -> None:
    upper, lower = placed("18938", place, turn), placed("18939", (0, 0, 0), np.eye(3))
    for lines in ((upper, lower), (lower, upper)):
        found = connections(plan_of(*lines).parts)
        # Each pair is found once.
        assert [(one.male, one.female) for one in found] == [(0, 1)] * is_one
        for one in found:
            assert np.abs(one.axis) == pytest.approx([0.0, 1.0, 0.0])
            assert not one.is_rigid and not one.is_ball and one.is_seated


@pytest.mark.parametrize(
    ("place", "turn", "is_held"),
    [
        ((0, 0, 0), np.eye(3), True),
        # A ball may point anywhere in its socket.
        ((0, 0, 0), UPRIGHT, True),
        ((0, 0, 0), TURNED, True),
        ((1.2, 0, 0), np.eye(3), True),
        ((1.3, 0, 0), np.eye(3), False),
        # The other end of the link.
        ((0, 0, -100), np.eye(3), True),
        ((0, 0, 100), np.eye(3), False),
    ],
)
def test_a_ball_is_in_the_socket_around_it(place: Any, turn: Any, is_held: bool) -> None:
    # The ball of a pin is 10 before its middle.
    plan = plan_of(placed("32005", place, turn), placed("6628", (10, 0, 0), np.eye(3)))
    balls = [one for one in connections(plan.parts) if one.is_ball]
    assert len(balls) == is_held
    for one in balls:
        assert (one.male, one.female) == (1, 0) and one.point == pytest.approx([0.0, 0.0, 0.0])
        assert not one.is_rigid and not one.is_axle and one.fits


def test_two_balls_or_two_tyres_in_one_place_hold_nothing() -> None:
    for number in ("6628", "44309", "56145"):
        twice = [placed(number, (0, 0, 0), np.eye(3))] * 2
        assert connections(plan_of(*twice).parts) == []
