"""Mechanisms of a few links, made simpler: rods, shafts, gears that are only seen, and the tree of
the rest."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from brickhub.errors import PlanError
from bricktwin.plans.geometry import Floats
from bricktwin.plans.mechanism.articulation import Articulation, _joint, _Simplifier, articulation
from bricktwin.plans.mechanism.kinematics import Hinge, Link, Mechanism, Train, Wheel, trains
from bricktwin.plans.mechanism.open_gears import OpenGears
from bricktwin.plans.part import GearForm

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)


def hinge(parent: int, child: int, place: Any, axis: Any = Y, **values: Any) -> Hinge:
    defaults: dict[str, Any] = {"port": None, "closes_loop": False}
    return Hinge(parent, child, np.array(place, float), np.array(axis), **{**defaults, **values})


def link(number: int, mass_kg: float, middle: Any = (0, 0, 0), inertia: float = 0.0) -> Link:
    return Link((number,), mass_kg, np.array(middle, float), inertia * np.eye(3))


def around(*places: Any) -> Floats:
    return np.array(places, float)


def mechanism_of(
    links: list[Link],
    hinges: list[Hinge],
    *,
    corners: dict[int, Floats] | None = None,
    ports: tuple[str, ...] = (),
    ratios: Any = None,
    wheels: tuple[Wheel, ...] = (),
    devices: tuple[int, ...] = (),
    fixed: int | None = None,
) -> Mechanism:
    nothing = {number: around((0, 0, 0)) for number in range(len(links))}
    return Mechanism(
        tuple(links),
        tuple(hinges),
        ports,
        np.array(ratios if ratios is not None else np.zeros((len(hinges), len(ports)))),
        wheels,
        devices,
        (),
        {**nothing, **(corners or {})},
        fixed,
    )


def simplified(
    mechanism: Mechanism, *trains_of_motors: Train, opened: OpenGears | None = None
) -> Articulation:
    return articulation(mechanism, trains_of_motors, opened or OpenGears())


# A four-bar linkage in the plane of x and z: the chassis 0 carries the crank 1 and the rocker 2,
# and the coupler 3 is between both.
PLACES = {"crank": (0, 0, 0), "rocker": (0.1, 0, 0), "near": (0, 0, 0.03), "far": (0.1, 0, 0.05)}
COUPLER = around((0, 0.004, 0.03), (0.1, 0.004, 0.05), (0, -0.004, 0.03), (0.1, -0.004, 0.05))


def four_bar(
    mass_kg: float = 0.005,
    *,
    axis: Any = Y,
    far: Any = PLACES["far"],
    corners: Floats = COUPLER,
    is_closed: bool = True,
    ball: tuple[bool, bool] = (False, False),
    **values: Any,
) -> Mechanism:
    links = [link(0, 0.3), link(1, 0.02), link(2, 0.02), link(3, mass_kg)]
    hinges = [
        hinge(0, 1, PLACES["crank"]),
        hinge(0, 2, PLACES["rocker"]),
        hinge(1, 3, PLACES["near"], is_ball=ball[0]),
        hinge(2, 3, far, axis, closes_loop=True, is_ball=ball[1]),
    ]
    return mechanism_of(links, hinges if is_closed else hinges[:3], corners={3: corners}, **values)


def test_a_light_link_between_two_pins_of_a_loop_is_a_rod() -> None:
    made = simplified(four_bar())
    (rod,) = made.rods
    assert (rod.near, rod.far, rod.parts) == (1, 2, (3,))
    assert rod.near_m.tolist() == [0, 0, 0.03] and rod.far_m.tolist() == [0.1, 0, 0.05]
    assert len(made.bodies) == 3 and made.loops == () and len(made.swings) == 2
    # Half of its mass is at each of its ends.
    assert [body.mass_kg for body in made.bodies] == pytest.approx([0.3, 0.0225, 0.0225])
    ends = [made.bodies[1].centre_m, made.bodies[2].centre_m]
    assert ends[0] == pytest.approx([0, 0, 0.03 * 0.0025 / 0.0225])
    assert ends[1] == pytest.approx(np.array([0.1, 0, 0.05]) * 0.0025 / 0.0225)


@pytest.mark.parametrize(
    ("changes", "is_rod"),
    [
        ({"mass_kg": 0.0099}, True),
        ({"mass_kg": 0.010}, False),
        # Pins that are not parallel, or on one line; balls at both ends, or at one.
        ({"axis": (0.0, 0.9999, 0.014)}, True),
        ({"axis": (0.0, 0.9997, 0.025)}, False),
        ({"far": (0, 0.02, 0.03)}, False),
        ({"ball": (True, True)}, True),
        ({"ball": (True, False)}, False),
        ({"ball": (False, True)}, False),
        # Elsewhere than in a loop it swings.
        ({"is_closed": False}, False),
        # What carries a sensor, or is a wheel, is a body of its own.
        ({"devices": (3,)}, False),
        ({"wheels": (Wheel(3, np.zeros(3), 56.0, 3),)}, False),
        ({"fixed": 3}, False),
    ],
)
def test_what_is_more_than_a_rod_stays_a_body(changes: dict[str, Any], is_rod: bool) -> None:
    mechanism = four_bar(**changes)
    finder = _Simplifier(mechanism, (), OpenGears())
    finder.find_rods()
    assert [number for number, _, _ in finder.rods] == [3] * is_rod
    assert len(finder.hinges) == len(mechanism.hinges) - 2 * is_rod


@pytest.mark.parametrize(
    ("corner", "stands_out"),
    [
        # A module of 8 mm beside the line between the pins.
        ((0.05, 0, 0.04 + 0.0081), False),
        ((0.05, 0, 0.04 + 0.0083), True),
        ((0.05, 0, 0.04 - 0.0083), True),
        # Beyond a pin.
        ((-0.0079, 0, 0.03), False),
        ((-0.0081, 0, 0.03), True),
        ((0.1081, 0, 0.05), True),
        # How long a pin is says nothing.
        ((0.05, 0.3, 0.04), False),
    ],
)
def test_a_leg_is_no_rod_as_its_foot_is_elsewhere(corner: Any, stands_out: bool) -> None:
    mechanism = four_bar(corners=around(corner, (0.02, 0, 0.034)))
    finder = _Simplifier(mechanism, (), OpenGears())
    assert finder._stands_out(3, *mechanism.hinges[2:]) is stands_out
    # Between balls it may have no width in any direction.
    wide = four_bar(corners=around((0.05, 0.0081, 0.04)), ball=(True, True))
    assert _Simplifier(wide, (), OpenGears())._stands_out(3, *wide.hinges[2:])


def test_pins_of_a_rod_are_moved_into_one_plane() -> None:
    made = simplified(four_bar(far=(0.1, 0.016, 0.05)))
    (rod,) = made.rods
    assert rod.far_m == pytest.approx([0.1, 0.0, 0.05])
    between = around((0.05, 0.003, 0.04))
    balls = simplified(four_bar(far=(0.1, 0.006, 0.05), ball=(True, True), corners=between))
    assert balls.rods[0].far_m == pytest.approx([0.1, 0.006, 0.05])


@pytest.mark.parametrize(
    ("mass_kg", "off_m", "is_merged"),
    [
        (0.002, 0.0, True),
        # An imbalance of 12 g, 1 mm off the axis.
        (0.0099, 0.0012, True),
        (0.0099, 0.00122, False),
        (0.010, 0.0, False),
    ],
)
def test_an_axle_that_spins_freely_is_part_of_what_is_around_it(
    mass_kg: float, off_m: float, is_merged: bool
) -> None:
    """An axle between the chassis and a lever."""
    axle = link(1, mass_kg, (0.05 + off_m, 0.3, 0.02))
    hinges = [hinge(0, 1, (0.05, 0, 0.02)), hinge(1, 2, (0.05, 0.1, 0.02))]
    made = simplified(mechanism_of([link(0, 0.3), axle, link(2, 0.05)], hinges))
    assert len(made.bodies) == (2 if is_merged else 3)
    assert len(made.swings) == len(made.bodies) - 1
    parts = sorted(part for body in made.bodies for part in body.parts)
    assert parts == [0, 1, 2]


def test_an_axle_across_another_is_no_shaft() -> None:
    hinges = [hinge(0, 1, (0.05, 0, 0.02)), hinge(1, 2, (0.05, 0.1, 0.02), X)]
    made = simplified(mechanism_of([link(0, 0.3), link(1, 0.002), link(2, 0.05)], hinges))
    assert len(made.bodies) == 3


def test_of_hinges_on_one_line_between_two_links_one_is_kept() -> None:
    links = [link(0, 0.3), link(1, 0.05)]
    twice = [hinge(0, 1, (0, 0, 0)), hinge(0, 1, (0, 0.05, 0), closes_loop=True)]
    made = simplified(mechanism_of(links, twice))
    assert len(made.swings) == 1 and made.loops == ()
    assert made.swings[0].point_m.tolist() == [0, 0, 0]
    # On another line it is a loop.
    apart = [twice[0], hinge(0, 1, (0.03, 0.05, 0), closes_loop=True)]
    made = simplified(mechanism_of(links, apart))
    assert len(made.swings) == len(made.loops) == 1
    # That of a motor counts, wherever it is.
    driven = [twice[0], replace(twice[1], port="A", closes_loop=False)]
    train = Train("A", 1, 1.0, (), ())
    made = simplified(mechanism_of(links, driven, ports=("A",), ratios=[[1.0], [1.0]]), train)
    assert made.swings == () and made.drives[0].joint.point_m.tolist() == [0, 0.05, 0]


def geared(imbalance_m: float = 0.0, *, is_child: bool = True) -> tuple[Mechanism, Train]:
    """A motor on the chassis whose shaft, link 1, turns an arm, link 2, by gears of 12 and 36."""
    links = [link(0, 0.3), link(1, 0.002, (0, 0, imbalance_m), 4e-7), link(2, 0.05)]
    shaft = hinge(0, 1, (0, 0, 0), port="A") if is_child else hinge(1, 0, (0, 0, 0), port="A")
    hinges = [shaft, hinge(0, 2, (0.032, 0, 0), is_shaft=True)]
    train = Train("A", 1, -1 / 3, (12, 36), ((0, 1.0),))
    made = mechanism_of(links, hinges, ports=("A",), ratios=[[1.0], [-1 / 3]])
    return made, train


@pytest.mark.parametrize("is_child", [True, False])
def test_a_shaft_before_gears_is_only_seen_and_its_inertia_counts(is_child: bool) -> None:
    made = simplified(*geared(is_child=is_child))
    (follower,) = made.followers
    assert (follower.body, follower.parts, follower.port) == (0, (1,), "A")
    # Three turns backwards for each of the arm; a shaft that holds its case turns the other way.
    assert follower.ratio == pytest.approx(-3.0 if is_child else 3.0)
    (drive,) = made.drives
    # Inertias count with the square of the ratio.
    assert drive.armature == pytest.approx(4e-7 * 9)
    assert drive.gear == pytest.approx(-3.0) and drive.teeth == (12, 36)
    assert drive.joint.point_m.tolist() == [0.032, 0, 0] and len(made.bodies) == 2
    # Clockwise, seen from outside.
    assert drive.joint.axis.tolist() == [0, -1, 0]
    assert made.geared == () and made.swings == ()


def test_a_shaft_out_of_balance_is_a_joint() -> None:
    made = simplified(*geared(0.007))
    assert made.followers == () and len(made.bodies) == 3
    (one,) = made.geared
    assert one.port == "A" and one.ratio == pytest.approx(-3.0)
    assert made.drives[0].armature == 0.0


def test_a_shaft_that_is_needed_is_a_joint() -> None:
    mechanism, train = geared()
    made = simplified(replace(mechanism, devices=(1,)), train)
    assert made.followers == () and len(made.geared) == 1
    # What an open gear is on turns as no motor does.
    opened = simplified(mechanism, train, opened=OpenGears(links=frozenset({1})))
    assert opened.followers == ()


@pytest.mark.parametrize(
    ("order", "ends", "axis"), [({0: 0, 1: 1}, (0, 1), 1.0), ({0: 1, 1: 0}, (0, 1), -1.0)]
)
def test_the_parent_of_a_joint_is_the_earlier_body(
    order: dict[int, int], ends: tuple[int, int], axis: float
) -> None:
    joint = _joint(hinge(0, 1, (0, 0, 0)), order)
    assert (joint.parent, joint.child) == ends and joint.axis.tolist() == [0, axis, 0]


def test_motors_come_into_the_tree_before_what_swings() -> None:
    """Two ways to the last link: by the motor's hinge, which is the last one, and by two pins."""
    links = [link(number, 0.05) for number in range(3)]
    hinges = [
        hinge(0, 1, (0, 0, 0)),
        hinge(1, 2, (0.05, 0, 0.03)),
        hinge(0, 2, (0.1, 0, 0), port="B"),
    ]
    train = Train("B", 2, 1.0, (), ())
    made = simplified(
        mechanism_of(links, hinges, ports=("B",), ratios=[[0.0], [0.0], [1.0]]), train
    )
    assert [drive.joint.child for drive in made.drives] == [1]
    assert made.drives[0].joint.point_m.tolist() == [0.1, 0, 0]
    assert len(made.swings) == 1 and len(made.loops) == 1
    # What is connected to nothing is on no body.
    alone = simplified(mechanism_of([*links, link(3, 0.05)], hinges[:2]))
    assert len(alone.bodies) == 3 and alone.body_of(3) is None and alone.body_of(2) == 2


