"""Simulated time: waits and dozes."""

from __future__ import annotations

import pytest
from hub_programs import output

from brickhub.robot import BENCH
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.machine import Machine


def machine_with_alarm(alarm_ms: int) -> tuple[Machine, list[int]]:
    machine = Machine(BenchBody(BENCH))
    rung: list[int] = []

    def ring() -> None:
        rung.append(machine.time_ms)
        machine.alarm_ms = None

    machine.alarm_ms, machine.on_alarm = alarm_ms, ring
    return machine, rung


def test_wait_continues_after_alarm() -> None:
    machine, rung = machine_with_alarm(7)
    machine.advance(12)
    assert (machine.time_ms, rung) == (12, [7])


def test_doze_ends_at_alarm() -> None:
    machine, rung = machine_with_alarm(7)
    assert machine.advance_to_alarm(12) == 7
    assert (machine.time_ms, rung) == (7, [7])
    assert machine.advance_to_alarm(12) == 12
    assert (machine.time_ms, rung) == (19, [7])


def test_doze_runs_control_loop() -> None:
    angles = []
    for dozes in (False, True):
        machine = Machine(BenchBody(BENCH))
        servo = machine.servos["A"]
        servo.setup(BENCH.motors[0].direction, 1000, reset_angle=True, profile_deg=0)
        servo.run(500)
        for _ in range(40):
            if dozes:
                machine.advance_to_alarm(6)
            else:
                for _ in range(6):
                    machine.advance(1)
        angles.append(servo.position())
    assert angles[0] == angles[1] > 50_000


def test_products_of_floats_take_time() -> None:
    """Which is what a network on a hub computes; a loop of integers is charged by its turns."""
    head = "from pybricks.tools import StopWatch\nwatch = StopWatch()\n"
    loop = "for _ in range(2000):\n    product = factor * factor\nprint(watch.time())\n"
    times_ms = [int(output(f"{head}factor = {factor}\n{loop}")) for factor in ("3", "3.0")]
    product_ms = 2000 * BENCH.hub.model.product_us / 1000
    assert times_ms[1] - times_ms[0] == pytest.approx(product_ms, rel=0.1)
