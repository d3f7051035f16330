"""Edges of lines as the color sensors of a virtual hub read them."""

from __future__ import annotations

import pytest

from brickhub.pytest_plugin import PybricksHub
from brickhub.robot import HubKind, PoweredUpSensor, Robot, SensorKind
from brickhub.robot.line_edge import LINE_EDGES, LineEdge, edge_of

READ = """
from pybricks.hubs import {hub}
from pybricks.parameters import Port
from pybricks.{devices} import {sensor}
from pybricks.tools import wait
hub = {hub}()
light = {sensor}(Port.{port})
for _ in range(2):
    print(light.reflection())
    wait(3000)
"""


@pytest.mark.parametrize("kind", LINE_EDGES)
def test_sensor_reads_line_and_floor(pybricks_hub: PybricksHub, kind: SensorKind) -> None:
    """A line that reflects 8 % of the light, and then a floor that reflects 82 %."""
    is_ev3 = kind.model.module == "ev3devices"
    program = READ.format(
        hub="EV3Brick" if is_ev3 else "PrimeHub",
        devices=kind.model.module,
        sensor=kind.model.class_name,
        port="S1" if is_ev3 else "A",
    )
    port = "1" if is_ev3 else "A"
    read = {}
    for name, percent in (("line", 8), ("floor", 82)):
        run = pybricks_hub.run(program, readings=[f"{port}={percent}%"])
        assert run.exit_code == 0, run.errors
        read[name] = float(run.output.split()[-1])
    edge = LINE_EDGES[kind]
    assert (edge.line_pct, edge.floor_pct) == (read["line"], read["floor"])


def test_edge_is_between_line_and_floor() -> None:
    edge = LineEdge(10.0, 60.0)
    assert edge.edge_pct == 35.0
    # Two percent before bare line or floor, by which readings differ there.
    assert edge.bare_pct == 23.0


def test_edge_is_that_of_the_robots_sensor() -> None:
    light = PoweredUpSensor("light", "A", SensorKind.COLOR_DISTANCE)
    eye = PoweredUpSensor("eye", "B", SensorKind.COLOR)
    robot = Robot("r", HubKind.PRIME, sensors=(light, eye))
    assert edge_of(robot) is LINE_EDGES[SensorKind.COLOR_DISTANCE]
    assert edge_of(robot, "eye") is LINE_EDGES[SensorKind.COLOR]
