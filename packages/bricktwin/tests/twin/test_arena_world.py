"""World of several robots: one time for all, whoever lets it pass, and whoever is interrupted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.hub.link.lockstep import HubLink
from brickhub.target import whole_interface
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.twin.arena import Arena, Contestant, Place
from bricktwin.twin.mujoco_arena import ArenaWorld
from bricktwin.twin.scene import OPEN_FLOOR

APART = Arena(
    (
        Contestant("one", TWO_WHEELER, Place()),
        Contestant("two", SCOUT, Place(y_m=(0.6, 0.6))),
    ),
    gap_m=0.0,
)


@pytest.fixture
def world() -> ArenaWorld:
    world = ArenaWorld(APART)
    world.place(np.random.default_rng(0))
    return world


def test_the_others_are_run_before_time_passes(world: ArenaWorld) -> None:
    """Each hub up to the same time; a motor that it starts there acts from there on."""
    told: list[tuple[str, int, int]] = []

    def run(name: str, number: int, time_ms: int) -> None:
        told.append((name, time_ms, world.time_ms))
        world.bodies[number].advance_to(time_ms)

    world.runners = [lambda ms: run("one", 0, ms), lambda ms: run("two", 1, ms)]
    times: list[int] = []
    world.on_time.append(times.append)
    world.bodies[0].advance_to(5)
    world.bodies[0].advance_to(20)
    assert told == [("two", 5, 0), ("two", 20, 5)]
    assert times == [5, 20] and world.time_ms == 20 and world.steps == 8
    world.bodies[1].advance_to(20)
    assert world.steps == 8, "it is there already"


def test_hub_that_is_interrupted_stops_no_other(world: ArenaWorld) -> None:
    """Ctrl-C ends the program of one hub while it waits for another, which still stops its
    motors."""

    def interrupted(_time_ms: int) -> None:
        raise KeyboardInterrupt

    one, two = world.bodies
    world.runners = [lambda ms: None, interrupted]
    with pytest.raises(KeyboardInterrupt):
        one.advance_to(10)
    world.runners = []
    two.advance_to(500)
    assert world.time_ms == 500
    one.advance_to(600)
    assert world.time_ms == 600


def test_hub_that_ends_while_another_waits_for_it_has_time(world: ArenaWorld) -> None:
    """A program that is interrupted stops its motors one by one, which takes longer than it was to
    run."""
    one, two = world.bodies
    world.runners = [lambda ms: None, lambda ms: two.advance_to(ms + 50)]
    one.advance_to(10)
    assert world.time_ms == 60


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_hub_that_is_stopped_runs_no_other(world: ArenaWorld, order: tuple[int, int]) -> None:
    """Hubs run one another while their programs wait; a stop lets no time pass for any of them."""
    hubs = [VirtualHub(body) for body in world.bodies]
    world.runners = [hub.run_on_until for hub in hubs]
    links = []
    for hub, body in zip(hubs, world.bodies, strict=True):
        links.append(HubLink(hub, body.robot, whole_interface(body.robot)))
        links[-1].open()
    for _ in range(3):
        for link in links:
            link.send([30.0, 30.0])
        for link in links:
            link.receive()
    before_ms = world.time_ms
    for number in order:
        links[number].close()
    assert world.time_ms == before_ms
    assert not any(hub.machine.is_driven for hub in hubs)


def test_robots_start_in_their_places(world: ArenaWorld) -> None:
    one, two = world.poses()
    assert math.hypot(one.x_m - two.x_m, one.y_m - two.y_m) == pytest.approx(0.6, abs=1e-3)
    assert all(body.scene == OPEN_FLOOR for body in world.bodies)


def test_places_keep_the_gap_or_are_refused() -> None:
    wide = Place(x_m=(-1.0, 1.0), y_m=(-1.0, 1.0))
    robots = tuple(replace(robot, place=wide) for robot in APART.robots)
    apart = ArenaWorld(replace(APART, robots=robots, gap_m=0.8))
    for seed in range(5):
        apart.place(np.random.default_rng(seed))
        one, two = apart.poses()
        assert math.hypot(one.x_m - two.x_m, one.y_m - two.y_m) > 0.79
    with pytest.raises(TwinError, match="no starts were found where one, two are 0.8 m apart"):
        ArenaWorld(replace(APART, gap_m=0.8)).place(np.random.default_rng(0))
