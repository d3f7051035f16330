"""Running program files on a virtual hub."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, TextIO

from brickhub.errors import TwinError
from brickhub.hub.program.syntax import parse
from brickhub.hub.program.user_program import check_time_limit, folder_with_module, load_program, read_program
from brickhub.hub.transport import HubProgram, as_typed
from brickhub.robot import HubKind
from brickhub.virtual.body import Body
from brickhub.virtual.fitted_bench import FittedBench
from brickhub.virtual.given_readings import GivenReading
from brickhub.virtual.host_stop import HostStop
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.compiler import compile_source
from brickhub.virtual.micropython.exceptions import SwitchedOff, class_name
from brickhub.virtual.micropython.system import is_program_error
from brickhub.virtual.micropython.text import format_traceback
from brickhub.virtual.output_buffer import OutputBuffer
from brickhub.virtual.pace import Pace
from brickhub.virtual.panel import WIRELESS, Panel, Press
from brickhub.virtual.pybricks import modules


class _ProgramStopped(HostStop):
    """The program is to end; on a hub the button raises SystemExit."""


class _OutputFailed(HostStop):
    """This computer does not take the program's output: no hub has that error."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error)
        self.error = error


class StreamConsole:
    """A console on binary streams with ``\\n`` line ends; AppData is discarded, as without a host."""

    def __init__(self, machine: Machine, stdin: BinaryIO | TextIO | None, stdout: BinaryIO) -> None:
        self._machine = machine
        self._stdout = stdout
        self._stdin = stdin
        self._output = OutputBuffer(machine)
        self._position = 0
        self.inbox = bytearray()

    @cached_property
    def _input(self) -> bytes:
        # Read everything, as simulated time waits for nobody, and only on demand, as a pipe without a writer would block.
        return as_typed(self._stdin.read() if self._stdin is not None else b"")

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
        try:
            self._stdout.write(data.replace(b"\r\n", b"\n"))
        except OSError as error:  # the reader has left, or the disk is full
            raise _OutputFailed(error) from error
        self._output.add(len(data))

    def write_app_data(self, data: bytes) -> None:
        """Discard: there is no listener."""


@dataclass(frozen=True)
class Operation:
    """Actions of a person while a program runs.

    Attributes:
        presses: of buttons, at simulated times.
        readings: of sensors on the bench, by port.
        end_stops: lowest and highest angle (deg) of motors on the bench, by port.
        realtime: run in real time.
        watch: called with the hub's panel before the program starts.
        attend: called with the machine before the program starts; may set its pace and call :func:`stop_program`.
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
    stdin: BinaryIO | TextIO | None = None,
    time_limit_s: float | None = None,
    operation: Operation | None = None,
) -> int:
    """Run a hub program to its end in simulated time.

    Args:
        path: the program; imports from its folder work.
        body: the robot; ``None`` for a bench with the hub and devices that the program uses.
        stdout: for prints; ``None`` for this process's.
        stderr: for the hub's traceback or stop message; ``None`` for this process's.
        stdin: input, read completely at once: bytes, or text as if it were typed; ``None`` for none.
        time_limit_s: simulated seconds until the program is stopped, as by the button.
        operation: buttons, readings and pace.

    Returns:
        Exit code: 1 if the program raises, else 0, also for ``SystemExit``, switching off and the time limit.

    Raises:
        OSError: ``stdout`` does not take what the program prints.
        ProgramError: the file cannot be read, or the time limit is invalid.
        TwinError: a button, port or reading does not suit the hub, or the program waits for ever.
    """
    operation = operation or Operation()
    path = Path(path)
    stdout = stdout or sys.stdout.buffer
    stderr = stderr or sys.stderr
    source = read_program(path)
    check_time_limit(time_limit_s)
    machine = _machine(body, operation, path, lambda line: stderr.write(f"{line}\n"))
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


def _machine(body: Body | None, operation: Operation, path: Path, report: Callable[[str], object]) -> Machine:
    if body is None:
        kind = _imported_hub(load_program(path))
        bench = FittedBench(kind, operation.readings, operation.end_stops, report)
        return Machine(bench, Panel(kind, operation.presses, near=WIRELESS))
    if operation.readings or operation.end_stops:
        raise TwinError("readings and end stops are for the bench; omit them, or take --robot bench")
    return Machine(body, Panel(body.robot.hub, operation.presses))


def _imported_hub(program: HubProgram) -> HubKind:
    """The kind of hub that a program imports; Prime by default."""
    classes = {name: kind for kind in HubKind for name in (kind.model.class_name, kind.model.alias)}
    for source in (program.source, *(module.source for module in program.modules)):
        try:
            tree = parse(source)
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
        own = {module.name: module for module in load_program(path).modules}
        importable.find_module = own.get
        for module in own.values():  # packed with the program, before it runs
            with suppress(OverflowError):  # which a hub finds when it loads the module
                compile_source(module.source, module.file)
        execute(source, path.name, importable, console)
    except (SystemExit, _ProgramStopped) as end:
        name = class_name(type(end)) if isinstance(end, SystemExit) else SystemExit.__name__
        stderr.write(f"The program was stopped ({name}).\n")
    except SwitchedOff:
        stderr.write("The hub was switched off.\n")
    except _OutputFailed as failure:
        raise failure.error from None
    except BaseException as error:
        if not (is_program_error(error) or isinstance(error, KeyboardInterrupt)):
            raise
        stderr.write(format_traceback(error, path.name) + _module_hint(error, path))
        return 1
    finally:
        machine.stop_motors()
        stdout.flush()
    return 0


def _module_hint(error: BaseException, path: Path) -> str:
    """A line that says where a module is that a program does not find."""
    missing = re.fullmatch("no module named '(.+)'", str(error)) if isinstance(error, ImportError) else None
    folder = folder_with_module(path, missing[1]) if missing else None
    if missing is None or folder is None:
        return ""
    return f"A program imports what lies beside it; move it to {folder}, where {missing[1]} is.\n"


def stop_program() -> None:
    """Stop the program of this thread, as the button does; only from within the machine's time."""
    raise _ProgramStopped
