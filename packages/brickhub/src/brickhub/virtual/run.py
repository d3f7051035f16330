"""Running program files on a virtual hub."""

import functools
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO, TextIO

from brickhub.errors import ProgramError, TwinError
from brickhub.files import reading, write_durably
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.program.imported_hub import imported_hub
from brickhub.hub.program.lego_languages import language_note
from brickhub.hub.program.pybricks2 import outdated_note
from brickhub.hub.program.run_program import (
    TIME_LIMIT_EXIT_CODE,
    check_time_limit,
    folder_with_module,
    load_program,
    time_limit_note,
)
from brickhub.hub.transport import HubProgram, as_typed
from brickhub.robot import AnyHub, MotorKind, SensorKind
from brickhub.robot.hardware import USUAL_HUB_NAME
from brickhub.virtual import error_numbers
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.body import Body
from brickhub.virtual.given_readings import GivenReading
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import NEWEST, Machine, Pace, firmware_version
from brickhub.virtual.micropython.compiler import compile_source
from brickhub.virtual.micropython.exceptions import (
    HostStop,
    SwitchedOff,
    class_name,
    is_program_error,
)
from brickhub.virtual.micropython.text import format_traceback
from brickhub.virtual.own_devices import AnyOwnDevice, OwnDeviceOf, OwnI2c, own_device_of
from brickhub.virtual.panel import WIRELESS, Panel, Press
from brickhub.virtual.pybricks import modules

_BUFFER_BYTES = 511
"""What the hub keeps of a program's output until it is sent."""
_CHUNK_BYTES = 60
"""What goes over USB in a millisecond."""


class ProgramStopped(HostStop):
    """The program is to end; on a hub the button raises SystemExit."""


class _TimeLimitReached(ProgramStopped):
    """The time limit is over; its seconds are the only argument."""


class _OutputFailed(HostStop):
    """This computer does not take the program's output: no hub has that error, which is the only
    argument."""


class StreamConsole:
    """A console on binary streams with ``\\n`` line ends; AppData is discarded, as without a host.

    Output waits in a buffer to be sent over USB, 60 bytes each millisecond. A program waits while
    it is full.
    """

    def __init__(
        self,
        machine: Machine,
        stdin: BinaryIO | TextIO | None,
        stdout: BinaryIO,
    ) -> None:
        self._machine = machine
        self._stdin = stdin
        self._stdout = stdout
        # Bytes that wait to be sent, since when, and when the next ones can be.
        self._waiting = 0
        self._since_ms = 0
        self._free_ms = 0
        # Bytes of the input that the program has read.
        self._position = 0
        self.inbox = bytearray()

    @cached_property
    def _input(self) -> bytes:
        # Read everything, as simulated time waits for nobody, and only on demand, as a pipe without
        # a writer would block.
        return as_typed(self._stdin.read() if self._stdin is not None else b"")

    def available(self) -> int:
        return len(self._input) - self._position

    def read(self, n: int) -> bytes:
        if n > self.available():
            if self._stdin is None:
                raise EOFError(
                    "the program waits for input, and gets none here; several hubs in a room have "
                    "none, so run it alone, or give it what it asks for by radio"
                )
            raise EOFError("the program waits for input, and there is no more")
        start = self._position
        self._position += n
        return self._input[start : self._position]

    def write(self, data: bytes) -> None:
        self._machine.charge_call()
        try:
            self._stdout.write(data.replace(b"\r\n", b"\n"))
            # In real time somebody watches; what is simulated at once is written at once.
            if self._machine.pace is not None:
                self._stdout.flush()
        except OSError as error:
            # The reader has left, or the disk is full. To the program it would be its own OSError.
            raise _OutputFailed(error) from error
        # The bytes are written at once; what is simulated from here on is the time that they take.
        machine = self._machine
        size = len(data)
        self._send(machine.body_ms - 1)
        if not self._waiting:
            self._since_ms = machine.time_ms
        while self._waiting + size > _BUFFER_BYTES:
            size -= _BUFFER_BYTES - self._waiting
            self._waiting = _BUFFER_BYTES
            self._send(machine.time_ms)
            machine.advance(1)
        self._waiting += size

    def _send(self, until_ms: int) -> None:
        """Send chunks that begin at a time or before."""
        while self._waiting:
            begin_ms = max(self._free_ms, self._since_ms)
            if begin_ms > until_ms:
                return
            self._waiting -= min(self._waiting, _CHUNK_BYTES)
            self._free_ms = begin_ms + 1

    def write_app_data(self, data: bytes) -> None:
        """Discard: there is no listener."""


