"""Runs a file on a virtual robot, as fast as it goes."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, TextIO

from bricksrl import robots
from bricksrl.hub.own_program import check_time_limit, module_beside, read_program
from bricksrl.robots import Robot
from bricksrl.twin.language import execute, format_traceback
from bricksrl.twin.machine import Machine
from bricksrl.twin.micropython.errors import class_name
from bricksrl.twin.micropython.system import is_of_program
from bricksrl.twin.pybricks import modules
from bricksrl.twin.scene import Scene


class _TimeIsUp(BaseException):
    """Ends a program from within, past its own handlers of exceptions. On a hub the button raises SystemExit."""


class StreamConsole:
    """A console on two binary streams; its lines end with ``\\n`` only."""

    def __init__(self, machine: Machine, stdin: BinaryIO | None, stdout: BinaryIO) -> None:
        self._machine = machine
        self._stdout = stdout
        self._stdin = stdin
        self._position = 0

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


def run_file(
    path: str | Path,
    robot: str | Robot,
    *,
    scene: Scene | None = None,
    stdout: BinaryIO,
    stderr: TextIO,
    stdin: BinaryIO | None = None,
    time_limit_s: float | None = None,
    video: Path | None = None,
) -> int:
    """Run a hub program to its end, in simulated time.

    Args:
        path: the program; it can import others from its folder.
        robot: the robot that it runs on, or its name; ``"bench"`` for a bare hub.
        scene: what stands around it; ``None`` for an open floor.
        stdout: gets what the program prints.
        stderr: gets the traceback when it raises, as a hub prints it, or that it was stopped.
        stdin: what the program can read; read to its end at once. ``None`` for nothing.
        time_limit_s: simulated seconds after which the program is stopped, as with the button of a hub.
        video: file to film the robot into, an mp4.

    Returns:
        Exit code: 1 when the program raises, 0 else; ``SystemExit`` and the time limit count as an end.

    Raises:
        UnknownNameError: there is no such robot.
        ProgramError: the file cannot be read, or the time limit is no time.
        TwinError: the robot has no twin, or cannot be filmed.
        RenderingUnavailableError: it is to be filmed, and no OpenGL library works here.
    """
    from bricksrl.twin.bodies import make_body

    robot = robots.get(robot) if isinstance(robot, str) else robot
    path = Path(path)
    source = read_program(path)
    check_time_limit(time_limit_s)
    machine = Machine(robot, make_body(robot, scene=scene))
    if time_limit_s is not None:
        machine.alarm_ms = round(time_limit_s * 1000)
        machine.on_alarm = _stop
    console = StreamConsole(machine, stdin, stdout)
    with _film(machine, video):
        return _run(source, path, machine, console, stdout, stderr)


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


def _film(machine: Machine, video: Path | None) -> AbstractContextManager[None]:
    if video is None:
        return nullcontext()
    from bricksrl.twin.film import filmed

    return filmed(machine, video)


def _stop() -> None:
    raise _TimeIsUp
