"""World of several robots: one time for all, whoever lets it pass, and whoever is interrupted."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from brickhub.errors import TwinError
from brickhub.hub.link.lockstep import HubLink
from brickhub.robot import HubKind, Robot
from brickhub.robot.spec import BENCH
from brickhub.target import whole_interface
from brickhub.virtual.virtual_transport import VirtualHub
from bricktwin.robots import SCOUT, TWO_WHEELER
from bricktwin.twin.arena import (
    Arena,
    Contestant,
    Load,
    Mark,
    Place,
    SharedWorld,
    side_by_side,
)
from bricktwin.twin.mujoco_arena import ArenaWorld, arena_spec
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.twin.standing import Pose

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


def test_robots_share_a_scene_however_near_it_puts_them() -> None:
    near = Scene(start_mm=((-100.0, 100.0), (0.0, 40.0)), others_start=((100.0, 20.0, 180.0),))
    arena = side_by_side((TWO_WHEELER, SCOUT), near)
    starts = SharedWorld._starts(SimpleNamespace(arena=arena), np.random.default_rng(0))
    assert starts == [Pose(0.0, 0.02, 0.0), Pose(0.1, 0.02, 180.0)]
    assert [robot.name for robot in arena.robots] == ["robot1", "robot2"]
    assert arena.robots[0].color != arena.robots[1].color
    assert arena.scene == near


def test_a_place_draws_each_of_its_ranges() -> None:
    class Largest:
        def uniform(self, low: float, high: float) -> float:
            assert low < high
            return high

    place = Place((0.1, 0.2), (-0.4, -0.3), (10.0, 50.0))
    assert place.draw(Largest()) == Pose(0.2, -0.3, 50.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("robots", "loads", "marks"),
    [
        ((), (), ()),
        (("one", "one"), (), ()),
        (("one",), ("one",), ()),
        (("one",), ("box",), ("box",)),
        (("one",), (), ("one",)),
    ],
)
def test_all_that_is_in_an_arena_has_a_name_of_its_own(
    robots: tuple[str, ...], loads: tuple[str, ...], marks: tuple[str, ...]
) -> None:
    half_m = (0.05, 0.05, 0.05)
    with pytest.raises(TwinError, match="give each robot, load and mark a name of its own"):
        Arena(
            tuple(Contestant(name, SCOUT, Place()) for name in robots),
            tuple(Load(name, half_m, 0.1, 0.5, Place()) for name in loads),
            marks=tuple(Mark(name, half_m, (1.0, 0.0, 0.0)) for name in marks),
        )


def test_an_arena_has_no_more_motors_than_circuits() -> None:
    each = len(BENCH.motors)
    robots = [Contestant(f"robot{number}", BENCH, Place()) for number in range(31 // each + 1)]
    assert Arena(tuple(robots[:-1]))
    with pytest.raises(TwinError, match="have more than 31 motors"):
        Arena(tuple(robots))


@pytest.fixture
def simple_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that are a ball with a motor; those of no motors stand on a fixed base."""

    def load(robot: Robot, *_scene: Scene, alone: bool) -> mujoco.MjSpec:
        assert not alone
        spec = mujoco.MjSpec()
        chassis = spec.worldbody.add_body(name="chassis")
        if robot.motors:
            chassis.add_freejoint()
        chassis.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
        wheel = chassis.add_body(name="wheel")
        wheel.add_joint(name="axle")
        wheel.add_geom(size=[0.1, 0.0, 0.0], mass=0.1)
        spec.worldbody.add_light()
        spec.add_actuator(
            name="motor", target="axle", trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=[1.0] + 5 * [0.0]
        )
        return spec

    monkeypatch.setattr("bricktwin.twin.models.load.load_model", load)


@pytest.fixture
def walled(simple_models: None) -> mujoco.MjSpec:
    """A narrow field with a box to push and a post."""
    return arena_spec(
        Arena(
            (Contestant("one", TWO_WHEELER, Place(), (0.1, 0.2, 0.3)),),
            (Load("box", (0.05, 0.06, 0.07), 0.2, 0.4, Place()),),
            half_size_m=(1.5, 0.4),
            marks=(Mark("post", (0.01, 0.02, 0.1), (0.5, 0.6, 0.7)),),
        )
    )


