"""Simulated time: waits and dozes."""

from __future__ import annotations

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
