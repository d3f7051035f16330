"""Several hubs in one room of a tab: each in a thread here, as in a worker there, beside the same
programs in one thread, as ``brickhub run left.py right.py`` runs them."""

from __future__ import annotations

import functools
import io
import json
import queue
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from benchmarks import tab_motion
from brickhub.errors import TwinError
from brickhub.robot import Robot
from brickhub.virtual.machine import Machine
from brickhub.virtual.room import HubProgramFile, Room
from brickhub.virtual.run import Operation, ProgramStopped, run_file
from bricktwin.robots import SCOUT, TWO_WHEELER, WALKER
from bricktwin.site.robot_files import sharing_file, world_file
from bricktwin.site.robots import _can_share
from bricktwin.site.tab.robot_file import put_together_text
from bricktwin.site.tab.room import RoomHand, Seat, ToldBody, shared_world
from bricktwin.twin.arena import SharedWorld, side_by_side
from bricktwin.twin.models.shared_scene import shared_scene, starts_in
from bricktwin.twin.mujoco_arena import arena_model
from bricktwin.twin.objects import Wall
from bricktwin.twin.scene import OPEN_FLOOR, Scene
from bricktwin.worlds import world as worlds_by_name

RADIO = "from pybricks.messaging import BLERadio\nfrom pybricks.tools import StopWatch, wait\n"
SENDER = f"""{RADIO}
radio = BLERadio(broadcast_channel=1, observe_channels=[2])
for number in range(40):
    radio.broadcast((number, number / 3, "é", b"\\x00", True))
    wait(number)
    print(number, radio.observe(2), radio.signal_strength(2), end=";" if number % 3 else "\\n")
"""
LISTENER = f"""{RADIO}
radio = BLERadio(broadcast_channel=2, observe_channels=[1])
watch = StopWatch()
seen = None
while watch.time() < 900:
    if radio.observe(1) != seen:
        seen = radio.observe(1)
        radio.broadcast(seen)
        print(watch.time(), seen)
1 / 0
"""
DRIVER = f"""{RADIO}
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
from pybricks.robotics import DriveBase
radio = BLERadio(broadcast_channel=1)
left, right = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A)
base = DriveBase(left, right, 56, 130)
for mm in 60, -40:
    base.straight(mm)
    radio.broadcast(mm)
    print(left.angle(), right.angle())
base.turn(90)
print(left.angle(), right.angle())
"""
FOLLOWER = f"""{RADIO}
from pybricks.parameters import Direction, Port
from pybricks.pupdevices import Motor
radio = BLERadio(observe_channels=[1])
left, right = Motor(Port.E, Direction.COUNTERCLOCKWISE), Motor(Port.A)
while radio.observe(1) != -40:
    left.dc(5 * (radio.observe(1) or 0) // 6)
    right.run(-200)
    wait(7)
print(left.angle(), right.angle(), radio.signal_strength(1))
"""


class Threads:
    """The other hubs of one hub, in threads; implements ``Others``."""

    def __init__(self, boxes: dict[tuple[int, int], queue.Queue[str]], number: int) -> None:
        self._boxes = boxes
        self._number = number

    def tell(self, deeds: str) -> None:
        for (sender, _), box in self._boxes.items():
            if sender == self._number:
                box.put(deeds)

    def hear(self, number: int, longest_ms: int) -> str:
        try:
            return f"[{self._boxes[number, self._number].get(timeout=longest_ms / 1000)}]"
        except queue.Empty:
            return ""


Attend = Callable[[int, Seat, Machine], None]


def in_threads(
    paths: list[Path],
    worlds: list[SharedWorld[ToldBody]] | None = None,
    attend: Attend = lambda *_: None,
) -> tuple[list[int], list[str], list[str]]:
    """Exit codes, outputs and errors of programs whose hubs have a thread each."""
    count = len(paths)
    boxes = {(a, b): queue.Queue[str]() for a in range(count) for b in range(count) if a != b}
    outs = [io.BytesIO() for _ in paths]
    errs = [io.StringIO() for _ in paths]
    codes = [-1] * count

    def run(number: int) -> None:
        seat = Seat(Threads(boxes, number), number, [path.name for path in paths])
        body = None if worlds is None else seat.enter(worlds[number])

        def begin(machine: Machine) -> None:
            seat.attend(machine)
            attend(number, seat, machine)

        try:
            codes[number] = run_file(
                paths[number],
                body,
                stdout=seat.marked(outs[number], b": ", b"\n"),  # type: ignore[arg-type]
                stderr=seat.marked(errs[number], ": ", "\n"),  # type: ignore[arg-type]
                operation=Operation(attend=begin),
            )
        finally:
            seat.leave()

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    return codes, [out.getvalue().decode() for out in outs], [err.getvalue() for err in errs]


