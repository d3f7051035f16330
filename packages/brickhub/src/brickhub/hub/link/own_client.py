"""Link to a client program of a user's own: commands and answers are ``struct``s of the user's, without frames.

The program waits for a command, acts, and answers; nothing is numbered, so that nothing can be repeated. It has no watchdog.
"""

from __future__ import annotations

import logging
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from brickhub.errors import DescriptionError, HubProtocolError
from brickhub.hub.commands import Command
from brickhub.hub.interface import Channel, Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.receiver import Reading
from brickhub.hub.link.states import Cause, after
from brickhub.hub.program.check_program import check_program
from brickhub.hub.program.run_program import load_program
from brickhub.hub.protocol import WRITE_BYTES, DataFrame, EncodingError
from brickhub.hub.transport import HubProgram, Transport
from brickhub.robot import HubKind, Robot

_log = logging.getLogger(__name__)

_TEXT_BYTES = 4096
_TRACEBACK = b"Traceback"


@dataclass(frozen=True)
class ClientCommand(Command):
    """Number that a client of one's own gets, such as an action in -1..1."""

    label: str
    low: float = -1.0
    high: float = 1.0
    unit: str = ""
    mover: ClassVar[None] = None

    @property
    def name(self) -> str:
        return self.label

    def check(self, robot: Robot) -> None:
        raise self.error(" is for a client of your own; name its program, or take another command")

    def motors(self, robot: Robot) -> tuple[str, ...]:
        return ()

    def turns_deg(self, robot: Robot, amount: float) -> tuple[float, ...]:
        return ()


@dataclass(frozen=True)
class ClientChannel(Channel):
    """Number that a client of one's own answers; values beyond its range are possible."""

    label: str
    low: float
    high: float
    unit: str = ""
    expression: ClassVar[str] = ""

    @property
    def name(self) -> str:
        return self.label

    @property
    def wraps(self) -> bool:
        return (self.low, self.high, self.unit) == (0.0, 360.0, "deg")

    @property
    def is_nominal(self) -> bool:  # type: ignore[override]  # a constant of most kinds
        return not self.wraps

    def check(self, robot: Robot) -> None:
        raise self.error(" is of a client of your own; name its program, or take another channel")


@dataclass(frozen=True)
class OwnClient:
    """A client program and its formats. Raises DescriptionError if there is no such file, or a format is none.

    Attributes:
        program: path of the program; a relative one is found as Python finds modules: beside the file that names it, or in the
            present folder. It becomes absolute.
        commands, answer: ``struct`` formats of what it reads at a step, and of what it writes then, such as ``"!ff"``.
    """

    program: str
    commands: str
    answer: str

    def __post_init__(self) -> None:
        found = next((path for folder in ("", *sys.path) if (path := Path(folder, self.program)).is_file()), None)
        if found is None:
            raise DescriptionError(f"there is no client program '{self.program}'; put it beside your task, or give its path")
        object.__setattr__(self, "program", str(found.resolve()))
        for name in ("commands", "answer"):
            if not _zeros(name, getattr(self, name)):
                raise DescriptionError(f"the format of the client's {name} has no numbers; give one such as '!f'")

    def check(self, interface: Interface) -> None:
        """Raise DescriptionError unless the formats have a number for each command and channel."""
        for name, numbers in (("commands", interface.commands), ("answer", interface.channels)):
            count, expected = len(_zeros(name, getattr(self, name))), ", ".join(number.name for number in numbers)
            if count != len(numbers):
                raise DescriptionError(f"the client's {name} are {count} numbers; give a format for {len(numbers)}: {expected}")

    def load(self, hub: HubKind) -> tuple[HubProgram, int, list[str]]:
        """The program, its size on a hub in bytes, and a sentence about each thing that may go wrong. Raises ProgramError as
        `check_program`."""
        program = load_program(Path(self.program))
        size, sentences = check_program(program, hub)
        if "kbd_intr(" not in program.source:
            sentences += [f"{program.name} never calls kbd_intr(-1): a byte 3 in a command ends it, as Ctrl-C does"]
        return program, size, sentences

    def encoded(self, values: Iterable[float]) -> bytes:
        """The bytes of a command; whole numbers are rounded. Raises EncodingError if the format cannot hold the values."""
        numbers = [round(value) if isinstance(zero, int) else value for value, zero in self._with_zeros(values)]
        try:
            return struct.pack(self.commands, *numbers)
        except struct.error as error:
            raise EncodingError(f"the client's commands '{self.commands}' cannot hold {numbers} ({error}); correct one") from None

    def _with_zeros(self, values: Iterable[float]) -> list[tuple[float, Any]]:
        numbers, zeros = [float(value) for value in values], _zeros("commands", self.commands)
        if len(numbers) != len(zeros) or any(number != number for number in numbers):
            raise EncodingError(f"the client takes {len(zeros)} numbers, not {numbers}; give one for each command")
        return list(zip(numbers, zeros, strict=True))


