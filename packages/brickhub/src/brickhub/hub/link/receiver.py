"""Receiver of the hub program's output: frames, readings, HELLO and BYE, a traceback, and the text between them."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from brickhub.errors import HubError, HubProgramError, HubProtocolError, HubTimeoutError, SilentHubError
from brickhub.hub.link.timing import LinkStatistics
from brickhub.hub.program.run_program import describe_traceback
from brickhub.hub.protocol import PROTOCOL_VERSION, ByeReason, ControlFrame, Frame, FrameDecoder, Up, parse_hello
from brickhub.hub.transport import HubProgram, Transport


@dataclass(frozen=True)
class Reading:
    """One answer of the hub.

    Attributes:
        values: ``[n_channels]``, in channel order and units, rounded to float32.
        hub_time_ms: the hub's clock when it read its sensors, since its program started; it does not wrap.
        round_trip_s: time from the first sending of the command to the first answer.
        age_s: age of the sensor values when the reading was returned; see ``timing.py``.
    """

    values: tuple[float, ...]
    hub_time_ms: int
    round_trip_s: float
    age_s: float = 0.0


def bye_error(bye: ControlFrame) -> SilentHubError:
    """Error for a BYE frame."""
    is_silence = bye.payload[0] == ByeReason.SILENCE
    why = "it had not heard from this computer for too long" if is_silence else "it was told to"
    return SilentHubError(f"the program on the hub ended because {why}; call open() to start it again")


def is_hello(frame: Frame) -> bool:
    """True for a HELLO frame."""
    return isinstance(frame, ControlFrame) and frame.kind == Up.HELLO


def check_hello(hello: ControlFrame, expected_hash: int) -> None:
    """Raise HubProtocolError unless the HELLO has the expected program hash and our protocol version."""
    version, program_hash = parse_hello(hello.payload)
    if version != PROTOCOL_VERSION:
        raise HubProtocolError(
            f"the hub speaks protocol {version}, this computer {PROTOCOL_VERSION}; install one version of brickhub"
        )
    if program_hash != expected_hash:
        raise HubProtocolError(
            f"another program runs on the hub (hash {program_hash:08x}, not {expected_hash:08x}); stop it and open again"
        )


_READS_PER_WAIT = 1000
_CLOCK_TICK_S = 0.001  # tick of a virtual hub: a wait of less than half of it would not advance its clock
_TRACEBACK_READS = 50
_TRACEBACK_PAUSE_S = 0.2


class Listener:
    """Receiver of frames from a transport, which counts invalid bytes in the statistics."""

    def __init__(self, transport: Transport, new_decoder: Callable[[], FrameDecoder], statistics: LinkStatistics) -> None:
        self._transport, self._new_decoder, self._statistics = transport, new_decoder, statistics
        self.begin(HubProgram("", 0))

    def begin(self, program: HubProgram) -> None:
        """Start with a new program: discard all earlier input."""
        self._program = program
        self._decoder = self._new_decoder()
        self._frames: deque[Frame] = deque()

    @property
    def has_frames(self) -> bool:
        """Whether frames have arrived that were not looked at yet."""
        return bool(self._frames)

    def wait_for(self, is_wanted: Callable[[Frame], bool], window_s: float) -> Frame | None:
        """The first wanted frame that comes in time, or has come. The number of reads is bounded too, in case the clock stands
        still."""
        deadline_s = self._transport.now_s() + window_s
        for number in range(_READS_PER_WAIT):
            while self._frames:
                frame = self._frames.popleft()
                if is_wanted(frame):
                    return frame
            remaining_s = deadline_s - self._transport.now_s()
            if remaining_s <= _CLOCK_TICK_S / 2 and number:
                return None
            self._feed(self._transport.read(max(0.0, remaining_s)))
        return None

    def _feed(self, data: bytes) -> None:
        decoder = self._decoder
        crc_errors, skipped_bytes = decoder.crc_errors, decoder.skipped_bytes
        self._frames.extend(decoder.feed(data))
        self._statistics.crc_errors += decoder.crc_errors - crc_errors
        self._statistics.skipped_bytes += decoder.skipped_bytes - skipped_bytes
        if "Traceback" in self._decoder.text:
            with contextlib.suppress(HubError):  # a partial traceback says more than a lost link
                for _ in range(_TRACEBACK_READS):
                    rest = self._transport.read(_TRACEBACK_PAUSE_S)
                    if not rest:
                        break
                    self._decoder.feed(rest)
            raise HubProgramError(describe_traceback(self._decoder.text, self._program.source, self._program.name))

    def raise_program_error(self) -> None:
        """After a failure, raise the error of a traceback or a BYE frame, which says more than the transport's."""
        try:
            self._feed(self._transport.read(0.0))
        except HubProgramError:
            raise
        except HubError:
            return
        for frame in self._frames:
            if isinstance(frame, ControlFrame) and frame.kind == Up.BYE:
                raise bye_error(frame)

    def timeout_error(self, problem: str, waited_s: float) -> HubTimeoutError:
        """Error for a timeout, with the last line that the program printed."""
        printed = self._decoder.text.strip().splitlines()
        last_line = f" (it printed: {printed[-1]})" if printed else ""
        return HubTimeoutError(f"{problem} within {waited_s:g} s{last_line}; check that it is on and near, then call open()")