def in_one(
    paths: list[Path], world: SharedWorld[ToldBody] | None = None
) -> tuple[list[int], list[str], list[str]]:
    """The same in one thread."""
    out, err = io.BytesIO(), io.StringIO()
    bodies = [None] * len(paths) if world is None else world.bodies
    programs = [HubProgramFile(path, body) for path, body in zip(paths, bodies, strict=True)]
    room = Room(programs, stdout=out, stderr=err)
    if world is not None:
        room = Room(programs, stdout=out, stderr=err, distance_m=world.distance_m)
        world.runners = [partial(room.run_until, number) for number in range(len(paths))]
    codes = room.run()

    def of(text: str) -> list[str]:
        marks = tuple(f"{path.stem}: " for path in paths)
        lines = text.splitlines(keepends=True)
        return ["".join(line for line in lines if line.startswith(mark)) for mark in marks]

    return codes, of(out.getvalue().decode()), of(err.getvalue())


def written(folder: Path, *sources: str) -> list[Path]:
    paths = []
    for name, source in zip("abcd", sources, strict=False):
        path = folder / f"{name}.py"
        path.write_text(source, encoding="utf-8")
        paths.append(path)
    return paths


def test_benches_print_what_they_print_in_one_thread(tmp_path: Path) -> None:
    paths = written(tmp_path, SENDER, LISTENER, LISTENER.replace("900", "300"))
    codes, outs, errs = in_threads(paths)
    assert (codes, outs, errs) == in_one(paths)
    assert codes == [0, 1, 1] and all(outs)
    assert errs[1].startswith("b: Traceback")


@functools.cache
def part_of(described: Robot | Scene) -> str:
    """File of a robot or of a scene, as the tab reads it."""
    file = sharing_file(described) if isinstance(described, Robot) else world_file(described)
    return json.dumps(file, allow_nan=False)


def file_of(robots: tuple[Robot, ...], scene: Scene) -> dict[str, Any]:
    """File of robots that share a scene, as the tab puts it together."""
    parts = f"[{','.join(map(part_of, robots))}]"
    file: dict[str, Any] = json.loads(put_together_text(parts, part_of(shared_scene(scene))))
    return file


def world(
    robots: tuple[Robot, ...] = (TWO_WHEELER, SCOUT), scene: Scene = OPEN_FLOOR
) -> SharedWorld[ToldBody]:
    file = file_of(robots, scene)
    return shared_world(file, tab_motion.engine_of(json.dumps(file)))


@pytest.mark.parametrize("robots", [(TWO_WHEELER, SCOUT), (SCOUT, TWO_WHEELER)])
def test_worlds_of_all_workers_are_the_same(tmp_path: Path, robots: tuple[Robot, ...]) -> None:
    paths = written(tmp_path, DRIVER, FOLLOWER)
    worlds = [world(robots), world(robots)]
    one = world(robots)
    assert in_threads(paths, worlds) == in_one(paths, one)
    # The world ends with the last of its hubs, in its own worker.
    assert list(worlds[0].engine.qpos) == list(one.engine.qpos)


def test_three_robots_share_a_field_with_a_ball(tmp_path: Path) -> None:
    paths = written(tmp_path, DRIVER, FOLLOWER, FOLLOWER)
    robots = (TWO_WHEELER, SCOUT, TWO_WHEELER)
    field = worlds_by_name("football")
    worlds = [world(robots, field) for _ in robots]
    one = world(robots, field)
    codes, outs, errs = in_threads(paths, worlds)
    assert (codes, outs, errs) == in_one(paths, one)
    assert codes == [0, 0, 0] and outs[1] != outs[2]
    assert list(worlds[0].engine.qpos) == list(one.engine.qpos)


@pytest.mark.parametrize(
    ("robots", "name"),
    [((SCOUT, WALKER, TWO_WHEELER), "football"), ((WALKER,) * 4, "maze")],
)
def test_what_a_tab_puts_together_is_the_model_of_a_computer(
    robots: tuple[Robot, ...], name: str
) -> None:
    """In all numbers of the physics; what MuJoCo derives differs in the last digits."""
    scene = worlds_by_name(name)
    made = tab_motion.engine_of(json.dumps(file_of(robots, scene))).model
    model = arena_model(side_by_side(robots, scene))
    assert made.opt.jacobian == model.opt.jacobian
    compared = 0
    for field in dir(model):
        values = getattr(model, field)
        # Geometries are fewer: what is only to be seen is left out.
        kinds = ("body_", "jnt_", "dof_", "site_", "actuator_", "qpos", "tendon_", "sensor_")
        if field.startswith(kinds) and not field.startswith(("body_geom", "body_bvh")):
            np.testing.assert_allclose(getattr(made, field), values, rtol=1e-9, err_msg=field)
            compared += 1
    assert compared > 100
    for kind in (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_ACTUATOR):
        for number in range(model.nu):
            names = [mujoco.mj_id2name(one, kind, number) for one in (made, model)]
            assert names[0] == names[1]
    # What collides with what.
    touched = {}
    for one in (made, model):
        bits = [*zip(one.geom_bodyid, one.geom_contype, one.geom_conaffinity, strict=True)]
        touched[one is made] = sorted(map(tuple, (bit for bit in bits if bit[1] or bit[2])))
    assert str(touched[True]) == str(touched[False])


