"""Robots and tasks that tests of the other houses describe for themselves."""

from __future__ import annotations

from dataclasses import replace

import described

from bricksrl.envs import get_task
from bricktwin.robots import ROBO_ARM, TWO_WHEELER, WALKER


def test_described_robots_and_interfaces_are_those_of_environments() -> None:
    ours = (TWO_WHEELER, WALKER, ROBO_ARM)
    assert [replace(robot, model=None, mirrored=()) for robot in ours] == [
        described.TWO_WHEELER,
        described.WALKER,
        described.ROBO_ARM,
    ]
    for env_id, (robot, interface) in described.TASKS.items():
        task = get_task(env_id)
        assert (replace(task.robot, model=None, mirrored=()), task.interface) == (
            robot,
            interface,
        ), env_id