def _zeros(name: str, form: str) -> tuple[Any, ...]:
    """Zeros in a ``struct`` format. Raises DescriptionError if it is none, or holds other than numbers."""
    try:
        zeros = struct.unpack(form, bytes(struct.calcsize(form)))
    except (struct.error, TypeError) as error:
        raise DescriptionError(f"'{form}' is no struct format for the client's {name} ({error}); give one such as '!f'") from None
    if any(isinstance(zero, bytes) for zero in zeros):
        raise DescriptionError(f"the client's {name} '{form}' hold text; numbers only, such as '!f'")
    return zeros


class _AnswerDecoder:
    """Cuts a client's output into answers; a traceback is seen in it too."""

    crc_errors = skipped_bytes = 0

    def __init__(self, size: int) -> None:
        self._size, self._recent, self.rest = size, b"", b""

    @property
    def text(self) -> str:
        start = self._recent.find(_TRACEBACK)
        return "" if start < 0 else self._recent[start:].decode("utf-8", "replace")

    def feed(self, data: bytes) -> Sequence[DataFrame]:
        self._recent = (self._recent + data)[-_TEXT_BYTES:]
        self.rest += data
        whole = len(self.rest) // self._size * self._size
        answers, self.rest = self.rest[:whole], self.rest[whole:]
        return [DataFrame(1, answers[start : start + self._size]) for start in range(0, whole, self._size)]


class ClientLink(HubLink):
    """A :class:`HubLink` to a client of one's own; further arguments as there.

    ``read`` sends zeros, or the values nearest to zero, as such a client answers only a command. A step without an answer raises
    HubTimeoutError; then motors may run on until the hub is reached or switched off.

    Raises:
        ProgramError: the program cannot run on this hub, see ``check_program``.
        DescriptionError: its formats do not fit the interface.
    """

    def __init__(self, transport: Transport, robot: Robot, interface: Interface, client: OwnClient, **options: Any) -> None:
        client.check(interface)
        self._client = client
        self._at_rest = [min(max(0.0, command.low), command.high) for command in interface.commands]
        super().__init__(transport, robot, interface, **options)

    def _program_of(self, robot: Robot) -> HubProgram:
        program, _, sentences = self._client.load(robot.hub)
        for sentence in sentences:
            _log.warning("%s", sentence)
        return program

    def _decoder(self) -> _AnswerDecoder:
        self._answers = _AnswerDecoder(struct.calcsize(self._client.answer))
        return self._answers

    def rest(self) -> None:
        """Send zeros; the client has no other way to stop its motors. Raises as `act`."""
        self.act(self._at_rest)

    def _start_program(self) -> None:
        if not self._has_started:
            sentence = "%s is a program of your own, without a watchdog: if the link breaks, motors may run on; switch the hub off"
            _log.warning(sentence, self.program.name)
        self._run_program()
        self._started_s = self.now_s()
        self.state = after(self.state, Cause.OPENED)

    def _read(self) -> Reading:
        return self._exchange(self._next_frame(self._at_rest), self._longest_move_s, self._known_move_s)

    def _next_frame(self, values: Iterable[float]) -> bytes:
        frame = self._client.encoded(values)
        self._require_open()
        self.state = after(self.state, Cause.ACTED)
        return frame

    def _send(self, frame: bytes) -> None:
        with self._fault():
            if self._listener.has_frames or self._answers.rest:
                raise HubProtocolError(
                    f"{self.program.name} sent more than an answer '{self._client.answer}' for a command; correct one of them"
                )
        self._sent_s = self.now_s()
        for start in range(0, len(frame), WRITE_BYTES):
            self._transport.write(frame[start : start + WRITE_BYTES])

    def _receive(self, frame: bytes, longest_move_s: float, known_move_s: float | None) -> Reading:
        limit_s = longest_move_s + self._timeout_s
        answer = self._listener.wait_for(lambda _: True, self._sent_s + limit_s - self.now_s())
        if not isinstance(answer, DataFrame):
            size, came = struct.calcsize(self._client.answer), len(self._answers.rest)
            problem = f"{self.program.name} sent {came} of the {size} bytes of an answer '{self._client.answer}'"
            raise self._listener.timeout_error(problem, limit_s)
        arrived_s = self.now_s()
        values = tuple(map(float, struct.unpack(self._client.answer, answer.payload)))
        round_trip_s = arrived_s - self._sent_s
        self.statistics.record(round_trip_s, 0.0)
        return Reading(values, round(1000 * (arrived_s - self._started_s)), round_trip_s)