def test_a_scene_for_one_robot_alone_is_not_shared() -> None:
    with pytest.raises(TwinError, match=r"a wall before its sensor .* is for one robot alone"):
        side_by_side((SCOUT, SCOUT), worlds_by_name("wall"))
    narrow = Scene(objects=tuple(Wall((x, -300), (x, 300)) for x in (-250, 250)))
    closed = tuple(Wall((-250, y), (250, y)) for y in (-300, 300))
    with pytest.raises(TwinError, match="there is no room for 2 robots"):
        starts_in(replace(narrow, objects=narrow.objects + closed), 2)


def test_a_second_robot_takes_the_place_of_the_opponent() -> None:
    shared = world((SCOUT, SCOUT), worlds_by_name("sumo"))
    places = [(pose.x_m, abs(pose.heading_deg)) for pose in shared.poses()]
    assert places == [pytest.approx((-0.17, 0), abs=0.01), pytest.approx((0.17, 180), abs=0.01)]
    assert shared.arena.scene.pushable == {}


def test_what_the_page_pulls_is_pulled_in_all_worlds(tmp_path: Path) -> None:
    waits = f"{RADIO}wait(400)\n"
    paths = written(tmp_path, waits, waits)
    worlds = [world(), world()]
    start_m = worlds[0].bodies[1].pose().x_m

    class Pulls:
        def __init__(self, hand: RoomHand, body: int) -> None:
            self._hand = hand
            self._body = body

        def keep(self, time_ms: float) -> None:
            if 100 <= time_ms < 300:
                self._hand.pull(self._body, 0.2, 0.6)
            else:
                self._hand.let_go()

    def attend(number: int, seat: Seat, machine: Machine) -> None:
        hand = seat.hand()
        assert hand is not None
        if number == 0:
            machine.pace = Pulls(hand, worlds[0].bodies[1].chassis)  # type: ignore[assignment]

    codes, _, _ = in_threads(paths, worlds, attend)
    assert codes == [0, 0]
    assert worlds[0].bodies[1].pose().x_m > start_m + 0.05
    assert list(worlds[0].engine.qpos) == list(worlds[1].engine.qpos)
    assert not any(worlds[0].engine.xfrc_applied)


def test_a_hub_that_waits_for_the_others_is_stopped(tmp_path: Path) -> None:
    """The other one computes for ever, and lets no time pass."""
    waits = f"{RADIO}wait(400)\n"
    (path,) = written(tmp_path, waits)
    boxes = {(0, 1): queue.Queue[str](), (1, 0): queue.Queue[str]()}
    seat = Seat(Threads(boxes, 0), 0, ["a.py", "b.py"])
    err = io.StringIO()

    def stop() -> None:
        raise ProgramStopped

    seat.on_wait = stop
    run_file(
        path,
        stdout=io.BytesIO(),
        stderr=seat.marked(err, ": ", "\n"),  # type: ignore[arg-type]
        operation=Operation(attend=seat.attend),
    )
    seat.leave()
    assert err.getvalue() == "a: The program was stopped (SystemExit).\n"
    *_, last = boxes[0, 1].queue
    assert json.loads(last)[-1] == ["end"]


def test_who_can_share_a_world() -> None:
    from bricktwin.robots import CART, EV3_DRIVER, ROBO_ARM, WALKER

    robots = (TWO_WHEELER, SCOUT, WALKER, EV3_DRIVER, ROBO_ARM, CART)
    assert [robot for robot in robots if _can_share(robot)] == [TWO_WHEELER, SCOUT, WALKER]


@pytest.mark.parametrize("start", [(1, 2), (1, 2, "north"), 3, (0, 0, float("nan"))])
def test_a_start_of_another_robot_is_a_place_and_a_heading(start: Any) -> None:
    with pytest.raises(TwinError, match="scene: another robot starts at .*; give x, y"):
        Scene(others_start=(start,))
