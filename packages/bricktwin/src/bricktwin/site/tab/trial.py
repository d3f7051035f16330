"""Trial of a robot: its hub's program acts by some numbers for a few seconds, from the start."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from brickhub.hub.interface import Pitch, Roll
from brickhub.hub.program.generate import TILT_DEG, generate_alone
from brickhub.robot import Robot
from brickhub.search.structure import source_by
from brickhub.seed import derive_seed
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.exceptions import HostStop
from brickhub.virtual.pybricks import modules
from bricktwin.site.tab.lessons import Lesson, Record
from bricktwin.site.tab.robot_file import Draws
from bricktwin.twin.body import NoiseSources, TwinBody
from bricktwin.twin.settling import halt

NAME = "taught.py"
_SEED = 0
"""Of the noise of each trial: the same numbers have the same score, whoever tries them."""


class _Over(HostStop):
    """The trial has ended."""


def program_by(
    lesson: Lesson,
    robot: Robot,
    numbers: Sequence[float],
) -> str:
    """Program with which the robot's hub acts by numbers ``[p]``, without end."""
    program = generate_alone(
        robot,
        lesson.interface,
        range(len(lesson.interface.channels)),
        source_by(lesson.structure, numbers),
        f"numbers that it learned, to {lesson.goal}",
        age_ms=0,
    )
    return program.source


def at_start(body: TwinBody) -> TwinBody:
    """The robot of a body as it is at first, at its start; the body given is of no use any more."""
    engine = body.engine
    for place, value in enumerate(engine.nominal("qpos0")):
        engine.qpos[place] = value
    # Else it would begin with the turn of the last trial, into which it settles.
    halt(engine)
    engine.forget()
    fresh = TwinBody(
        body.robot,
        body.scene,
        engine,
        body.physics,
        NoiseSources(
            readings=Draws(derive_seed(_SEED, "readings")),
            heading=Draws(derive_seed(_SEED, "heading")),
        ),
    )
    fresh.begin(body.physics, Draws(derive_seed(_SEED, "start")))
    return fresh


@dataclass
class _Console:
    """Console of the hub, which reads what the program prints at each step.

    Attributes:
        count: channels of a line.
        steps: of the trial.
        tilts: indices of pitch and roll among them.
    """

    body: TwinBody
    count: int
    steps: int
    tilts: Sequence[int]
    record: Record = field(default_factory=Record)
    inbox: bytearray = field(default_factory=bytearray)
    _line: bytes = b""

    def available(self) -> int:
        return 0

    def read(self, n: int) -> bytes:
        raise EOFError("nobody types")

    def write_app_data(self, data: bytes) -> None:
        """Discard it."""

    def write(self, data: bytes) -> None:
        self._line += data
        *lines, self._line = self._line.split(b"\r\n")
        for line in lines:
            self._take([float(text) for text in line.split()])

    def _take(self, printed: list[float]) -> None:
        """Take a line: what was computed for, what was observed, and the commands. Raises _Over
        after the last step, or a fall."""
        record = self.record
        observed = printed[1 : 1 + self.count]
        record.observed.append(observed)
        record.poses.append(self.body.pose())
        record.has_fallen = any(abs(observed[tilt]) > TILT_DEG for tilt in self.tilts)
        if record.has_fallen or len(record.poses) > self.steps:
            raise _Over


def try_once(
    lesson: Lesson,
    source: str,
    body: TwinBody,
    attend: Callable[[Machine], None] = lambda _machine: None,
) -> Record:
    """Let a program of `program_by` act for a trial, and take what happens. Raises what the program
    raises.

    Args:
        body: the robot at its start.
        attend: called with the machine before the program starts.
    """
    machine = Machine(body)
    tilts = []
    for index, channel in enumerate(lesson.interface.channels):
        if isinstance(channel, Pitch | Roll):
            tilts.append(index)
    console = _Console(
        body,
        len(lesson.interface.channels),
        lesson.steps,
        tilts,
    )
    attend(machine)
    try:
        execute(source, NAME, modules(machine, console), console)
    except _Over:
        pass
    finally:
        machine.stop_motors()
    return console.record
