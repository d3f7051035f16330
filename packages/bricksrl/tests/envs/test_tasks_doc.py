"""Tables in task docstrings match the tasks."""

from __future__ import annotations

import pytest
import torch

from bricksrl.envs.registry import get_task, list_envs, simulation_text
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING

TASKS = pytest.mark.parametrize(
    "task", [get_task(env_id) for env_id in list_envs()], ids=lambda task: task.id
)


def table(task: Task, heading: str) -> list[list[str]]:
    """The rows below a heading, without the header."""
    section = task.doc.split(f"## {heading}\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


@TASKS
def test_action_table(task: Task) -> None:
    rows = [
        (int(num), name, *map(float, numbers)) for num, name, *numbers, _ in table(task, "Action")
    ]
    assert rows == [
        (i, c.name, -1.0, 1.0, c.low, c.high) for i, c in enumerate(task.interface.commands)
    ]
    assert [row[-1] for row in table(task, "Action")] == [c.unit for c in task.interface.commands]


@TASKS
def test_observation_table(task: Task) -> None:
    rows = [
        (int(num), name, float(low), float(high), unit)
        for num, name, low, high, unit in table(task, "Observation")
    ]
    assert rows == [(i, e.name, e.low, e.high, e.unit) for i, e in enumerate(task.entries)]


@TASKS
def test_end_table(task: Task) -> None:
    ends = dict(table(task, "End of an episode")[::-1])
    assert ends["truncated"] == f"after {task.max_steps} steps"
    can_terminate = bool(
        task.terminated(torch.tensor([[0.0], [2000.0]]).expand(2, len(task.entries))).any()
    )
    assert ("terminated" in ends) is can_terminate


@TASKS
def test_metrics_and_summary(task: Task) -> None:
    for name in task.metrics(torch.zeros(2, len(task.entries))):
        assert f"`{name}`" in task.doc
    assert task.summary.endswith(".")
    assert task.summary == " ".join(task.doc.partition("\n\n")[0].split())


def test_as_in_the_paper() -> None:
    """Tables of the paper, with our names."""
    assert [(e.low, e.high) for e in RUN_AWAY.entries] == [
        (0, 360),
        (0, 360),
        (-90, 90),
        (-90, 90),
        (0, 2000),
    ]
    assert [(e.low, e.high) for e in SPINNING.entries] == [
        (0, 360),
        (0, 360),
        (-90, 90),
        (-90, 90),
        (-100, 100),
        (0, 1),
    ]
    assert (RUN_AWAY.max_steps, SPINNING.max_steps) == (20, 50)
    assert [getattr(c, "speed_deg_s", None) for c in SPINNING.interface.commands] == [400, 400]


def test_simulations_say_what_they_leave_out() -> None:
    assert simulation_text("Walker-v0") == ""
    text = simulation_text("WalkerSim-v0")
    assert (
        "no hub" in text
        and "deviation of 0.1" in text
        and "pitch, roll, distance are always 0" in text
    )
    assert "0.05" in simulation_text("RoboArmSim-v0") and "firmware" in simulation_text(
        "WalkerSim-v1"
    )
