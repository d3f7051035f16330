"""Robots on the page: how a real one is drawn from its sensors, its link, its pace, and what drives
it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, exploration_type

from brickhub.entry import Entry
from brickhub.robot import HubKind, Motor
from brickhub.robot import Robot as Described
from bricksrl.envs import get_task
from bricksrl.envs.arenas.carry import CARRY
from bricksrl.envs.arenas.guide import GATE
from bricksrl.envs.arenas.tag import TAG
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.errors import TwinError
from bricksrl.page import arena, live, robot_view
from bricksrl.page import hand as hands
from bricksrl.page.arena import ArenaPage
from bricksrl.page.board import IMAGE, POSES, Board, BoardReader
from bricksrl.page.hand import Hand
from bricksrl.page.live import PUSH_TIMEOUT_S, LivePage, PageDriver
from bricksrl.page.plan_view import PlanView
from bricksrl.page.program import ProgramPage
from bricksrl.page.robot_view import RobotView
from bricksrl.page.server import PageOptions
from bricktwin.plans.plan import read_plan
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.twin.models.mjcf import overview_of
from bricktwin.twin.scene import OPEN_FLOOR, Goal

TASK = get_task("RunAway-v0")


class Robot(BricksEnv):
    """A robot whose watcher is told of a connection."""

    robots = 1
    batch_size = torch.Size()

    def __init__(self, connection: Any = None, **metrics: float) -> None:
        self.connection = connection
        self.metrics = metrics

    def watch(self, watcher: Callable[[Any], None]) -> Callable[[], None]:
        if self.connection is not None:
            watcher(self.connection)
        return lambda: None

    def walk_metrics(self) -> dict[str, float]:
        return self.metrics


def connection(**changes: Any) -> Any:
    statistics = SimpleNamespace(
        round_trip_p50_s=0.0456,
        round_trip_p99_s=0.123,
        age_p50_s=0.0784,
        resends=3,
        crc_errors=2,
    )
    link = SimpleNamespace(statistics=statistics, state=SimpleNamespace(value="open"))
    return SimpleNamespace(**{"link": link, "twin": None, **changes})


# ---------------------------------------------------------------- a real robot


def test_real_robot_is_drawn_as_its_sensors_say(monkeypatch: pytest.MonkeyPatch) -> None:
    page = LivePage("RunAway-v0", task=TASK)
    drawn: list[tuple[Any, ...]] = []
    monkeypatch.setattr(page.view, "show_sensed", lambda *about: drawn.append(about))
    page.show_outcome([1.0, 2.0, 3.0, 4.0, 500.0], 0.0, 0.0)
    assert drawn == [], "nothing is known of a robot before it is connected"
    page.attach(Robot(connection()))  # type: ignore[arg-type]
    page.show_outcome([1.0, 2.0, 3.0, 4.0, 500.0], 0.0, 0.0)
    assert drawn == [(TASK.robot, TASK.scene, {"left": 1.0, "right": 2.0}, (3.0, 4.0))]


def test_robot_that_reports_no_tilt_is_drawn_upright(monkeypatch: pytest.MonkeyPatch) -> None:
    task = get_task("RoboArm-v0")
    page = LivePage("RoboArm-v0", task=task)
    drawn: list[tuple[Any, ...]] = []
    monkeypatch.setattr(page.view, "show_sensed", lambda *about: drawn.append(about))
    page.attach(Robot(connection()))  # type: ignore[arg-type]
    values = [float(number) for number in range(len(task.entries))]
    page.show_outcome(values, 0.0, 0.0)
    ((_, _, angles, tilt),) = drawn
    assert angles == {"rotation": 0.0, "low": 1.0, "high": 2.0, "grab": 3.0}
    assert tilt == (0.0, 0.0)


@pytest.mark.parametrize(
    ("twin", "is_real"),
    [
        (None, True),
        (SimpleNamespace(is_realtime=True), True),
        (SimpleNamespace(is_realtime=False), False),
    ],
)
def test_time_of_a_robot_that_is_real_is_its_own(
    monkeypatch: pytest.MonkeyPatch, twin: Any, is_real: bool
) -> None:
    page = LivePage("RunAway-v0", task=TASK, speed="10x")
    shown: list[Any] = []
    monkeypatch.setattr(page.view, "show", shown.append)
    robot = Robot(connection(twin=twin))
    page.attach(robot)  # type: ignore[arg-type]
    assert shown == [robot.connection]
    assert page._speed_factor == (0.0 if is_real else 10.0)
    assert ("pull" in page.board.status[1]["controls"]) is not is_real


def sensed(view: RobotView, goal: Goal | None = None) -> int:
    """Number of poses that were shown of a real robot."""
    before = view._board.poses[0]
    view.goal = goal
    view.show_sensed(TWO_WHEELER, OPEN_FLOOR, {"left": 1.0}, (0.0, 0.0))
    return view._board.poses[0] - before


def test_sensed_poses_are_drawn_at_their_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(robot_view.time, "monotonic", lambda: now_s[0])
    view = RobotView(Board(), threading.Event(), lambda: 1.0)
    mirror = SimpleNamespace(drawing=None, poses=None, body=SimpleNamespace(data=None))
    monkeypatch.setattr(view, "_mirror", lambda _robot, _scene: mirror)
    counts = []
    for now_s[0] in (100.0, 100.03, 100.05, 100.08, 100.1):
        counts.append(sensed(view))
    # The first one shows the drawing too.
    assert counts == [2, 0, 1, 0, 1]


def test_goal_on_the_floor_is_not_drawn_beside_a_real_robot(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where that robot stands is unknown."""
    asked: list[Any] = []
    mirror = SimpleNamespace(
        drawing=None,
        poses=lambda _qpos, goal=None: asked.append(goal),
        body=SimpleNamespace(data=SimpleNamespace(qpos=None)),
    )
    monkeypatch.setattr(robot_view, "sensed_qpos", lambda *_: None)
    monkeypatch.setattr(robot_view, "VIEW_PERIOD_S", 0.0)
    view = RobotView(Board(), threading.Event(), lambda: 1.0)
    monkeypatch.setattr(view, "_mirror", lambda _robot, _scene: mirror)
    of_joints = Goal({"left": 5.0})
    for goal in (None, of_joints, Goal({}, (1.0, 2.0), 3.0)):
        sensed(view, goal)
        poses = view._board.poses[1]
        assert callable(poses)
        poses()
    assert asked == [None, of_joints, None]


