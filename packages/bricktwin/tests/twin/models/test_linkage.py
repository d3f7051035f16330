"""Constraints of linkages, as MuJoCo keeps them."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from bricktwin.plans.mechanism.articulation import Articulation, Drive, Follower, Geared, Rod
from bricktwin.plans.mechanism.kinematics import Hinge, Link
from bricktwin.plans.mechanism.open_gears import Coupling
from bricktwin.twin.models.linkage import Linkage, _constraints


def test_pin_within_one_body_leaves_no_rows():
    spec = mujoco.MjSpec()
    parents = {"a": spec.worldbody, "c": spec.worldbody}
    bodies = {}
    for name, parent in parents.items():
        bodies[name] = parent.add_body(name=name, pos=[2.0 * len(bodies), 0.0, 0.0])
        bodies[name].add_joint(name=f"joint_{name}")
    bodies["b"] = bodies["a"].add_body(name="b", pos=[1.0, 0.0, 0.0])
    for body in bodies.values():
        body.mass = 1.0
        body.inertia = [1.0, 1.0, 1.0]
        body.explicitinertial = True
    # The first of these pins joins what no joint moves against each other, so no joint shows in it.
    for first, second in (("a", "b"), ("a", "c")):
        pin = spec.add_equality()
        pin.type = mujoco.mjtEq.mjEQ_CONNECT
        pin.objtype = mujoco.mjtObj.mjOBJ_BODY
        pin.name1 = first
        pin.name2 = second
        pin.data[:3] = [0.5, 0.0, 0.0]
    model = spec.compile()
    gaps, slopes = _constraints(model, mujoco.MjData(model))
    assert gaps.shape == (3,)
    assert slopes.shape == (3, model.nv)


Y = np.array([0.0, 1.0, 0.0])
NOWHERE = np.zeros(3)


def hinge(parent: int, child: int, place: Any, axis: Any = Y, **values: Any) -> Hinge:
    defaults: dict[str, Any] = {"port": None, "closes_loop": False}
    return Hinge(parent, child, np.array(place, float), np.array(axis), **{**defaults, **values})


def body(part: int) -> Link:
    return Link((part,), 0.01, NOWHERE, np.eye(3))


def made_of(count: int, **values: Any) -> Articulation:
    """An articulation of so many bodies, each of the part of its number."""
    nothing: dict[str, Any] = dict.fromkeys(
        ("drives", "geared", "swings", "loops", "followers", "rods", "wheels"), ()
    )
    bodies = tuple(body(number) for number in range(count))
    return Articulation(bodies=bodies, is_fixed=True, **{**nothing, **values})


def drive(child: int, place: Any, gear: float = 1.0, port: str = "A", axis: Any = Y) -> Drive:
    return Drive(port, hinge(0, child, place, axis), gear, 0.0, ())


def placed(linkage: Linkage, part: int, point: Any) -> Any:
    turn, shift = linkage.motion(part)
    return turn @ np.array(point, float) + shift


def angle_of(linkage: Linkage, part: int) -> float:
    """Angle of a part about y, rad."""
    turn, _ = linkage.motion(part)
    return math.atan2(turn[0, 2], turn[0, 0])


@pytest.mark.parametrize("gear", [1.0, -2.0, 3.0])
def test_a_part_turns_about_its_hinge_by_its_gear(gear: float) -> None:
    point = (0.1, 0.02, 0.05)
    linkage = Linkage(made_of(2, drives=(drive(1, point, gear),)))
    assert linkage.free == ()
    for angle in (0.6, -1.1, 0.0):
        linkage.turn({"motor_A": angle})
        assert angle_of(linkage, 1) == pytest.approx(angle / gear)
        # Its hinge stays where it is, and so do the chassis and what is not in the robot.
        assert placed(linkage, 1, point) == pytest.approx(point)
        for other in (0, 99):
            turn, shift = linkage.motion(other)
            assert turn == pytest.approx(np.eye(3)) and shift == pytest.approx(np.zeros(3))


def test_what_hangs_on_a_part_goes_along_and_swings_by_itself() -> None:
    swing = hinge(1, 2, (0.1, 0.0, 0.0))
    linkage = Linkage(made_of(3, drives=(drive(1, (0, 0, 0)),), swings=(swing,)))
    assert linkage.free == ("joint_2_0",)
    linkage.turn({"motor_A": math.pi / 2})
    # About the axis to the left, the front goes down.
    assert placed(linkage, 2, (0.1, 0, 0)) == pytest.approx([0, 0, -0.1], abs=1e-9)
    assert angle_of(linkage, 2) == pytest.approx(math.pi / 2)
    linkage.turn({"joint_2_0": -math.pi / 2})
    assert angle_of(linkage, 2) == pytest.approx(0.0, abs=1e-9)
    assert angle_of(linkage, 1) == pytest.approx(math.pi / 2)


def test_a_ball_joint_has_three_angles() -> None:
    ball = hinge(0, 1, (0.1, 0.0, 0.0), is_ball=True)
    linkage = Linkage(made_of(2, swings=(ball,)))
    assert linkage.free == ("joint_1_0", "joint_1_1", "joint_1_2")
    linkage.turn({"joint_1_2": math.pi / 2})
    assert placed(linkage, 1, (0.2, 0, 0)) == pytest.approx([0.1, 0.1, 0.0], abs=1e-9)


def test_a_geared_part_turns_by_its_ratio() -> None:
    geared = Geared("A", hinge(0, 2, (0.05, 0.0, 0.0)), -1.5)
    linkage = Linkage(made_of(3, drives=(drive(1, (0, 0, 0), 2.0),), geared=(geared,)))
    assert linkage.free == ()
    for angle in (0.8, -0.5):
        linkage.turn({"motor_A": angle})
        # The ratio is one of the driven part, not of the shaft.
        assert angle_of(linkage, 2) == pytest.approx(-1.5 * angle / 2.0, abs=1e-5)


def four_bar(*, loop: bool, crank_m: float = 0.03) -> Linkage:
    """A crank at the origin, a rocker of 50 mm on an axis 80 mm ahead, and a coupler of 70 mm that
    is a rod, or a body that closes a loop."""
    near = np.array([0.0, 0.0, crank_m])
    # Where circles around both pins meet.
    far = meeting(near)
    crank = drive(1, (0, 0, 0))
    rocker = hinge(0, 2, (0.08, 0, 0))
    if not loop:
        rod = Rod(1, near, 2, far, (3,))
        return Linkage(made_of(3, drives=(crank,), swings=(rocker,), rods=(rod,)))
    coupler, closing = hinge(1, 3, near), hinge(2, 3, far, closes_loop=True)
    return Linkage(made_of(4, drives=(crank,), swings=(rocker, coupler), loops=(closing,)))


def meeting(near: Any) -> Any:
    """The upper point that is 70 mm from the crank's pin, and 50 mm from the rocker's axis."""
    axis = np.array([0.08, 0.0, 0.0])
    way = axis - near
    distance = float(np.linalg.norm(way))
    along = (0.07**2 - 0.05**2 + distance**2) / (2 * distance)
    aside = math.sqrt(0.07**2 - along**2)
    across = np.array([-way[2], 0.0, way[0]]) / distance
    return near + along * way / distance + aside * across


@pytest.mark.parametrize("loop", [False, True])
def test_a_four_bar_linkage_moves_as_its_circles_meet(loop: bool) -> None:
    linkage = four_bar(loop=loop)
    assert linkage.free == ()
    near = np.array([0.0, 0.0, 0.03])
    far = meeting(near)
    for degrees in (20, 75, 150, 220, 300, 360, 10):
        angle = math.radians(degrees)
        linkage.turn({"motor_A": angle})
        pin = np.array([0.03 * math.sin(angle), 0.0, 0.03 * math.cos(angle)])
        expected = meeting(pin)
        assert placed(linkage, 1, near) == pytest.approx(pin, abs=1e-6)
        assert placed(linkage, 2, far) == pytest.approx(expected, abs=2e-5)
        # The coupler is drawn between both pins.
        assert placed(linkage, 3, near) == pytest.approx(pin, abs=2e-5)
        assert placed(linkage, 3, far) == pytest.approx(expected, abs=5e-5)


def test_a_linkage_that_cannot_be_closed_stays_as_it_was() -> None:
    """A crank of 70 mm that turns away from the rocker, farther than the coupler reaches."""
    linkage = four_bar(loop=False, crank_m=0.07)
    linkage.turn({"motor_A": math.radians(30.0)})
    before = angle_of(linkage, 2)
    linkage.turn({"motor_A": math.radians(-80.0)})
    # The crank is where it is asked to be, at the rocker's cost.
    assert angle_of(linkage, 1) == pytest.approx(math.radians(-80.0))
    assert math.isfinite(angle_of(linkage, 2)) and abs(angle_of(linkage, 2) - before) < math.pi
    linkage.turn({"motor_A": math.radians(30.0)})
    assert angle_of(linkage, 2) == pytest.approx(before, abs=1e-3)


def test_a_shaft_that_is_only_seen_spins_on_its_carrier() -> None:
    follower = Follower(0, (5,), np.array([0.02, 0.0, 0.0]), Y, "A", 3.0)
    linkage = Linkage(made_of(2, drives=(drive(1, (0, 0, 0), 2.0),), followers=(follower,)))
    linkage.turn({"motor_A": 0.4})
    # Three times the driven part's turn, backwards for its axis points out of the shaft.
    assert abs(angle_of(linkage, 5)) == pytest.approx(3.0 * 0.2)
    assert placed(linkage, 5, (0.02, 0, 0)) == pytest.approx([0.02, 0, 0])


def test_of_motors_on_one_gear_the_first_turns_the_other() -> None:
    """Gears of 12 and 36 teeth between what both turn."""
    drives = (drive(1, (0, 0, 0)), drive(2, (0.06, 0, 0), port="B"))
    coupling = Coupling(((1, 1.0 / 3.0), (2, 1.0)))
    linkage = Linkage(made_of(3, drives=drives, couplings=(coupling,)))
    linkage.turn({"motor_A": 0.9})
    assert angle_of(linkage, 1) == pytest.approx(0.9)
    assert angle_of(linkage, 2) == pytest.approx(-0.3, abs=1e-5)