def test_the_fixed_link_is_the_first_body() -> None:
    links = [link(0, 0.3), link(1, 0.05)]
    made = simplified(mechanism_of(links, [hinge(0, 1, (0, 0, 0))], fixed=1))
    assert made.is_fixed and [body.parts for body in made.bodies] == [(1,), (0,)]
    # Its hinge is turned round.
    assert made.swings[0].axis.tolist() == [0, -1, 0]
    assert not simplified(mechanism_of(links, [hinge(0, 1, (0, 0, 0))])).is_fixed


def test_trains_are_found_for_each_motor_or_the_plan_is_refused() -> None:
    links = [link(0, 0.3), link(1, 0.05), link(2, 0.05)]
    hinges = [hinge(0, 1, (0, 0, 0), port="A"), hinge(0, 2, (0.1, 0, 0), port="B")]
    made = mechanism_of(links, hinges, ports=("A", "B"), ratios=np.eye(2))
    first, second = trains(made, "try.ldr")
    assert (first.port, first.output, first.ratio, first.others) == ("A", 0, 1.0, ())
    assert (second.port, second.output) == ("B", 1)
    one_missing = replace(made, ports=("A", "C"))
    says = "try.ldr: the motor of port C drives the same part as another one, or nothing; remove it"
    with pytest.raises(PlanError) as caught:
        trains(one_missing, "try.ldr")
    assert str(caught.value) == says