def test_robot_that_cannot_be_drawn_is_tried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    tries: list[int] = []

    def fail(_robot: Any, _scene: Any) -> Any:
        tries.append(1)
        raise TwinError("its wheels are too small")

    view = RobotView(Board(), threading.Event(), lambda: 1.0)
    monkeypatch.setattr(view, "_mirror", fail)
    monkeypatch.setattr(robot_view, "VIEW_PERIOD_S", 0.0)
    for _ in range(3):
        sensed(view)
    assert tries == [1]
    said = view._board.status[1]["no_scene"]
    assert said == "This robot cannot be drawn: its wheels are too small."


def test_link_and_battery_of_a_robot_are_told_in_words() -> None:
    board = Board()
    view = RobotView(board, threading.Event(), lambda: 1.0)
    view.show_link()
    assert "link" not in board.status[1]
    view.connection = connection()
    view.show_link()
    facts = {
        "link": "open",
        "round trip": "46 ms (99 %: 123 ms)",
        "observation age": "78 ms",
        "sent again": "3",
        "damaged": "2",
    }
    assert board.status[1]["link"] == facts
    twin = SimpleNamespace(body=SimpleNamespace(battery_mv=7456))
    view.connection = connection(twin=twin)
    view.show_link()
    assert board.status[1]["link"] == {**facts, "battery": "7.46 V"}


# ---------------------------------------------------------------- the view


def test_a_scene_with_a_goal_on_the_floor_is_seen_as_a_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[Any] = []
    monkeypatch.setattr(robot_view, "MujocoBody", lambda *about: about)
    monkeypatch.setattr(robot_view, "Mirror", lambda body, view: made.append((body, view)) or view)
    scene = get_task("Park-v0").scene
    view = RobotView(Board(), threading.Event(), lambda: 1.0)
    view.goal = Goal({"left": 1.0})
    view._mirror(WALKER, OPEN_FLOOR)
    view.goal = Goal({}, (0.0, 0.0), 0.0)
    view._mirror(TWO_WHEELER, scene)
    view._mirror(TWO_WHEELER, scene)
    (body, of_joints), (_, of_place) = made
    assert body[:2] == (WALKER, OPEN_FLOOR) and of_joints is None
    target, distance_m = overview_of(scene)
    assert of_place.target == target
    assert of_place.distance_m == pytest.approx(0.85 * distance_m)
    assert of_place.ratio == 1.3


def machine_of(robot: Any) -> tuple[Any, Any]:
    """A machine, and the mirror of its robot, which note what they are asked for."""
    from bricktwin.twin.make_body import make_body

    body = make_body(robot)
    mirror = SimpleNamespace(
        drawing=None,
        numbers=[4, 2],
        body=SimpleNamespace(data=SimpleNamespace(qpos="mirrored")),
        poses=lambda *about: about,
    )
    return SimpleNamespace(body=body, panel="panel", pace=None, alarm_ms=None), mirror


