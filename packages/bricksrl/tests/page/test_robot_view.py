"""A robot on a board: the ghost at its goal, and a real robot from its sensors."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from brickhub.robot import DriveBase, HubKind, Motor, Robot
from brickhub.virtual.machine import Machine
from bricksrl.envs.registry import get_task
from bricksrl.page import robot_view
from bricksrl.page.board import Board
from bricksrl.page.robot_view import RobotView, SteeredPace
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER, plans
from bricktwin.robots.planned import robot_of_plan
from bricktwin.twin.make_body import make_body
from bricktwin.twin.scene import OPEN_FLOOR
from bricktwin.twin.sensed_pose import pose_at, sensed_qpos
from bricktwin.view.mirror import Mirror


@pytest.mark.parametrize("env_id", ["RoboArm-v0", "Park-v0", "Walker-v1"])
def test_goal_is_drawn_as_a_ghost_of_the_robot(env_id: str) -> None:
    """One that has reached its goal is where its ghost is."""
    task = get_task(env_id)
    observation = [0.5 * (entry.low + entry.high) for entry in task.entries]
    goal = task.goal(observation)
    assert (goal is None) == (env_id == "Walker-v1")
    if goal is None:
        return
    mirror, body = (
        Mirror(make_body(task.robot, scene=task.scene)),
        make_body(task.robot, scene=task.scene),
    )
    pose_at(body, goal)
    names = [one.name for one in mirror.drawing.bodies]
    seen = dict(zip(names, mirror.poses(body.data.qpos, goal), strict=True))
    ghosts = [name for name in names if name.startswith("goal ")]
    assert len(ghosts) > 1 and {
        s.colour[3] for one in mirror.drawing.bodies if one.name in ghosts for s in one.shapes
    } == {0.45}
    for name in ghosts:
        assert np.allclose(seen[name], seen[name.removeprefix("goal ")], atol=1e-5)
    away = mirror.poses(make_body(task.robot, scene=task.scene).data.qpos, goal)
    assert np.array_equal(away[-1], seen[names[-1]]), "it stays while the robot moves"


@pytest.mark.parametrize("robot", [WALKER, TWO_WHEELER, ROBO_ARM])
def test_sensed_pose_is_drawn_on_the_floor(robot) -> None:
    mirror = Mirror(make_body(robot))
    angles = {motor.name: 30.0 for motor in robot.motors}
    lowest = min(mirror.poses(sensed_qpos(mirror.body, angles, (0.0, 0.0)))[:, 2])
    assert -0.01 < lowest < 0.2


MOTORS = (Motor("left", "A"), Motor("right", "B"))


def shown(robot: Robot) -> Board:
    """A board with a real robot's pose."""
    board = Board()
    RobotView(board, threading.Event(), lambda: 1.0).show_sensed(
        robot, OPEN_FLOOR, {"left": 10.0, "right": 20.0}, (0.0, 0.0)
    )
    return board


@pytest.mark.parametrize(
    "robot",
    [
        robot_of_plan(Path(plans.__path__[0]) / "two_wheeler.ldr"),
        Robot("driving", HubKind.PRIME, MOTORS, drive_base=DriveBase("left", "right", 56, 130)),
    ],
)
def test_real_robot_is_drawn_from_plan_or_drive_base(robot: Robot) -> None:
    board = shown(robot)
    assert "no_scene" not in board.status[1]
    assert callable(board.poses[1]) and np.isfinite(board.poses[1]()[0]).all()


@pytest.mark.parametrize(
    ("robot", "says"),
    [
        (Robot("bench", HubKind.PRIME, MOTORS), "no model to draw"),
        (
            Robot("narrow", HubKind.PRIME, MOTORS, drive_base=DriveBase("left", "right", 8, 130)),
            "leave no room for its motors",
        ),
    ],
)
def test_page_says_why_real_robot_is_not_drawn(robot: Robot, says: str) -> None:
    board = shown(robot)
    assert says in board.status[1]["no_scene"] and board.poses[1] is None


def test_pace_keeps_to_the_speed_and_makes_up_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """At double speed 100 ms of the robot are 50 ms; what was lost to something slow stays lost."""
    now_s, waited_s, speed = [100.0], [], [2.0]

    class Halted(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            assert timeout is not None
            waited_s.append(timeout)
            now_s[0] += timeout
            return False

    monkeypatch.setattr(robot_view.time, "monotonic", lambda: now_s[0])
    halted, machine = Halted(), make_body(TWO_WHEELER)
    pace = SteeredPace(
        Machine(machine), halted, lambda: speed[0], lambda: None, on_loop=lambda: None
    )
    for time_ms in (1000, 1100, 1200):
        pace.keep(time_ms)
    assert waited_s == pytest.approx([0.05, 0.05])
    now_s[0] += 5.0
    waited_s.clear()
    for time_ms in (1300, 1400):
        pace.keep(time_ms)
    assert waited_s == pytest.approx([0.05])
    speed[0] = 0.0
    pace.keep(9000)
    halted.set()
    speed[0] = 1.0
    pace.keep(9100)
    assert len(waited_s) == 1, "as fast as possible, and no wait after a stop"


def test_a_view_is_updated_at_its_rate_and_a_halt_ends_the_wait_of_the_hub(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, updates, loops, halts = [100.0], [], [], []
    monkeypatch.setattr(robot_view.time, "monotonic", lambda: now_s[0])
    halted, machine = threading.Event(), Machine(make_body(TWO_WHEELER))
    paces = [
        SteeredPace(
            machine,
            halted,
            lambda: 0.0,
            lambda: updates.append(now_s[0]),
            on_loop=lambda: loops.append(now_s[0]),
            halt=halt,
        )
        for halt in (None, lambda: halts.append(now_s[0]))
    ]
    period_s = robot_view.VIEW_PERIOD_S
    times_s = [100.0 + share * period_s for share in (0.0, 0.5, 1.01, 1.5, 2.5)]
    for now_s[0] in times_s:
        paces[0].keep(1000)
    assert updates == [times_s[0], times_s[2], times_s[4]] and loops == times_s
    machine.alarm_ms = 5000
    paces[0].keep(1234)
    assert machine.alarm_ms == 5000
    halted.set()
    paces[0].keep(1234.5)
    assert machine.alarm_ms == 1234, "control returns to the host at once"
    paces[1].keep(2000)
    assert halts == [times_s[-1]] and machine.alarm_ms == 1234
    machine.alarm_ms = None
    paces[0].keep(3000)
    assert machine.alarm_ms is None, "nobody waits for it"
