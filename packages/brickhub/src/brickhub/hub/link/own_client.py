"""Link to a client program of a user's own: commands and answers are ``struct``s of the user's,
without frames.

The program waits for a command, acts, and answers; nothing is numbered, so that nothing can be
repeated. It has no watchdog.
"""

import contextlib
import logging
import math
import struct
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brickhub.errors import DescriptionError, HubProtocolError, HubTimeoutError, ProgramStoppedError
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.robot_link import Reading
from brickhub.hub.link.states import Cause, after
from brickhub.hub.program.compile import check_program
from brickhub.hub.program.run_program import load_program
from brickhub.hub.protocol import WRITE_BYTES, DataFrame, EncodingError, Frame, FrameDecoder
from brickhub.hub.transport import HubProgram, Transport
from brickhub.robot import Robot

_log = logging.getLogger(__name__)

_TRACEBACK = b"Traceback"


@dataclass(frozen=True)
class OwnClient:
    """A client program and its formats. Raises DescriptionError if there is no such file, or a
    format is none.

    Attributes:
        program: path of the program, which becomes absolute; a relative one is found as Python
            finds modules, beside the file that names it or in the present folder.
        commands, answer: ``struct`` formats of what it reads at a step, and of what it writes then,
            such as ``"!ff"``.
    """

    program: str
    commands: str
    answer: str

    def __post_init__(self) -> None:
        found = _find_file(self.program)
        if found is None:
            raise DescriptionError(
                f"there is no client program '{self.program}'; put it beside your task, or give "
                "its path"
            )
        # The path is absolute, so that the client is found even if the present folder changes.
        object.__setattr__(self, "program", str(found.resolve()))
        for struct_format in (self.commands, self.answer):
            try:
                zeros = _zeros(struct_format)
            except (struct.error, TypeError) as error:
                raise DescriptionError(
                    f"'{struct_format}' is no struct format ({error}); give one such as '!f'"
                ) from None
            has_text = any(isinstance(zero, bytes) for zero in zeros)
            if not zeros or has_text:
                raise DescriptionError(
                    f"the client's format '{struct_format}' has no numbers or a text; give numbers "
                    "only, such as '!f'"
                )

    def check(self, interface: Interface) -> None:
        """Raise DescriptionError unless the formats have a number for each command and channel."""
        for struct_format, numbers in (
            (self.commands, interface.commands),
            (self.answer, interface.channels),
        ):
            if len(_zeros(struct_format)) != len(numbers):
                expected = ", ".join(number.name for number in numbers)
                raise DescriptionError(
                    f"the client's '{struct_format}' is not a format for {len(numbers)} numbers "
                    f"({expected}); correct it"
                )

    def load(self) -> HubProgram:
        """The program. Raises ProgramError if it cannot be read."""
        return load_program(Path(self.program))

    def encoded(self, values: Iterable[float]) -> bytes:
        """The bytes of a command; whole numbers are rounded. Raises EncodingError if the format
        cannot hold the values."""
        numbers = [float(value) for value in values]
        try:
            if any(map(math.isnan, numbers)):
                raise ValueError("not a number")
            # The type of its zero tells whether a place of the format takes whole numbers only.
            zeros = _zeros(self.commands)
            fields = []
            for number, zero in zip(numbers, zeros, strict=True):
                is_whole = isinstance(zero, int)
                fields.append(round(number) if is_whole else number)
            return struct.pack(self.commands, *fields)
        except (struct.error, ValueError, OverflowError) as error:
            raise EncodingError(
                f"the client's commands '{self.commands}' cannot hold {numbers} ({error}); "
                "correct one"
            ) from None


def _find_file(name: str) -> Path | None:
    """The file of that name, found as Python finds modules; "" is the present folder."""
    for folder in ("", *sys.path):
        path = Path(folder, name)
        if path.is_file():
            return path
    return None


def _zeros(struct_format: str) -> tuple[Any, ...]:
    """Zeros in a ``struct`` format."""
    zero_bytes = bytes(struct.calcsize(struct_format))
    return struct.unpack(struct_format, zero_bytes)


class _AnswerDecoder(FrameDecoder):
    """Cuts a client's output into answers; ``text`` is a traceback in it."""

    def __init__(self, size: int) -> None:
        super().__init__(size, {})
        self._size = size
        self.rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        self.rest += data
        # Nothing separates answers from text, so a traceback is known by its first word alone.
        if _TRACEBACK in self.rest:
            start = self.rest.index(_TRACEBACK)
            self._text = bytearray(self.rest[start:])
            return []
        whole = len(self.rest) // self._size * self._size
        answers = self.rest[:whole]
        self.rest = self.rest[whole:]
        # This link does not look at sequence numbers, which a user's answers do not have.
        return [
            DataFrame(1, answers[start : start + self._size])
            for start in range(0, whole, self._size)
        ]