@dataclass(frozen=True)
class Operation:
    """Actions of a person while a program runs.

    Attributes:
        presses: of buttons, at simulated times.
        readings: of sensors on the bench, by port.
        end_stops: lowest and highest angle (deg) of motors on the bench, by port.
        starts: angle (deg) at which motors on the bench stand at first, by port.
        devices: motors and sensors on the bench, by port; ``None`` for nothing.
        own_devices: devices of the user's own, by port, also of a robot with a body, in place of
            its sensors; or functions that make one for the robot.
        hub_name: what the hub is called.
        storage: file with what the hub's programs have stored, written anew at the end; ``None``
            for a hub that forgets it.
        realtime: run in real time.
        firmware: version of the firmware to play, such as ``"4.0"``.
        watch: called with the hub's panel before the program starts.
        attend: called with the machine before the program starts; may set its pace and call
            :func:`stop_program`.
    """

    presses: Sequence[Press] = ()
    readings: Sequence[GivenReading] = ()
    end_stops: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    starts: Mapping[str, float] = field(default_factory=dict)
    devices: Mapping[str, MotorKind | SensorKind | None] = field(default_factory=dict)
    own_devices: Mapping[str, AnyOwnDevice | OwnDeviceOf] = field(default_factory=dict)
    hub_name: str = USUAL_HUB_NAME
    storage: Path | None = None
    realtime: bool = False
    firmware: str = NEWEST
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
        stdin: input, read completely at once: bytes, or text as if it were typed; ``None`` for
            none.
        time_limit_s: simulated seconds until the program is stopped.
        operation: buttons, readings and pace.

    Returns:
        Exit code: 1 if the program raises, `TIME_LIMIT_EXIT_CODE` if the time limit ends it, else
        0, also for ``SystemExit`` and switching off.

    Raises:
        OSError: ``stdout`` does not take what the program prints.
        ProgramError: the file cannot be read, or the time limit is invalid.
        UnknownNameError: that version of the firmware is not played.
        TwinError: a button, port or reading does not suit the hub, or the program waits for ever.
    """
    operation = operation or Operation()
    path = Path(path)
    stdout = stdout or sys.stdout.buffer
    stderr = stderr or sys.stderr
    program = load_program(path)
    check_time_limit(time_limit_s)
    firmware = firmware_version(operation.firmware)
    if body is None:
        hub = imported_hub(program)
        body = FittedBench(
            hub,
            operation.readings,
            operation.end_stops,
            operation.devices,
            operation.starts,
            report=lambda line: stderr.write(f"{line}\n"),
        )
        machine = Machine(body, Panel(hub, operation.presses, near=WIRELESS))
    elif operation.readings or operation.end_stops or operation.devices or operation.starts:
        raise TwinError(
            "readings, start angles and devices on ports are for the bench, and a body has its end "
            "stops; omit them, or take --robot bench"
        )
    elif not body.robot.hub.model.runs_programs:
        raise TwinError(
            f"'{body.robot.name}' is of LEGO's kits, whose devices run no program of a hub; take "
            "one that imports legoeducation, or a robot with a hub"
        )
    else:
        machine = Machine(body, Panel(body.robot.hub, operation.presses))
    machine.firmware = firmware
    machine.hub_name = operation.hub_name
    _plug_in(machine, operation.own_devices)
    if operation.storage is not None:
        _restore(machine, operation.storage)
    if time_limit_s is not None:
        machine.alarm_ms = round(time_limit_s * 1000)
        machine.on_alarm = functools.partial(_end_at_limit, time_limit_s)
    if operation.realtime:
        machine.pace = Pace()
    if operation.watch is not None:
        operation.watch(machine.panel)
    if operation.attend is not None:
        operation.attend(machine)
    _check_size(program, machine.robot.hub)
    console = StreamConsole(machine, stdin, stdout)
    try:
        return _run(
            program,
            path,
            machine,
            console,
            stdout,
            stderr,
        )
    finally:
        # A hub keeps it too, however the program ended.
        if operation.storage is not None:
            write_durably(operation.storage, bytes(machine.storage))


def _plug_in(machine: Machine, devices: Mapping[str, AnyOwnDevice | OwnDeviceOf]) -> None:
    """Plug in devices of the user's own, also in place of a robot's sensors. Raises TwinError if
    there is no such port, it is of another kind, or a motor is on it, and as `own_device_of`."""
    robot = machine.robot
    taken = [motor.port for motor in robot.motors]
    for port in devices:
        if port not in robot.hub.model.ports:
            raise TwinError(
                f"the {robot.hub.value} hub has no port {port}; it has "
                f"{', '.join(robot.hub.model.ports)}"
            )
        if port in taken:
            raise TwinError(
                f"port {port} of '{robot.name}' has a motor; plug your device into another port"
            )
    made = {port: own_device_of(device, machine.body) for port, device in devices.items()}
    for port, own in made.items():
        if isinstance(own, OwnI2c) and port not in robot.hub.model.sensor_ports:
            raise TwinError(
                f"an I2C device does not fit port {port} of the {robot.hub.value} hub; plug it "
                "into S1 to S4 of an EV3"
            )
    machine.own_devices = made


def _restore(machine: Machine, path: Path) -> None:
    """Give the hub what its programs have stored before. Raises TwinError if it has no place for
    it."""
    if not path.exists():
        return
    with reading("the storage", path, TwinError, "name another file, or leave out --storage"):
        stored = path.read_bytes()
    size = len(machine.storage)
    # Whatever has another length is another file of the user's, which would be written over.
    if stored and len(stored) != size:
        raise TwinError(
            f"{path} has {len(stored)} bytes, and this hub stores {size}: another file, or another "
            "hub's; name another one"
        )
    machine.storage[:] = stored or bytes(size)


def _run(
    program: HubProgram,
    path: Path,
    machine: Machine,
    console: StreamConsole,
    stdout: BinaryIO,
    stderr: TextIO,
) -> int:
    try:
        importable = modules(machine, console)
        importable.find_module = {module.name: module for module in program.modules}.get
        # All modules are packed with the program, so a mistake in one is found before it runs; but
        # for a constant that is too long, which a hub finds when it loads the module.
        for module in program.modules:
            with suppress(OverflowError):
                compile_source(module.source, module.file)
        execute(
            program.source,
            path.name,
            importable,
            console,
        )
    except _TimeLimitReached as end:
        stderr.write(time_limit_note(end.args[0]))
        return TIME_LIMIT_EXIT_CODE
    except (SystemExit, ProgramStopped) as end:
        name = class_name(type(end)) if isinstance(end, SystemExit) else SystemExit.__name__
        stderr.write(f"The program was stopped ({name}).\n")
    except SwitchedOff:
        stderr.write("The hub was switched off.\n")
    except _OutputFailed as failure:
        raise failure.args[0] from None
    except BaseException as error:
        # A KeyboardInterrupt that gets here is the program's: Ctrl-C is another within
        # `interruptible`.
        if not (is_program_error(error) or isinstance(error, KeyboardInterrupt)):
            raise
        report = format_traceback(error, path.name)
        report += _module_hint(error, path)
        report += _typing_hint(error, program.source)
        report += _ports_hint(error, machine)
        if machine.robot.hub.model.ran_pybricks_2:
            report += outdated_note(program)
        if isinstance(error, ImportError):
            report += language_note(program)
        stderr.write(report)
        return 1
    finally:
        # However it ended: motors coast, the radio is silent, and the last line is on the screen.
        machine.stop_motors()
        stdout.flush()
    return 0


def _check_size(program: HubProgram, hub: AnyHub) -> None:
    """Raises ProgramError if a program is larger than a hub takes."""
    sources = [program.source, *(module.source for module in program.modules)]
    # Compiling takes a moment, and what is compiled is hardly ever longer than its text.
    if 2 * sum(map(len, sources)) <= hub.model.program_bytes:
        return
    try:
        compiled = compile_program(program)
    except ProgramError:
        # Its run says what is wrong with it, as a hub does.
        return
    program_blob(compiled, hub)


def _module_hint(error: BaseException, path: Path) -> str:
    """A line that says where a module is that a program does not find."""
    if not isinstance(error, ImportError):
        return ""
    missing = re.fullmatch("no module named '(.+)'", str(error))
    if missing is None:
        return ""
    module_name = missing[1]
    folder = folder_with_module(path, module_name)
    if folder is None:
        return ""
    return f"A program imports what lies beside it; move it to {folder}, where {module_name} is.\n"


def _ports_hint(error: BaseException, machine: Machine) -> str:
    """A line that says what is on the ports of a robot, for a program that misses a device."""
    # What the firmware raises where a port has no device, or another one. A bench has them all.
    is_missing = isinstance(error, OSError) and error.args[:1] == (error_numbers.ENODEV,)
    if not is_missing or isinstance(machine.body, FittedBench):
        return ""
    robot = machine.robot
    own = machine.own_devices
    its = [device for device in (*robot.motors, *robot.sensors) if device.port not in own]
    devices = sorted(its, key=lambda device: device.port)
    described = [f"{device.port} '{device.name}' ({device.kind.value})" for device in devices]
    fitted = ", ".join(described)
    return (
        f"The robot '{robot.name}' has on its ports: {fitted or 'nothing'}; use these in the "
        "program, or leave --robot out "
        "for a bench that has what the program expects.\n"
    )


_OF_WORD_PROCESSORS = str.maketrans(
    "\u201c\u201d\u201e\u2018\u2019\u2013\u2014\u2212", '"""\'\'---'
)
"""Curly quotes and long dashes, and what a program needs in their place."""


