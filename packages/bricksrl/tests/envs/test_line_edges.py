"""Edges of a line: what the kinds of color sensors read of it, and the task on each."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
import torch

from brickhub.robot import HubKind, Sense, SensorKind
from brickhub.robot.line_edge import LINE_EDGES
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.run import run_file
from bricksrl.envs.registry import get_task
from bricksrl.envs.tasks.line_follow import LINE_FOLLOW
from bricksrl.envs.tasks.scripted import controller_of
from bricktwin.robots.planned import plan_file

READ = """
from pybricks.{module} import {name}
from pybricks.parameters import Port
print({name}(Port.{port}).reflection())
"""
LIGHT_PCT = {"line": 8.0, "floor": 82.0}
"""Light that line and floor reflect."""


@pytest.mark.parametrize("kind", LINE_EDGES)
def test_readings_are_those_of_the_virtual_sensor(kind: SensorKind, tmp_path: Path) -> None:
    model = kind.model
    is_ev3 = model.module == "ev3devices"
    hub = HubKind.EV3 if is_ev3 else HubKind.PRIME
    letter, port = ("1", "S1") if is_ev3 else ("A", "A")
    program = tmp_path / "main.py"
    program.write_text(READ.format(module=model.module, name=model.class_name, port=port))
    read = {}
    for name, light_pct in LIGHT_PCT.items():
        bench = FittedBench(hub, devices={letter: kind})
        bench.set_reading(letter, Sense.SURFACE, light_pct)
        out = io.BytesIO()
        assert run_file(program, bench, stdout=out) == 0
        read[name] = float(out.getvalue())
    assert read == {"line": LINE_EDGES[kind].line_pct, "floor": LINE_EDGES[kind].floor_pct}


def test_ev3_gets_its_reward_on_the_edge_that_its_sensor_sees() -> None:
    task = get_task("LineFollow-v0", robot="ev3-driver")
    line, edge, floor = (torch.tensor([read, 0.0]) for read in (8.0, 45.0, 82.0))
    straight, right = torch.zeros(2), torch.tensor([0.0, 1.0])
    assert task.reward(edge, straight, edge).item() == 0.75
    assert task.reward(edge, right, floor).item() == -0.25
    assert task.reward(edge, right, line).item() == -0.75
    assert task.success(edge.expand(60, 2)) and not task.success(line.expand(60, 2))
    assert LINE_FOLLOW.reward(edge, straight, edge).item() < 0.6, "that is beside SPIKE's edge"


@pytest.mark.slow
def test_drawn_ev3_follows_the_edge_that_its_sensor_sees() -> None:
    task = get_task(f"{plan_file('bricktwin.robots.plans:ev3_driver.ldr')}:line")
    edge = torch.tensor([45.0, 0.0])
    assert task.reward(edge, torch.zeros(2), edge).item() == 0.75


def test_hand_written_controller_steers_by_the_robots_edge() -> None:
    on_edge = {"observation": torch.tensor([45.0, 0.0]).numpy()}
    ev3 = controller_of("LineFollow-v0", get_task("LineFollow-v0", robot="ev3-driver"))
    scout = controller_of("LineFollow-v0", LINE_FOLLOW)
    assert ev3(on_edge)[1] == 0.0
    assert scout(on_edge)[1] > 0.0, "it takes that for floor"