class ClientLink(HubLink):
    """A :class:`HubLink` to a client of one's own; further arguments as there. ``read`` sends
    zeros, or the values nearest to zero, as such a client answers only a command. ``warns`` is
    whether it says, once, that there is no watchdog. Raises ProgramError if the program cannot run
    on this hub, DescriptionError if its formats do not fit the interface."""

    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        interface: Interface,
        client: OwnClient,
        *,
        warns: bool = True,
        **options: Any,
    ) -> None:
        client.check(interface)
        self._client = client
        self._warns = warns
        self._at_rest = [min(max(0.0, command.low), command.high) for command in interface.commands]
        # The base class asks for the program and the decoder, which need the client, so it comes
        # last.
        super().__init__(
            transport,
            robot,
            interface,
            **options,
        )

    def _program_of(self, robot: Robot) -> HubProgram:
        program = self._client.load()
        check_program(program, robot.hub)
        return program

    def _new_decoder(self) -> _AnswerDecoder:
        self._answers = _AnswerDecoder(struct.calcsize(self._client.answer))
        return self._answers

    def rest(self) -> None:
        """Send zeros; the client has no other way to stop its motors. Raises as `act`."""
        self.act(self._at_rest)

    def _start_program(self) -> None:
        if self._warns:
            self._warns = False
            _log.warning(
                "%s has no watchdog: if the link breaks, motors may run on; switch the hub "
                "off then",
                self.program.name,
            )
        self._run_program()
        self._started_s = self.now_s()
        self.state = after(self.state, Cause.OPENED)

    def _read(self) -> Reading:
        return self.act(self._at_rest)

    def _next_frame(self, values: Iterable[float]) -> bytes:
        # Values are encoded first, so that nothing is sent and no state changes if they cannot be.
        frame = self._client.encoded(values)
        self._require_open()
        self.state = after(self.state, Cause.ACTED)
        return frame

    def _send(self, frame: bytes) -> None:
        # Bytes that came before the command would be taken for its answer.
        self._require_no_more()
        self._sent_s = self.now_s()
        # A command may have any length, because the program reads a stream in which the pieces join
        # again.
        for start in range(0, len(frame), WRITE_BYTES):
            self._transport.write(frame[start : start + WRITE_BYTES])

    @contextlib.contextmanager
    def _fault_with_cause(self) -> Iterator[None]:
        with super()._fault_with_cause():
            try:
                yield
            except ProgramStoppedError:
                # A client has to answer until it is stopped, so ending by itself is a mistake in
                # it.
                raise ProgramStoppedError(
                    f"{self.program.name} has ended; let it answer in a loop without end"
                ) from None

    def _require_no_more(self) -> None:
        if self._frames or self._answers.rest:
            raise HubProtocolError(
                f"{self.program.name} sent more than an answer '{self._client.answer}'; correct "
                "one of them"
            )

    def _receive(
        self,
        frame: bytes,
        longest_move_s: float,
        known_move_s: float | None,
    ) -> Reading:
        """The answer to a command, which is sent once only. Raises HubTimeoutError if none
        comes."""
        limit_s = longest_move_s + self._timeout_s
        answer = self._wait_for(lambda _: True, self._sent_s + limit_s - self.now_s())
        if not isinstance(answer, DataFrame):
            sent = f"{len(self._answers.rest)} bytes and no answer '{self._client.answer}'"
            remedy = "let it answer each command, and look whether the hub is on and near"
            raise HubTimeoutError(f"{self.program.name} sent {sent} within {limit_s:g} s; {remedy}")
        self._require_no_more()
        round_trip_s = self.now_s() - self._sent_s
        # A client does not tell the hub's time, so this computer's time stands for it, and the age
        # of an answer is unknown.
        running_s = self.now_s() - self._started_s
        self.statistics.record(round_trip_s, 0.0)
        numbers = struct.unpack(self._client.answer, answer.payload)
        values = tuple(map(float, numbers))
        if not all(map(math.isfinite, values)):
            raise HubProtocolError(
                f"{self.program.name} answers {list(values)}, which are not all numbers; correct it"
            )
        return Reading(values, round(1000 * running_s), round_trip_s)