# ---------------------------------------------------------------- trains


def meshing(first: int, second: int, *teeth: int, form: GearForm = GearForm.SPUR) -> Any:
    """Two links whose gears of so many teeth mesh."""
    gears = tuple(SimpleNamespace(teeth=count, form=form) for count in teeth)
    return first, second, SimpleNamespace(gears=gears)


def train_with(
    ratio: float = -1 / 3,
    *,
    second: dict[str, Any] | None = None,
    first: dict[str, Any] | None = None,
    masses_kg: tuple[float, ...] = (0.3, 0.002, 0.05),
    wheels: tuple[Wheel, ...] = (),
    meshes: tuple[Any, ...] = (meshing(1, 2, 12, 36),),
) -> Train:
    """The train of a motor on the chassis with link 1 on its shaft, and link 2 beside it."""
    links = [link(number, mass_kg) for number, mass_kg in enumerate(masses_kg)]
    shaft = {"port": "A", **(first or {})}
    hinges = [
        hinge(0, 1, (0, 0, 0), **shaft),
        hinge(0, 2, (0.032, 0, 0), **{"is_shaft": True, **(second or {})}),
    ]
    made = mechanism_of(links, hinges, ports=("A",), ratios=[[1.0], [ratio]], wheels=wheels)
    (found,) = trains(replace(made, meshes=meshes), "try.ldr")
    return found