def test_virtual_robot_is_shown_as_it_was_when_its_poses_were_copied(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = [100.0]
    panels = iter(range(9))
    monkeypatch.setattr(robot_view.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(robot_view, "panel_of", lambda panel: (panel, next(panels)))
    board = Board()
    view = RobotView(board, threading.Event(), lambda: 0.0)
    machine, mirror = machine_of(ROBO_ARM)
    view.show_machine(machine, mirror=mirror)
    assert board.drawing[0] == 1
    poses = board.poses[1]
    assert callable(poses)
    machine.body.data.qpos[:] = 7.0
    view.goal = Goal({"low": 1.0})
    qpos, goal, moved_m = poses()  # type: ignore[misc]
    assert not (qpos == 7.0).any() and goal is view.goal and moved_m.shape[-1:] == (3,)
    hubs = [board.status[1]["hub"]]
    # Numbers are told five times a second, and poses 25 times.
    for now_s[0] in (100.1, 100.15, 100.21, 100.3, 100.42):
        machine.pace.keep(0.0)
        hubs.append(board.status[1]["hub"])
    assert [number for _, number in hubs] == [0, 0, 0, 1, 1, 2]
    assert board.poses[0] == 2 + 5, "with that of the drawing"


def test_robot_without_a_model_shows_its_hub_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_view, "panel_of", lambda panel: panel)
    board = Board()
    machine, _ = machine_of(Described("bench", HubKind.PRIME, (Motor("left", "A"),)))
    RobotView(board, threading.Event(), lambda: 0.0).show_machine(machine)
    status = board.status[1]
    assert status["no_scene"] == "This robot has no model to draw; its numbers are below."
    assert status["hub"] == "panel" and board.poses == board.drawing == (0, None)
    machine.pace.keep(0.0)


def test_hand_at_the_page_pulls_in_each_control_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    view = RobotView(Board(), threading.Event(), lambda: 0.0)
    machine, mirror = machine_of(ROBO_ARM)
    monkeypatch.setattr(robot_view, "panel_of", lambda panel: panel)
    view.show_machine(machine, mirror=mirror)
    felt: list[Any] = []
    monkeypatch.setattr(view.hand, "act", lambda body, numbers: felt.append((body, numbers)))
    for _ in range(2):
        machine.pace.keep(0.0)
    assert felt == [(machine.body, [4, 2])] * 2


def test_another_hub_of_the_world_keeps_the_view_up_to_date(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(robot_view.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(robot_view, "panel_of", lambda panel: panel)
    halted, halts = threading.Event(), list[str]()
    board = Board()
    view = RobotView(board, halted, lambda: 0.0)
    machine, mirror = machine_of(ROBO_ARM)
    other: Any = SimpleNamespace(pace=None, alarm_ms=5)
    view.show_machine(machine, mirror=mirror)
    view.accompany(other, lambda: halts.append("halted"))
    before = board.poses[0]
    now_s[0] = 101.0
    other.pace.keep(0.0)
    assert board.poses[0] == before + 1 and halts == []
    halted.set()
    other.pace.keep(1.0)
    assert halts == ["halted"] and other.alarm_ms == 5


def test_arena_is_seen_from_above_with_its_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    monkeypatch.setattr(arena, "Mirror", lambda body, view: made.append((body, view)) or "mirror")
    world = SimpleNamespace(bodies=["first", "second"])
    monkeypatch.setattr(arena, "ArenaWorld", lambda _arena: world)
    for task, half_m in ((TAG, 0.8), (CARRY, 0.7)):
        page = ArenaPage(task)
        shown: list[Any] = []
        monkeypatch.setattr(
            page.view,
            "show_machine",
            lambda *about, shown=shown, **named: shown.append((about, named)),
        )
        env: Any = Robot()
        env.robots = 2
        env.world = SimpleNamespace(bodies=["a body", "another"])
        env.hub = lambda name: SimpleNamespace(machine=f"machine of {name}")
        page.attach(env)
        assert page.board.status[1]["no_scene"] == ""
        assert not page._is_paced_here, "the hubs keep the pace"
        machine = f"machine of {task.robots[0]}"
        assert shown == [((machine,), {"body": "a body", "mirror": "mirror"})]
        body, view = made[-1]
        assert body == "first" and view.target == (0.0, 0.0, 0.0)
        assert view.distance_m == pytest.approx(2.0 * half_m + 0.8)
        assert (view.yaw_deg, view.pitch_deg, view.ratio) == (-90.0, 48.0, 1.45)
        status = page.board.status[1]
        assert status["title"] == task.id and status["speed"] == "1x"
        assert status["goal"] == " ".join(task.doc.partition("\n\n")[0].split())


def test_driven_robots_of_an_arena_get_the_actions_of_their_drivers() -> None:
    page = ArenaPage(GATE)
    state: Any = TensorDict({"agents": {"action": torch.zeros(2, 4)}}, [])
    state["agents", "action"] += torch.tensor([0.1, 0.2, 0.3, 0.4])
    driver = page.drivers["driver"]
    assert [command.name for command in driver.commands] == ["left", "right"]
    driver.in_charge = True
    assert driver.push([1.0, -0.5])
    steered = page.steered(state)["agents", "action"].tolist()
    # What it tells remains its policy's.
    assert steered[1] == pytest.approx([1.0, -0.5, 0.3, 0.4])
    assert steered[0] == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_pages_are_served_where_their_options_say() -> None:
    options = PageOptions(page_port=4321)
    plan = read_plan(Path(plans.__path__[0]) / "two_wheeler.ldr")
    pages = (
        LivePage("a run", options=options),
        ArenaPage(TAG, options=options),
        ProgramPage("main.py", options),
        PlanView(plan, options),
    )
    assert [page._options for page in pages] == [options] * 4
    for page in pages:
        assert page.board.status[1]["title"]
    assert ArenaPage(TAG, "seed 1").board.status[1]["subtitle"] == "seed 1"


def test_arena_is_played_for_as_long_as_is_asked_and_without_chance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def play(*about: Any, **named: Any) -> list[float]:
        asked.append((about[:2], named, torch.is_grad_enabled(), exploration_type()))
        return [1.5]

    monkeypatch.setattr(arena, "play_endlessly", play)
    stop = threading.Event()
    env: Any = SimpleNamespace(task=TAG)
    page = ArenaPage(TAG)
    assert arena.play_arena(env, page, lambda state: state, episodes=3, stop=stop) == [1.5]  # type: ignore[arg-type]
    named = {"episodes": 3, "stop": stop}
    assert asked == [((env, page), named, False, ExplorationType.DETERMINISTIC)]


def test_curves_of_episodes_are_kept_longer_than_those_of_steps() -> None:
    page = LivePage("RunAway-v0", task=TASK)
    kept = {name: series.max_rows for name, series in page.board.series.items()}
    assert kept == {"return": 4000, "reward": 400, "channels": 400}
    assert page.board.series["return"].names == ("return of each episode",)
    assert page.board.series["reward"].names == ("reward of each step",)


# ---------------------------------------------------------------- what is shown of steps


def test_way_of_a_robot_is_told_in_metres(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(live.time, "monotonic", lambda: now_s[0])
    page = LivePage("RunAway-v0", task=TASK)
    page.attach(Robot())  # type: ignore[arg-type]
    page.show_outcome([0.0] * 5, 0.0, 0.0)
    assert "distance" not in page.board.status[1]["facts"]
    page.attach(Robot(forward_m=1.2345))  # type: ignore[arg-type]
    now_s[0] += 0.3
    page.show_outcome([0.0] * 5, 0.0, 0.0)
    assert page.board.status[1]["facts"]["distance"] == "1.23 m"


def test_channels_are_named_with_their_units() -> None:
    page = LivePage("Spinning-v0", task=get_task("Spinning-v0"))
    assert page.board.series["channels"].names == (
        "left_angle (deg)",
        "right_angle (deg)",
        "pitch (deg)",
        "roll (deg)",
        "yaw_rate (deg/s)",
        "direction",
    )


def test_image_of_a_camera_comes_in_whole_numbers() -> None:
    page = LivePage("RunAway-v0", task=TASK)
    page.show_outcome([0.0] * 5, 0.0, 0.0, np.full((2, 2, 3), 9.0))
    image = page.board.image[1]
    assert image is not None and image.dtype == np.uint8 and (image == 9).all()


def test_messages_of_the_board_have_headers_of_four_and_eight_bytes() -> None:
    board = Board()
    board.show_poses(np.zeros((1, 7), np.float32))
    board.show_image(np.zeros((300, 2, 3), np.uint8))
    board.new_series("reward", ("reward",)).add((0.123456789,))
    poses, image, _, series = BoardReader(board).changes(numbers=True)
    assert isinstance(poses, bytes) and isinstance(image, bytes) and isinstance(series, dict)
    assert poses == bytes((POSES, 0, 0, 0)) + bytes(28)
    assert image[:8] == bytes((IMAGE, 0, 300 - 256, 1, 2, 0, 0, 0)) and len(image) == 8 + 1800
    assert series["series"]["reward"]["rows"] == [[0.1235]], "four digits are enough for a curve"


def test_columns_of_a_series_are_told_once_even_before_its_first_row() -> None:
    board = Board()
    series = board.new_series("return", ("return of each episode",), max_rows=3)
    reader = BoardReader(board)
    told = []
    for value in (None, 1.0, 2.0):
        if value is not None:
            series.add((value,))
        (message,) = [one for one in reader.changes(numbers=True) if "series" in one]
        told.append(message["series"]["return"])  # type: ignore[call-overload, index]
    names = {"names": ("return of each episode",), "kept": 3}
    assert told == [
        {"first": 0, "rows": [], **names},
        {"first": 0, "rows": [[1.0]]},
        {"first": 1, "rows": [[2.0]]},
    ]


class Halted(threading.Event):
    """An event on which nobody waits, but notes for how long."""

    def __init__(self, clock_s: list[float]) -> None:
        super().__init__()
        self.waits_s: list[float] = []
        self._clock_s = clock_s

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.waits_s.append(timeout)
        self._clock_s[0] += timeout
        return False


@pytest.mark.parametrize(
    ("speed", "waits_s"), [("1x", [0.1, 0.1, 0.06]), ("10x", [0.01, 0.01, 0.0]), ("max", [])]
)
def test_simulation_without_a_robot_makes_ten_steps_a_second_at_speed_1(
    monkeypatch: pytest.MonkeyPatch, speed: str, waits_s: list[float]
) -> None:
    clock_s = [100.0]
    monkeypatch.setattr(live.time, "perf_counter", lambda: clock_s[0])
    page = LivePage("WalkerSim-v0", speed=speed)
    page._halted = halted = Halted(clock_s)
    simulation = Robot()
    simulation.robots = 0
    page.attach(simulation)  # type: ignore[arg-type]
    # The first step begins now; what was slow is made up for by one step at most.
    page._last_step_s = clock_s[0]
    page.hold()
    page.hold()
    clock_s[0] += 0.04
    page.hold()
    assert halted.waits_s == pytest.approx(waits_s)
    clock_s[0] += 5.0
    halted.waits_s.clear()
    for _ in range(3):
        page.hold()
    if speed == "1x":
        assert halted.waits_s == pytest.approx([0.0, 0.0, 0.1])


# ---------------------------------------------------------------- hands


def test_pushes_are_rounded_and_last_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(live.time, "monotonic", lambda: now_s[0])
    driver = PageDriver((Entry("speed", -1.0, 1.0, "mm/s"),), in_charge=True)
    assert driver.push([0.12345])
    assert driver.pushes == [0.123]
    now_s[0] += PUSH_TIMEOUT_S
    assert driver.pushes == [0.123]
    now_s[0] += 0.01
    assert driver.pushes == [0.0]
    assert driver.push([1])
    assert driver(torch.zeros(1)).tolist() == [1.0]  # type: ignore[union-attr]
    assert driver.described()["stick"] == [[0.0, 1.0]]


class WorldsHand:
    """The hand in a world, which notes what it does."""

    def __init__(self, engine: Any) -> None:
        self.done: list[Any] = [engine]

    def pull(self, *about: Any) -> None:
        self.done.append(about)

    def let_go(self) -> None:
        self.done.append("let go")


def test_hand_pulls_the_body_that_was_drawn_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(hands.time, "monotonic", lambda: now_s[0])
    made: list[WorldsHand] = []
    monkeypatch.setattr(
        hands, "TwinHand", lambda engine: made.append(WorldsHand(engine)) or made[-1]
    )
    hand = Hand()
    one: Any = SimpleNamespace(engine="one")
    two: Any = SimpleNamespace(engine="two")
    hand.pull([1, 0.25, -0.5])
    for now_s[0] in (100.0, 101.0, 101.01):
        hand.act(one, [7, 8])
    # What has ended begins with the next message only.
    now_s[0] = 100.5
    hand.act(one, [7, 8])
    assert made[0].done == ["one", (8, 0.25, -0.5), (8, 0.25, -0.5), "let go", "let go"]
    for number, does in ((0, (7, 1.0, 2.0)), (2, "let go"), (-1, "let go")):
        hand.pull([number, 1, 2])
        hand.act(one, [7, 8])
        assert made[0].done[-1] == does
    hand.pull([0, 1, 2])
    hand.act(two, [7, 8])
    assert len(made) == 2 and made[1].done == ["two", (7, 1.0, 2.0)]
