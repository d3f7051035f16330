"""Rigid bodies: lines of hinges, what joints leave free, what an axle's stops allow, and which body
carries which part."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plan_lines import BEAM, pin, plan_of

from bricktwin.plans.bodies import (
    RATE_LENGTH,
    Bodies,
    BodyJoint,
    _join,
    _joint_rows,
    _line_of,
    _null_space,
)
from bricktwin.plans.check import structure_of
from bricktwin.plans.geometry import Floats

UP = np.array([0.0, 0.0, 1.0])
PLATE = "1 7 0 0 0 1 0 0 0 1 0 0 0 1 39369.dat"
UPRIGHT = "0 -1 0 1 0 0 0 0 1"
FLAT = "1 0 0 0 0 1 0 -1 0"


def hinge(first: int, second: int, point: Any, axis: Any = UP, **values: Any) -> BodyJoint:
    defaults: dict[str, Any] = {"slides": False, "motor": None}
    return BodyJoint((first, second), np.array(point), np.array(axis), **{**defaults, **values})


def bodies_of(count: int, *joints: BodyJoint) -> Bodies:
    nobody: tuple[tuple[int, ...], ...] = ((),) * count
    return Bodies(nobody, nobody, joints, ())


def freedom(count: int, *joints: BodyJoint, locked: tuple[int, ...] = ()) -> int:
    return int(bodies_of(count, *joints).motions(locked=locked).shape[1])


@pytest.mark.parametrize(
    ("values", "freedoms"),
    [({}, 1), ({"slides": True}, 2), ({"is_ball": True}, 3), ({"motor": 4}, 1)],
)
@pytest.mark.parametrize(
    "axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, -0.8, 0.0), (0.36, 0.48, 0.8)]
)
def test_a_joint_leaves_its_motions_free(
    values: dict[str, Any], freedoms: int, axis: tuple[float, float, float]
) -> None:
    joint = hinge(0, 1, (300.0, -200.0, 50.0), axis, **values)
    motions = bodies_of(2, joint).motions()
    assert motions.shape == (12, freedoms)
    # The first body is at rest, and the joint's point stays where it is but for a slide.
    assert motions[:6] == pytest.approx(np.zeros((6, freedoms)), abs=1e-9)
    linear, angular = motions[6:9], motions[9:12] / RATE_LENGTH
    at_point = linear + np.cross(angular.T, joint.point).T
    across = np.eye(3) - np.outer(axis, axis)
    assert across @ at_point == pytest.approx(np.zeros((3, freedoms)), abs=1e-6)
    if not joint.slides:
        assert at_point == pytest.approx(np.zeros((3, freedoms)), abs=1e-6)
    if not joint.is_ball:
        assert across @ angular == pytest.approx(np.zeros((3, freedoms)), abs=1e-9)


def test_only_a_braked_motor_is_locked() -> None:
    joints = (hinge(0, 1, (0, 0, 0), motor=4), hinge(1, 2, (50, 0, 0), motor=7))
    assert freedom(3, *joints) == 2
    assert freedom(3, *joints, locked=(4,)) == freedom(3, *joints, locked=(7,)) == 1
    assert freedom(3, *joints, locked=(4, 7)) == 0 and freedom(3, *joints, locked=(9,)) == 2
    # A hinge without a motor is never braked.
    assert freedom(2, hinge(0, 1, (0, 0, 0)), locked=(4,)) == 1


def test_a_rod_between_two_balls_does_not_count_its_spin() -> None:
    near = hinge(0, 1, (0, 0, 0), is_ball=True)
    far = hinge(1, 2, (100, 0, 0), is_ball=True)
    lever = hinge(0, 2, (150, 0, 0))
    # The lever turns across the rod, and the rod with it; along the rod it would be held.
    assert freedom(3, near, far, lever) == 1
    assert freedom(3, near, far, hinge(0, 2, (100, 50, 0))) == 0
    spins = list(bodies_of(3, near, far, lever)._free_spins())
    assert [(body, axis.tolist()) for body, axis in spins] == [(1, [1.0, 0.0, 0.0])]
    # One ball alone, a hinge at its other end, or both in one place have no such axis.
    assert list(bodies_of(2, near)._free_spins()) == []
    assert list(bodies_of(3, near, hinge(1, 2, (100, 0, 0)))._free_spins()) == []
    for away, count in ((1.4, 0), (1.5, 0), (1.6, 1)):
        both = bodies_of(3, near, hinge(1, 2, (away, 0, 0), is_ball=True))
        assert len(list(both._free_spins())) == count, away
    # A gear on the rod holds it.
    mesh: Any = SimpleNamespace()
    geared = Bodies(((),) * 4, ((),) * 4, (near, far), ((3, 1, mesh),))
    assert list(geared._free_spins()) == []
    other = Bodies(((),) * 4, ((),) * 4, (near, far), ((3, 2, mesh),))
    assert len(list(other._free_spins())) == 1


@pytest.mark.parametrize(
    ("motor", "parent", "rate"),
    [
        (None, None, 2.0),
        (None, 0, 2.0),
        # Relative to the other body it turns the other way.
        (None, 1, -2.0),
        # A motor's case that turns about its shaft: the axis is reversed too.
        (3, None, 2.0),
        (3, 0, 2.0),
        (3, 1, 2.0),
    ],
)
def test_a_hinge_turns_by_the_difference_of_its_bodies(
    motor: int | None, parent: int | None, rate: float
) -> None:
    joint = hinge(0, 1, (0, 0, 0), motor=motor)
    motions = np.zeros((12, 1))
    motions[3:6, 0], motions[9:12, 0] = (5.0, 0.0, 1.0), (0.0, 7.0, 3.0)
    assert joint.rates(motions, parent).tolist() == [rate]


def connection(point: Any, axis: Any) -> Any:
    made = SimpleNamespace(point=np.array(point, float), axis=np.array(axis, float))
    return SimpleNamespace(connection=made)


def test_a_line_is_in_the_middle_of_what_lies_on_it() -> None:
    bundle = [connection((0, 0, z), (0, 0, 1)) for z in (0, 10, 50)]
    point, axis = _line_of(bundle)
    assert point.tolist() == [0, 0, 25] and axis.tolist() == [0, 0, 1]
    # In any order, and whichever way the first one points.
    for ordered in (bundle[::-1], [connection((0, 0, 50), (0, 0, -1)), *bundle[:2]]):
        again, same = _line_of(ordered)
        assert again.tolist() == [0, 0, 25] and same.tolist() == [0, 0, 1]
    # Errors across the axis are averaged.
    point, _ = _line_of(
        [connection((x, 0, z), (0, 0, 1)) for x, z in ((0, 0), (0.3, 10), (0.6, 80))]
    )
    assert point == pytest.approx([0.3, 0.0, 40.0])
    # The largest component counts; of equal ones the first.
    _, axis = _line_of([connection((0, 0, 0), (-0.6, 0.8, 0))])
    assert axis.tolist() == [-0.6, 0.8, 0]
    _, axis = _line_of([connection((0, 0, 0), (-0.8, 0.6, 0))])
    assert axis.tolist() == [0.8, -0.6, 0]
    half = 0.5**0.5
    _, axis = _line_of([connection((0, 0, 0), (-half, half + 1e-9, 0))])
    assert axis[0] > 0


def test_sets_of_nodes_are_joined_whole() -> None:
    groups = np.arange(6)
    _join(groups, 0, 1)
    _join(groups, 2, 3)
    _join(groups, 1, 3)
    assert len(set(groups[:4].tolist())) == 1 and groups[4:].tolist() == [4, 5]


def test_what_constraints_leave_free_is_orthonormal() -> None:
    rows = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    basis = _null_space(rows)
    assert basis.shape == (3, 2)
    assert rows @ basis == pytest.approx(np.zeros((2, 2)), abs=1e-9)
    assert basis.T @ basis == pytest.approx(np.eye(2))
    # What is a ten thousandth of a rate is nothing.
    assert _null_space(np.diag([1.0, 2e-4])).shape == (2, 0)
    assert _null_space(np.diag([1.0, 0.5e-4])).shape == (2, 1)


@pytest.mark.parametrize("far", [0.0, 5000.0])
def test_a_joint_blocks_as_many_rates_as_it_should_wherever_it_is(far: float) -> None:
    point: Floats = np.array([far, -far, far])
    counts = {
        (False, True, False): 5,
        (True, True, False): 4,
        (False, False, False): 6,
        (False, True, True): 3,
    }
    for (slides, turns, is_ball), count in counts.items():
        rows = _joint_rows(point, UP, slides=slides, turns=turns, is_ball=is_ball)
        assert rows.shape == (count, 6) and np.linalg.matrix_rank(rows) == count


def freedom_of_axle(gap: float, other_gap: float) -> int:
    """Motions of a vertical axle of 6 in a plate of 20, between two bushes at these distances."""
    plan = plan_of(
        PLATE,
        f"1 0 0 0 0 {UPRIGHT} 3706.dat",
        f"1 0 0 {20 + gap} 0 {FLAT} 3713.dat",
        f"1 0 0 {-20 - other_gap} 0 {FLAT} 3713.dat",
    )
    structure = structure_of(plan)
    assert [len(members) for members in structure.bodies.members] == [1, 3]
    return int(structure.bodies.motions().shape[1])


@pytest.mark.parametrize(
    ("gap", "is_stopped"),
    [(0.0, True), (8.9, True), (9.0, False), (9.1, False), (-1.9, True), (-2.0, False)],
)
def test_bushes_up_to_nine_away_stop_an_axle(gap: float, is_stopped: bool) -> None:
    assert freedom_of_axle(gap, 0.0) == freedom_of_axle(0.0, gap) == (1 if is_stopped else 2)


def test_an_axle_that_is_stopped_in_one_direction_slides_in_the_other() -> None:
    bushes = [f"1 0 0 {y} 0 {FLAT} 3713.dat" for y in (20, 40)]
    plan = plan_of(PLATE, f"1 0 0 0 0 {UPRIGHT} 3706.dat", *bushes)
    assert structure_of(plan).bodies.motions().shape[1] == 2


def test_beams_on_one_pin_turn_and_on_two_do_not() -> None:
    other = BEAM.replace("1 4 0 0 0", "1 4 0 -20 0")
    for pins, members in (
        ([pin(0, -10, 20)], 2),
        ([pin(0, -10, 20), pin(0, -10, -20)], 1),
    ):
        structure = structure_of(plan_of(BEAM, other, *pins))
        assert len(structure.bodies.members) == members
    # Far from the origin they are as rigid.
    far = [line.replace("1 4 0", "1 4 20000") for line in (BEAM, other)]
    pins = [pin(20000, -10, 20), pin(20000, -10, 0)]
    assert len(structure_of(plan_of(*far, *pins)).bodies.members) == 1


def test_the_heaviest_body_comes_first_and_what_is_apart_is_left_out() -> None:
    heavy = "1 15 0 -35 0 1 0 0 0 1 0 0 0 1 67718.dat"
    apart = BEAM.replace("1 4 0 0 0", "1 4 900 0 0")
    plan = plan_of(apart, BEAM, pin(0, -10, 20), heavy)
    members = structure_of(plan).bodies.members
    assert members[0] == (3,) and all(0 not in parts for parts in members)


def test_an_axle_in_two_walls_of_one_body_has_one_hinge_in_their_middle() -> None:
    walls = [BEAM, BEAM.replace("1 4 0 0 0", "1 4 0 -40 0")]
    # Pins of 40 reach from the middle of one wall to that of the other: both are one body.
    across = [pin(0, -20, z) for z in (40, -40)]
    axle = f"1 0 0 -20 0 {UPRIGHT} 3705.dat"
    bushes = [f"1 0 0 20 0 {FLAT} 3713.dat", f"1 0 0 -60 0 {FLAT} 3713.dat"]
    bodies = structure_of(plan_of(*walls, *across, axle, *bushes)).bodies
    assert sorted(map(len, bodies.members)) == [3, 4]
    (joint,) = bodies.joints
    assert joint.point == pytest.approx([0.0, -20.0, 0.0])
    assert np.abs(joint.axis) == pytest.approx([0.0, 1.0, 0.0])
    assert joint.motor is None and not joint.slides and not joint.is_ball