def test_a_train_ends_where_it_carries_most() -> None:
    found = train_with()
    assert (found.port, found.output, found.teeth) == ("A", 1, (12, 36))
    # The size of a ratio is that of the teeth, its sign that of the motions.
    assert found.ratio == pytest.approx(-1 / 3) and found.others == ((0, 1.0),)
    heavy_shaft = train_with(masses_kg=(0.3, 0.06, 0.05))
    assert (heavy_shaft.output, heavy_shaft.teeth, heavy_shaft.ratio) == (0, (), 1.0)
    assert heavy_shaft.others == ((1, pytest.approx(-1 / 3)),)
    # A wheel is what a motor is for, however light it is; of equal loads the first one.
    rolling = train_with(masses_kg=(0.3, 0.06, 0.05), wheels=(Wheel(2, ORIGIN, 56.0, 2),))
    assert rolling.output == 1
    assert train_with(masses_kg=(0.3, 0.05, 0.05)).output == 0


@pytest.mark.parametrize(
    ("ratio", "is_geared"),
    [(-0.333, True), (0.338, True), (-0.328, True), (-0.35, False), (-0.32, False), (0.0, False)],
)
def test_a_ratio_is_that_of_the_teeth_within_two_percent(ratio: float, is_geared: bool) -> None:
    found = train_with(ratio)
    assert (found.output == 1) is is_geared and len(found.others) == is_geared
    if is_geared:
        assert found.ratio == pytest.approx(np.sign(ratio) / 3)