def test_walls_stand_around_the_floor_and_close_its_corners(walled: mujoco.MjSpec) -> None:
    """Their inner sides are the edges of the floor, and they reach from edge to edge."""
    inner = {}
    for geom in walled.geoms:
        if geom.name.startswith("wall_"):
            low, high = geom.pos - geom.size, geom.pos + geom.size
            assert low[2] == pytest.approx(0.0)
            axis = int(geom.name[5])
            assert high[1 - axis] == pytest.approx((1.5, 0.4)[1 - axis])
            assert low[1 - axis] == -high[1 - axis]
            inner[geom.name] = low[axis] if geom.pos[axis] > 0 else high[axis]
    assert inner == {
        "wall_0+": pytest.approx(1.5),
        "wall_0-": pytest.approx(-1.5),
        "wall_1+": pytest.approx(0.4),
        "wall_1-": pytest.approx(-0.4),
    }


@pytest.mark.parametrize("half_m", [(1.5, 0.4), (0.4, 1.5), (0.5, 0.5), None])
@pytest.mark.usefixtures("simple_models")
def test_the_camera_of_an_arena_sees_all_of_its_floor(half_m: tuple[float, float] | None) -> None:
    robot = Contestant("one", TWO_WHEELER, Place())
    (camera,) = [
        camera
        for camera in arena_spec(Arena((robot,), half_size_m=half_m)).cameras
        if camera.name == "arena"
    ]
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, camera.quat)
    farthest = 0.0
    for x_m, y_m in itertools.product(*((-side, side) for side in half_m or (0.7, 0.7))):
        right, up, backward = turn.reshape(3, 3).T @ (np.array([x_m, y_m, 0.0]) - camera.pos)
        assert backward < 0
        farthest = max(farthest, abs(right / backward), abs(up / backward))
    # In a square picture, and not as a speck in its middle.
    edge = math.tan(math.radians(camera.fovy / 2))
    assert 0.5 * edge < farthest <= 1.1 * edge


def test_loads_are_pushed_and_marks_are_only_seen(walled: mujoco.MjSpec) -> None:
    box, post = walled.body("box"), walled.body("post")
    (geom,) = box.geoms
    assert geom.size.tolist() == [0.05, 0.06, 0.07] and box.pos.tolist() == [0.0, 0.0, 0.07]
    assert geom.mass == 0.2 and geom.friction[0] == 0.4 and geom.contype == 1
    assert [joint.type for joint in box.joints] == [mujoco.mjtJoint.mjJNT_FREE]
    (seen,) = post.geoms
    assert post.mocap and not seen.contype and not seen.conaffinity
    # It stands on the floor.
    assert seen.pos[2] - seen.size[2] == 0.0
    assert seen.size.tolist() == [0.01, 0.02, 0.1]
    assert seen.rgba.tolist() == pytest.approx([0.5, 0.6, 0.7, 1.0])
    disc = walled.body("one/chassis").geoms[-1]
    assert disc.rgba.tolist() == pytest.approx([0.1, 0.2, 0.3, 1.0]) and not disc.contype


@pytest.mark.usefixtures("simple_models")
def test_robots_of_an_arena_collide_with_others_but_not_with_themselves() -> None:
    spec = arena_spec(Arena(tuple(Contestant(f"r{number}", SCOUT, Place()) for number in range(3))))
    bits = []
    for number in range(3):
        geoms = [geom for geom in spec.geoms if geom.parent.name.startswith(f"r{number}/")]
        (touching,) = {(geom.contype, geom.conaffinity) for geom in geoms if geom.contype}
        bits.append(touching)

    def collide(one: tuple[int, int], other: tuple[int, int]) -> bool:
        return bool(one[0] & other[1] or other[0] & one[1])

    for one, other in itertools.product(range(3), repeat=2):
        assert collide(bits[one], bits[other]) is (one != other)
    surroundings = (1, 1)
    assert all(collide(one, surroundings) for one in bits)
    assert [actuator.group for actuator in spec.actuators] == [0, 1, 2]
    assert len(spec.lights) == 1


@pytest.mark.usefixtures("simple_models")
def test_a_robot_on_a_fixed_base_shares_no_world() -> None:
    fixed = Robot("crane", HubKind.PRIME)
    with pytest.raises(TwinError, match="'crane' stands on a fixed base"):
        arena_spec(Arena((Contestant("one", fixed, Place()),)))
