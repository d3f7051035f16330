"""Programs from files on a virtual hub, as fast as simulated time goes."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, TextIO

from bricksrl.errors import TwinError
from bricksrl.hub.program.user_program import check_time_limit, module_beside, own_program, read_program
from bricksrl.hub.transport import HubProgram
from bricksrl.robots import HubKind
from bricksrl.virtual_hub.body import Body
from bricksrl.virtual_hub.fitted_bench import FittedBench
from bricksrl.virtual_hub.given_readings import GivenReading
from bricksrl.virtual_hub.interpreter import execute, format_traceback
from bricksrl.virtual_hub.machine import Machine
from bricksrl.virtual_hub.micropython.errors import class_name
from bricksrl.virtual_hub.micropython.system import is_of_program
from bricksrl.virtual_hub.pace import Pace
from bricksrl.virtual_hub.panel import Panel, Press
from bricksrl.virtual_hub.pybricks import modules


class _TimeIsUp(BaseException):
    """Ends a program from within, past its own handlers of exceptions. On a hub the button raises SystemExit."""


class StreamConsole:
    """A console on two binary streams; its lines end with ``\\n`` only. AppData goes nowhere, as without a host that listens."""

    def __init__(self, machine: Machine, stdin: BinaryIO | None, stdout: BinaryIO) -> None:
        self._machine = machine
        self._stdout = stdout
        self._stdin = stdin
        self._position = 0
        self.inbox = bytearray()

    @cached_property
    def _input(self) -> bytes:
        # All of it at once, simulated time does not wait for anybody who types; and only when the program asks, because a
        # pipe that nobody writes to would keep every other program waiting too.
        return self._stdin.read() if self._stdin is not None else b""

    def available(self) -> int:
        return len(self._input) - self._position

    def read(self, n: int) -> bytes:
        if n > self.available():
            raise EOFError("the program waits for input, and there is no more")
        start = self._position
        self._position += n
        return self._input[start : self._position]

    def write(self, data: bytes) -> None:
        self._machine.charge_call()
        self._stdout.write(data.replace(b"\r\n", b"\n"))

    def write_app_data(self, data: bytes) -> None:
        """Nobody listens."""


@dataclass(frozen=True)
class Operation:
    """What a person does with the hub while a program runs.

    Attributes:
        presses: of its buttons, at simulated times.
        readings: what sensors on the bench sense, by port.
        end_stops: lowest and highest angle (deg) at which something blocks a motor on the bench, by port.
        realtime: let simulated time keep pace with the clock on the wall.
        watch: called with the hub's panel before the program starts, such as by who presses buttons with keys.
        attend: called with the machine before the program starts, such as by who shows it and gives it a pace, which may call
            :func:`stop_program`.
    """

    presses: Sequence[Press] = ()
    readings: Sequence[GivenReading] = ()
    end_stops: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    realtime: bool = False
    watch: Callable[[Panel], None] | None = None
    attend: Callable[[Machine], None] | None = None


def run_file(
    path: str | Path,
    body: Body | None = None,
    *,
    stdout: BinaryIO | None = None,
    stderr: TextIO | None = None,
    stdin: BinaryIO | None = None,
    time_limit_s: float | None = None,
    operation: Operation | None = None,
) -> int:
    """Run a hub program to its end, in simulated time.

    Args:
        path: the program; it can import others from its folder.
        body: the robot that it runs on; ``None`` for a hub on a bench that fits itself to the program: it is of the kind that the
            program imports, and has on each port the device that the program asks for there.
        stdout: gets what the program prints; ``None`` for this process's.
        stderr: gets the traceback when it raises, as a hub prints it, or that it was stopped; ``None`` for this process's.
        stdin: what the program can read; read to its end at once. ``None`` for nothing.
        time_limit_s: simulated seconds after which the program is stopped, as with the button of a hub.
        operation: buttons, readings and pace; ``None`` for nothing of it.

    Returns:
        Exit code: 1 when the program raises, 0 else; ``SystemExit`` and the time limit count as an end.

    Raises:
        ProgramError: the file cannot be read, or the time limit is no time.
        TwinError: a button, port or reading does not fit the hub; the program waits for what can never come.
    """
    operation = operation or Operation()
    path = Path(path)
    stdout = stdout or sys.stdout.buffer
    stderr = stderr or sys.stderr
    source = read_program(path)
    check_time_limit(time_limit_s)
    machine = _machine(body, operation, path)
    if time_limit_s is not None:
        machine.alarm_ms = round(time_limit_s * 1000)
        machine.on_alarm = stop_program
    if operation.realtime:
        machine.pace = Pace()
    if operation.watch is not None:
        operation.watch(machine.panel)
    if operation.attend is not None:
        operation.attend(machine)
    console = StreamConsole(machine, stdin, stdout)
    return _run(source, path, machine, console, stdout, stderr)


def _machine(body: Body | None, operation: Operation, path: Path) -> Machine:
    if body is None:
        kind = _hub_of(own_program(path))
        fitted = FittedBench(kind, operation.readings, operation.end_stops)
        return Machine(fitted, Panel(kind, operation.presses, has_remote=True))
    if operation.readings or operation.end_stops:
        raise TwinError("readings and end stops are for the bench; omit them, or take --robot bench")
    return Machine(body, Panel(body.robot.hub, operation.presses))


def _hub_of(program: HubProgram) -> HubKind:
    """The kind of hub whose class a program imports; a Prime hub where it imports none."""
    classes = {kind.model.class_name: kind for kind in HubKind} | {"InventorHub": HubKind.PRIME}
    for source in (program.source, *(module.source for module in program.beside)):
        try:
            tree = ast.parse(source)
        except (SyntaxError, ValueError):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module == "pybricks.hubs":
                for alias in node.names:
                    if alias.name in classes:
                        return classes[alias.name]
    return HubKind.PRIME


def _run(source: str, path: Path, machine: Machine, console: StreamConsole, stdout: BinaryIO, stderr: TextIO) -> int:
    try:
        importable = modules(machine, console)
        importable.find_module = lambda name: module_beside(path, name)
        execute(source, path.name, importable, console)
    except (SystemExit, _TimeIsUp) as end:
        name = class_name(type(end)) if isinstance(end, SystemExit) else SystemExit.__name__
        stderr.write(f"The program was stopped ({name}).\n")
    except BaseException as error:
        if not (is_of_program(error) or isinstance(error, KeyboardInterrupt)):
            raise
        stderr.write(format_traceback(error, path.name))
        return 1
    finally:
        machine.stop_motors()
        stdout.flush()
    return 0


def stop_program() -> None:
    """Stop the program that runs in this thread, as the button of a hub does; only from within the machine's time."""
    raise _TimeIsUp