@pytest.mark.parametrize(
    "second",
    [
        # Not the axis of its gear; of another motor; a loop; a ball.
        {"is_shaft": False},
        {"port": "B"},
        {"closes_loop": True},
        {"is_ball": True},
    ],
)
def test_only_the_axis_of_a_gear_is_turned_by_its_teeth(second: dict[str, Any]) -> None:
    assert train_with(second=second).output == 0


def test_teeth_are_those_on_the_way_from_the_rotor() -> None:
    idle = (meshing(1, 3, 12, 20), meshing(3, 2, 20, 36))
    masses_kg = (0.3, 0.002, 0.05, 0.01)
    found = train_with(meshes=idle, masses_kg=masses_kg)
    assert found.teeth == (12, 20, 20, 36) and found.gears == (12, 36)
    # The way with the fewest gears counts.
    short = train_with(meshes=(*idle, meshing(2, 1, 36, 12)), masses_kg=masses_kg)
    assert short.teeth == (12, 36)
    # The motor pushes against its case, which carries gears too.
    by_case = train_with(meshes=(meshing(1, 0, 12, 20), meshing(0, 2, 20, 36)))
    assert by_case.output == 0 and by_case.teeth == ()
    # A motor that is held by its shaft turns its case, and what meshes with that.
    held = train_with(first={"turns_child": False}, meshes=(meshing(0, 2, 12, 36),))
    assert held.output == 1 and held.teeth == (12, 36)


def refused(made: Mechanism) -> str:
    with pytest.raises(PlanError) as caught:
        trains(made, "try.ldr")
    return str(caught.value)


def test_what_no_train_can_drive_is_told() -> None:
    links = [link(0, 0.3), link(1, 0.05), link(2, 0.05)]
    hinges = [hinge(0, 1, (0, 0, 0), port="A"), hinge(0, 2, (0.1, 0, 0), is_shaft=True)]
    made = mechanism_of(links, hinges, ports=("A",), ratios=[[1.0], [-1 / 3]])
    rack = replace(made, meshes=(meshing(1, 2, 12, 18, form=GearForm.RACK),))
    assert refused(rack) == (
        "try.ldr: a gear drives a rack; sliding parts have no twin, so drive a rotating part"
    )
    # Teeth of one body drive nothing.
    assert len(trains(replace(made, meshes=(meshing(1, 1, 12, 18, form=GearForm.RACK),)), "")) == 1
    # Two motors on one gear.
    both = [*hinges, hinge(0, 3, (0.2, 0, 0), port="B")]
    twice = mechanism_of(
        [*links, link(3, 0.01)],
        both,
        ports=("A", "B"),
        ratios=[[1.0, 0.0], [-1 / 3, -1 / 3], [0.0, 1.0]],
    )
    twice = replace(twice, meshes=(meshing(1, 2, 12, 36), meshing(3, 2, 12, 36)))
    assert refused(twice) == (
        "try.ldr: the motors of ports A, B drive the same part; give each part one motor"
    )
    # Open gears are no trains: each motor ends at its shaft.
    first, second = trains(twice, "try.ldr", {2})
    assert (first.output, first.teeth) == (0, ()) and (second.output, second.teeth) == (2, ())