def _typing_hint(error: BaseException, source: str) -> str:
    """A line that names a character of a word processor in a program whose syntax is wrong."""
    if not isinstance(error, SyntaxError):
        return ""
    # All of the source, as the compiler names the line where it gave up, perhaps a later one.
    for number, line in enumerate(source.splitlines(), 1):
        for typed, wanted in zip(line, line.translate(_OF_WORD_PROCESSORS), strict=True):
            if typed != wanted:
                return f"Line {number} has {typed}, as word processors write it; type {wanted}\n"
    return ""


def stop_program() -> None:
    """Stop the program of this thread, as the button does; only from within the machine's time."""
    raise ProgramStopped


def _end_at_limit(time_limit_s: float) -> None:
    """End the program of this thread, whose time is over; only from within the machine's time."""
    raise _TimeLimitReached(time_limit_s)


class _Interrupted(HostStop):
    """Ctrl-C by the user."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Context in which Ctrl-C, and what else raises KeyboardInterrupt here, as SIGTERM does in a
    command, ends a program past its handlers, to which that is an ordinary error; it is raised at
    the end of the context. No effect in other threads than the main one, which get no signals."""
    # Elsewhere Python refuses to set a handler.
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(_signum: int, _frame: FrameType | None) -> None:
        raise _Interrupted

    numbers = {
        number
        for number in signal.valid_signals()
        if signal.getsignal(number) is signal.default_int_handler
    }
    previous_handlers = {number: signal.getsignal(number) for number in {signal.SIGINT, *numbers}}
    try:
        try:
            for number in previous_handlers:
                signal.signal(number, interrupt)
            yield
        finally:
            _handle(previous_handlers)
    except _Interrupted:
        # It may have come while the handlers were changed.
        _handle(previous_handlers)
        raise KeyboardInterrupt from None


def _handle(handlers: Mapping[signal.Signals, Any]) -> None:
    """Let signals be handled by these."""
    for number, handler in handlers.items():
        signal.signal(number, handler)
