"""Couplings of open gears, by the equations of gears that are written by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bricktwin.plans.mechanism.kinematics import Hinge
from bricktwin.plans.mechanism.open_gears import (
    Coupling,
    free_among,
    turn_with,
    turns_with,
    way_to,
)

# A differential: the turns of both axles, 2 and 3, sum up to twice those of its case, 1.
DIFFERENTIAL = Coupling(((1, 1.0), (2, -0.5), (3, -0.5)))
# Gears of 12 and 36 teeth between body 3 and body 4, which turn opposite ways.
PAIR = Coupling(((3, 1.0 / 3.0), (4, 1.0)))


def test_what_turns_with_a_joint_turns_by_the_least_angles() -> None:
    assert turns_with([PAIR], 3) == {4: pytest.approx(-1.0 / 3.0)}
    assert turns_with([PAIR], 4) == {3: pytest.approx(-3.0)}
    # The case turns both axles alike; one axle alone turns the case and, backwards, the other one.
    assert turns_with([DIFFERENTIAL], 1) == {2: pytest.approx(1.0), 3: pytest.approx(1.0)}
    one_axle = turns_with([DIFFERENTIAL], 2)
    assert one_axle[1] - 0.5 - 0.5 * one_axle[3] == pytest.approx(0.0)
    # The least of all solutions is square to what the coupling leaves free.
    assert one_axle == {1: pytest.approx(0.4), 3: pytest.approx(-0.2)}
    assert turns_with([DIFFERENTIAL, PAIR], 1)[4] == pytest.approx(
        -turns_with([DIFFERENTIAL, PAIR], 1)[3] / 3.0
    )


def test_a_joint_that_is_locked_or_in_no_coupling_turns_nothing() -> None:
    assert turns_with([DIFFERENTIAL], 9) == {}
    # Two ratios between the same gears: neither can turn.
    twice = [PAIR, Coupling(((3, 0.5), (4, 1.0)))]
    assert turns_with(twice, 3) == turns_with(twice, 4) == {}
    # Nor does one whose own turn is nothing to the others.
    assert turns_with([Coupling(((1, 1.0), (2, 0.0005)))], 2) == {}


@pytest.mark.parametrize(
    ("couplings", "bodies", "free"),
    [
        ([DIFFERENTIAL], [1, 2, 3], [1, 2]),
        ([DIFFERENTIAL], [3, 2, 1], [3, 2]),
        ([PAIR], [3, 4], [3]),
        ([PAIR], [4, 3], [4]),
        ([DIFFERENTIAL, PAIR], [4, 3, 2, 1], [4, 2]),
        # What no coupling has is always free; what is locked never.
        ([PAIR], [7, 3, 8, 4], [7, 3, 8]),
        ([PAIR, Coupling(((3, 0.5), (4, 1.0)))], [3, 4, 5], [5]),
    ],
)
def test_of_coupled_joints_the_first_ones_are_free(
    couplings: list[Coupling], bodies: list[int], free: list[int]
) -> None:
    assert free_among(couplings, bodies) == free


def hinge(parent: int, child: int, axis: tuple[float, float, float]) -> Hinge:
    return Hinge(parent, child, np.zeros(3), np.array(axis), None, closes_loop=False)


def test_a_body_turns_with_all_that_carries_it() -> None:
    """A planet gear on a carrier: both turn about one axis, and the planet about its own too."""
    joints = [
        hinge(0, 1, (0.0, 0.0, 1.0)),
        hinge(1, 2, (0.0, 1.0, 0.0)),
        hinge(2, 3, (0.0, 0.0, 1.0)),
        hinge(0, 4, (1.0, 0.0, 0.0)),
    ]
    joint_of = {joint.child: joint for joint in joints}
    assert way_to(joint_of, 3) == [3, 2, 1] and way_to(joint_of, 0) == []
    couplings = [Coupling(((1, 1.0), (2, 0.5))), Coupling(((2, 1.0), (4, 0.25)))]
    # The carrier once: the planet twice backwards, and the last gear eight times forwards.
    assert turns_with(couplings, 1) == {2: pytest.approx(-2.0), 4: pytest.approx(8.0)}
    turn: Any = turn_with(couplings, joints, 1, 3)
    assert turn == pytest.approx([0.0, -2.0, 1.0])
    assert turn_with(couplings, joints, 1, 4) == pytest.approx([8.0, 0.0, 0.0])
    assert turn_with(couplings, joints, 4, 1) == pytest.approx([0.0, 0.0, 0.125])
