"""Tasks on the EV3 driver: what it reports of them, and that they run on its virtual brick."""

from __future__ import annotations

import pytest
import torch

import bricksrl
from bricksrl.envs.registry import get_task
from bricksrl.envs.tasks.scripted import CONTROLLERS
from bricksrl.errors import DescriptionError
from bricktwin.robots import EV3_DRIVER

TASKS = {
    "LineFollow-v0": ["light_reflection", "yaw_rate"],
    "Park-v0": ["left_angle", "right_angle"],
    "RunAway-v0": ["left_angle", "right_angle", "distance"],
    "Spinning-v0": ["left_angle", "right_angle", "yaw_rate"],
}
LEAST = {"LineFollow-v0": 2.0, "Park-v0": 2.0, "RunAway-v0": 8.0, "Spinning-v0": 1000.0}
"""Returns of ten steps by hand."""


@pytest.mark.parametrize("env_id", TASKS)
def test_it_reports_what_its_sensors_measure(env_id: str) -> None:
    task = get_task(env_id, robot="ev3-driver")
    assert task.robot is EV3_DRIVER
    assert [channel.name for channel in task.interface.channels] == TASKS[env_id]


def test_range_of_its_ultrasonic_sensor() -> None:
    *_, distance = get_task("RunAway-v0", robot="ev3-driver").interface.channels
    assert (distance.low, distance.high) == (0.0, 2550.0)


@pytest.mark.parametrize(
    "env_id",
    [
        "RunAway-v0",
        "Spinning-v0",
        pytest.param("LineFollow-v0", marks=pytest.mark.slow),
        pytest.param("Park-v0", marks=pytest.mark.slow),
    ],
)
def test_hand_written_controllers_do_the_tasks(env_id: str) -> None:
    env = bricksrl.make(env_id, seed=0, robot="ev3-driver")
    state = env.reset()
    total = 0.0
    for _ in range(10):
        arrays = {"observation": state["observation"].double().numpy()}
        state["action"] = torch.as_tensor(CONTROLLERS[env_id](arrays), dtype=torch.float32)
        state = env.step(state)["next"]
        total += float(state["reward"])
    env.close()
    assert total > LEAST[env_id]


def test_other_robots_are_refused() -> None:
    with pytest.raises(DescriptionError, match="choose two-wheeler or ev3-driver"):
        get_task("RunAway-v0", robot="scout")
