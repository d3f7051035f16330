"""A hand that pulls what is in a world, by its forces and its steps."""

from __future__ import annotations

import math

import mujoco
import pytest

from bricktwin.twin.engines.mujoco_engine import MujocoEngine
from bricktwin.twin.hand import Hand

KG = 2.0
LOOK_S = 0.005
"""A hub's control loop, in each of which a hand acts."""


@pytest.fixture
def engine() -> MujocoEngine:
    """A cart with a wheel, an arm on a fixed base, and a wall that somebody can move."""
    spec = mujoco.MjSpec()
    spec.option.timestep = LOOK_S
    spec.option.gravity = [0.0, 0.0, 0.0]
    cart = spec.worldbody.add_body(name="cart")
    cart.add_freejoint()
    cart.add_geom(size=[0.1, 0.0, 0.0], mass=KG - 0.5)
    wheel = cart.add_body(name="wheel")
    wheel.add_joint(axis=[0.0, 1.0, 0.0])
    wheel.add_geom(size=[0.1, 0.0, 0.0], mass=0.5)
    base = spec.worldbody.add_body(name="base", pos=[3.0, 0.0, 0.0])
    base.add_geom(size=[0.1, 0.0, 0.0], mass=5.0)
    arm = base.add_body(name="arm")
    arm.add_joint(axis=[0.0, 0.0, 1.0])
    arm.add_geom(size=[0.1, 0.0, 0.0], pos=[1.0, 0.0, 0.0], mass=1.0)
    wall = spec.worldbody.add_body(name="wall", mocap=True, pos=[0.5, 0.2, 0.3])
    wall.add_geom(size=[0.1, 0.0, 0.0], contype=0, conaffinity=0)
    engine = MujocoEngine(spec.compile())
    engine.forward()
    return engine


def forces(engine: MujocoEngine) -> dict[str, list[float]]:
    """Forces and torques on bodies, of those that have some."""
    applied = engine.xfrc_applied
    of_bodies = {
        name: list(applied[6 * body : 6 * body + 6])
        for body, name in enumerate(engine.names("body"))
    }
    return {name: values for name, values in of_bodies.items() if any(values)}


def test_a_robot_is_pulled_as_a_whole_by_a_spring_with_critical_damping(
    engine: MujocoEngine,
) -> None:
    hand = Hand(engine)
    assert len(hand) == 6
    # Whatever of it is gripped.
    for body in ("cart", "wheel"):
        hand.pull(engine.index("body", body), 0.01, -0.02)
        assert forces(engine) == {
            "cart": pytest.approx([KG * 225.0 * 0.01, -KG * 225.0 * 0.02, 0.0, 0.0, 0.0, 0.0])
        }
    engine.qvel[0], engine.qvel[1] = 0.1, 0.2
    engine.forward()
    hand.pull(1, 0.0, 0.0)
    assert forces(engine)["cart"][:2] == pytest.approx([-KG * 30.0 * 0.1, -KG * 30.0 * 0.2])


def test_a_robot_comes_to_the_hand_without_going_beyond(engine: MujocoEngine) -> None:
    hand = Hand(engine)
    ways = []
    for _ in range(200):
        hand.pull(1, 0.05, 0.0)
        engine.step(1)
        ways.append(engine.qpos[0])
    assert max(ways) < 0.051 and ways[-1] == pytest.approx(0.05, abs=1e-3)
    assert engine.qpos[1] == pytest.approx(0.0, abs=1e-6)


def test_a_hand_pulls_with_no_more_than_twice_the_weight(engine: MujocoEngine) -> None:
    hand = Hand(engine)
    hand.pull(1, 30.0, 40.0)
    force = forces(engine)["cart"]
    most = 2.0 * KG * 9.81
    assert force[:2] == pytest.approx([0.6 * most, 0.8 * most])


def test_of_what_stands_on_a_fixed_base_the_part_that_is_gripped_is_pulled(
    engine: MujocoEngine,
) -> None:
    hand = Hand(engine)
    hand.pull(engine.index("body", "arm"), 4.0, 0.01)
    # Towards the point from its centre of mass, and by its own mass.
    assert forces(engine) == {
        "arm": pytest.approx([0.0, 225.0 * 0.01, 0.0, 0.0, 0.0, 0.0], abs=1e-9)
    }


def test_who_is_let_go_is_pulled_no_more(engine: MujocoEngine) -> None:
    hand = Hand(engine)
    hand.pull(1, 0.1, 0.1)
    hand.pull(engine.index("body", "arm"), 4.0, 0.1)
    assert list(forces(engine)) == ["arm"]
    hand.let_go()
    assert forces(engine) == {}
    hand.let_go()
    hand.pull(engine.index("body", "wall"), 0.0, 0.0)
    assert forces(engine) == {}


def test_a_wall_comes_by_two_millimetres_at_a_time_where_it_was_gripped(
    engine: MujocoEngine,
) -> None:
    hand = Hand(engine)
    wall = engine.index("body", "wall")
    # It is gripped 3 cm and 1 cm beside its middle, and stays there.
    hand.pull(wall, 0.53, 0.21)
    assert list(engine.mocap_pos) == [0.5, 0.2, 0.3]
    hand.pull(wall, 0.53 + 0.03, 0.21 - 0.04)
    assert list(engine.mocap_pos) == pytest.approx([0.5 + 0.0012, 0.2 - 0.0016, 0.3])
    for _ in range(30):
        hand.pull(wall, 0.53 + 0.03, 0.21 - 0.04)
    assert list(engine.mocap_pos) == pytest.approx([0.53, 0.16, 0.3])
    # Let go, it is gripped anew.
    hand.let_go()
    hand.pull(wall, 0.9, 0.9)
    assert list(engine.mocap_pos) == pytest.approx([0.53, 0.16, 0.3])
    hand.pull(wall, 0.9, 0.901)
    assert math.dist(engine.mocap_pos, (0.53, 0.161, 0.3)) < 1e-9
