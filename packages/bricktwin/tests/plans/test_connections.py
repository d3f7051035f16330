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
