"""Hub programs on a bench, and unplugged devices."""

from __future__ import annotations

from dataclasses import replace

from brickhub import robot as robots
from brickhub.robot import Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks import modules


class Console:
    """Input that arrives at given simulated times."""

    def __init__(self, machine: Machine, arrivals: dict[int, bytes]) -> None:
        self.machine = machine
        self.arrivals = arrivals
        self.taken = 0
        self.written = b""
        machine.on_alarm = self._set_alarm
        self._set_alarm()

    def _set_alarm(self) -> None:
        """Set the alarm to the next input, to wake a waiting program."""
        self.machine.alarm_ms = min(
            (time_ms for time_ms in self.arrivals if time_ms > self.machine.time_ms), default=None
        )

    def _arrived(self) -> bytes:
        return b"".join(
            data
            for time_ms, data in sorted(self.arrivals.items())
            if time_ms <= self.machine.time_ms
        )

    def available(self) -> int:
        return len(self._arrived()) - self.taken

    def read(self, n: int) -> bytes:
        while self.available() < n:
            self.machine.advance(1)
        self.taken += n
        return self._arrived()[self.taken - n : self.taken]

    def write(self, data: bytes) -> None:
        self.written += data


def output(
    source: str,
    arrivals: dict[int, bytes] | None = None,
    robot: Robot = robots.BENCH,
    body: Body | None = None,
) -> str:
    machine = Machine(body or BenchBody(robot))
    console = Console(machine, arrivals or {})
    execute(source, "main.py", modules(machine, console), console)
    return console.written.decode("latin-1").replace("\r\n", "\n").removesuffix("\n")


def unplug(machine: Machine, port: str) -> None:
    """Pull a motor out of its port."""
    motors = tuple(motor for motor in machine.robot.motors if motor.port != port)
    machine.robot = replace(machine.robot, motors=motors, drive_base=None)
    del machine.servos[port]
