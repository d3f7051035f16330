"""Several hubs in one room: each runs a program of its own, all in one simulated time.

Each program is a greenlet, so that runs are reproducible. Time goes on in steps of the firmware's
control loop: in a step the hubs run one after the other, in the order of their programs; what one
of them broadcasts is heard from the next step on. A hub that waits does not stop another.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, TextIO, cast

from greenlet import getcurrent, greenlet

from brickhub.errors import TwinError
from brickhub.hub.program.marked import Marked, names_of
from brickhub.virtual.air import DISTANCE_M, Air
from brickhub.virtual.body import Body
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine
from brickhub.virtual.micropython.exceptions import HostStop
from brickhub.virtual.run import Operation, run_file


@dataclass(frozen=True)
class HubProgramFile:
    """A program, and the hub that runs it.

    Attributes:
        path: the program; imports from its folder work.
        body: the robot; ``None`` for a bench with the hub and devices that the program uses.
        operation: buttons, readings and pace.
        stdout, stderr: for what this program alone prints, without marks; ``None`` for those of the
            room.
    """

    path: Path
    body: Body | None = None
    operation: Operation = field(default_factory=Operation)
    stdout: BinaryIO | None = None
    stderr: TextIO | None = None


def on_benches_m(_one: int, _other: int) -> float:
    """Distance of two hubs that have a bench each."""
    return DISTANCE_M


class Room:
    """A room with several hubs.

    Args:
        programs: of the hubs.
        stdout: for what the programs print; each line begins with the name of its program.
        stderr: for tracebacks and stop messages, likewise.
        time_limit_s: simulated seconds until the programs are stopped.
        distance_m: distance of two hubs, by number.
        seed: seed of the radio's delays and losses.

    Attributes:
        machines: of the hubs that have been made so far, by number.
    """

    def __init__(
        self,
        programs: Sequence[HubProgramFile],
        *,
        stdout: BinaryIO,
        stderr: TextIO,
        time_limit_s: float | None = None,
        distance_m: Callable[[int, int], float] = on_benches_m,
        seed: int = 0,
    ) -> None:
        if not programs:
            raise TwinError("there is no program for this room; name one")
        self.machines: dict[int, Machine] = {}
        self._distance_m = distance_m
        self._seed = seed
        names = names_of([program.path for program in programs])
        self._hubs = []
        for number, (program, name) in enumerate(zip(programs, names, strict=True)):
            out = program.stdout or Marked(stdout, f"{name}: ".encode(), b"\n")
            err = program.stderr or Marked(stderr, f"{name}: ", "\n")
            attend = self._attend(number, program.operation)
            self._hubs.append(
                _Hub(
                    program=replace(program, operation=attend),
                    stdout=out,
                    stderr=err,
                    time_limit_s=time_limit_s,
                )
            )

    def run(self) -> list[int]:
        """Run all programs to their ends, and return their exit codes, in order. Raises as
        `run_file`; all programs end then."""
        try:
            # First every program comes to its first line.
            for hub in self._hubs:
                hub.resume()
            self._raise_failure()
            antennas = [machine.antenna for _, machine in sorted(self.machines.items())]
            air = Air(antennas, self._distance_m, self._seed)
            for time_ms in itertools.count(CONTROL_LOOP_MS, CONTROL_LOOP_MS):
                if all(hub.code is not None for hub in self._hubs):
                    break
                for number in range(len(self._hubs)):
                    self.run_until(number, time_ms)
                self._raise_failure()
                air.carry(time_ms)
        finally:
            for hub in self._hubs:
                hub.end()
        return [hub.code or 0 for hub in self._hubs]

    def _raise_failure(self) -> None:
        """Raise what has ended a hub's program and is not the program's own error."""
        for hub in self._hubs:
            if hub.failure is not None:
                raise hub.failure

    def run_until(self, number: int, time_ms: int) -> None:
        """Run a hub up to a simulated time (ms), or to the end of its program. Does nothing for a
        hub that is there already, or waits for others."""
        hub = self._hubs[number]
        machine = self.machines.get(number)
        if hub.code is not None or hub.is_running or machine is None:
            return
        if machine.time_ms >= time_ms:
            return
        hub.stop_at(machine, time_ms)
        hub.resume()

    def _attend(self, number: int, operation: Operation) -> Operation:
        """The operation of a hub whose machine this room knows, and whose program waits for the
        others before its first line."""

        def attend(machine: Machine) -> None:
            self.machines[number] = machine
            if operation.attend is not None:
                operation.attend(machine)
            hub = self._hubs[number]
            hub.limit_ms = machine.alarm_ms
            hub.on_limit = machine.on_alarm
            machine.on_alarm = lambda: hub.pause(machine)
            hub.leave()

        return replace(operation, attend=attend)


class _RoomEnded(HostStop):
    """The other hubs have ended for a reason of this computer's, and so does this one."""


class _Hub:
    """A program in a greenlet."""

    def __init__(
        self,
        program: HubProgramFile,
        stdout: BinaryIO | Marked,
        stderr: TextIO | Marked,
        time_limit_s: float | None,
    ) -> None:
        self._program = program
        self._stdout = stdout
        self._stderr = stderr
        self._time_limit_s = time_limit_s
        self._greenlet = greenlet(self._run)
        self._caller: Any = None
        self.failure: BaseException | None = None
        self.code: int | None = None
        self.is_running = False
        self.limit_ms: int | None = None
        self.on_limit: Callable[[], None] = lambda: None

    def _run(self) -> None:
        try:
            self.code = run_file(
                self._program.path,
                self._program.body,
                stdout=cast("BinaryIO", self._stdout),
                stderr=cast("TextIO", self._stderr),
                time_limit_s=self._time_limit_s,
                operation=self._program.operation,
            )
        except BaseException as error:  # noqa: BLE001  raised where the room waits
            self.failure = error
            self.code = 1
        finally:
            for stream in (self._stdout, self._stderr):
                if isinstance(stream, Marked):
                    stream.end()

    def resume(self) -> None:
        """Run on, until the hub pauses or its program has ended. What ended it is kept: the caller
        may be another hub, whose program it does not concern."""
        self._caller = getcurrent()
        # Where it ends, too: another hub may have asked it to run.
        self._greenlet.parent = self._caller
        self.is_running = True
        try:
            self._greenlet.switch()
        finally:
            self.is_running = False

    def leave(self) -> None:
        """Go back to whom has asked this hub to run."""
        self._caller.switch()

    def stop_at(self, machine: Machine, time_ms: int) -> None:
        """Pause at a time, or stop at the limit before."""
        limit_ms = self.limit_ms
        machine.alarm_ms = time_ms if limit_ms is None else min(time_ms, limit_ms)

    def pause(self, machine: Machine) -> None:
        """Called at the alarm of the machine."""
        if self.limit_ms is not None and machine.time_ms >= self.limit_ms:
            self.on_limit()
        else:
            machine.alarm_ms = None
            self.leave()

    def end(self) -> None:
        """End a program that still runs, as Ctrl-C does: its motors stop."""
        if self.code is None and self._greenlet:
            self._greenlet.parent = getcurrent()
            self._greenlet.throw(_RoomEnded)
