"""What a name of a command stands for: an environment, a robot of an arena, a robot, a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bricksrl.envs.arenas import get_arena_task
from bricksrl.envs.registry import get_task
from bricksrl.errors import UnknownNameError
from bricksrl.target import find
from bricktwin import robots
from bricktwin.robots import plans

PLANS = Path(plans.__path__[0])


def test_environment_is_its_robot_in_its_scene() -> None:
    task = get_task("RunAway-v0")
    target = find("RunAway-v0")
    assert (target.name, target.robot, target.scene) == ("RunAway-v0", task.robot, task.scene)
    assert target.interface == task.interface and target.note == ""
    body: Any = target.make_body(seed=0)
    assert body.robot == task.robot


def test_arena_is_its_first_robot_unless_one_is_named() -> None:
    task = get_arena_task("Tag-v0")
    first, second = task.robots
    assert (first, second) == ("catcher", "runner")
    for name, contestant, note in (
        (
            "Tag-v0",
            first,
            "Tag-v0 has several robots: this is catcher; there are also Tag-v0:runner",
        ),
        ("Tag-v0:catcher", first, ""),
        ("Tag-v0:runner", second, ""),
    ):
        target = find(name)
        index = task.robots.index(contestant)
        assert (target.name, target.note) == (f"Tag-v0:{contestant}", note)
        assert target.robot == task.arena.robots[index].robot
        assert target.interface == task.interfaces[index]
        assert target.scene is None and target.share_world is not None


def test_robot_and_plan_are_those_of_the_twin() -> None:
    assert find("walker").robot == robots.ROBOTS["walker"]
    plan = find(str(PLANS / "two_wheeler.ldr"))
    assert plan.robot.name == "two_wheeler"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Tag-v0:xyz", "Tag-v0 has no robot 'xyz'; it has catcher, runner"),
        ("Tag-v0:runer", "Tag-v0 has no robot 'runer' (did you mean 'runner'?); it has catcher, "),
        ("RunAwya-v0", f"; or a robot: {', '.join(robots.ROBOTS)}"),
    ],
)
def test_unknown_names_are_told_with_what_there_is(name: str, says: str) -> None:
    with pytest.raises(UnknownNameError) as raised:
        find(name)
    assert says in str(raised.value)


ROBOT = "from bricktwin.robots import WALKER as ROBOT\n"
TASK = "from bricksrl.envs.tasks.run_away import RUN_AWAY as TASK\n"


def test_file_is_its_task_or_else_its_robot(tmp_path: Path) -> None:
    both = tmp_path / "both.py"
    both.write_text(ROBOT + TASK)
    robot = tmp_path / "robot.py"
    robot.write_text(ROBOT)
    assert find(str(both)).interface == get_task("RunAway-v0").interface
    assert find(f"{both}:ROBOT").robot == robots.ROBOTS["walker"]
    assert find(str(robot)).robot == robots.ROBOTS["walker"]
