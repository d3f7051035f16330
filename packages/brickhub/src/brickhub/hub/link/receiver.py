"""Receiver of the hub program's output: frames, a traceback, BYE frames, and the text between them."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable

from brickhub.errors import HubError, HubProgramError, HubTimeoutError
from brickhub.hub.link.reading import bye_error
from brickhub.hub.link.statistics import LinkMeter
from brickhub.hub.program.traceback import describe_traceback
from brickhub.hub.protocol import UP_PAYLOAD_BYTES, ControlFrame, Frame, FrameDecoder, Up, WireFormat
from brickhub.hub.transport import Transport

_READS_PER_WAIT = 1000
_CLOCK_TICK_S = 0.001  # tick of a virtual hub: a wait of less than half of it would not advance its clock
_TRACEBACK_READS = 50
_TRACEBACK_PAUSE_S = 0.2


class Listener:
    """Receiver of frames from a transport, which counts invalid bytes in the meter."""

    def __init__(self, transport: Transport, wire: WireFormat, meter: LinkMeter) -> None:
        self._transport, self._wire, self._meter = transport, wire, meter
        self.begin("")

    def begin(self, source: str) -> None:
        """Start with a new program: discard all earlier input."""
        self._source = source
        self._decoder = FrameDecoder(self._wire.answer_bytes, UP_PAYLOAD_BYTES)
        self._frames: deque[Frame] = deque()

    @property
    def has_frames(self) -> bool:
        """Whether frames have arrived that were not looked at yet."""
        return bool(self._frames)

    def wait_for(self, is_wanted: Callable[[Frame], bool], window_s: float) -> Frame | None:
        """The first wanted frame that comes in time. The number of reads is bounded too, in case the clock stands still."""
        deadline_s = self._transport.now_s() + window_s
        for _ in range(_READS_PER_WAIT):
            while self._frames:
                frame = self._frames.popleft()
                if is_wanted(frame):
                    return frame
            remaining_s = deadline_s - self._transport.now_s()
            if remaining_s <= _CLOCK_TICK_S / 2:
                return None
            self._feed(self._transport.read(remaining_s))
        return None

    def _feed(self, data: bytes) -> None:
        decoder = self._decoder
        crc_errors, skipped_bytes = decoder.crc_errors, decoder.skipped_bytes
        self._frames.extend(decoder.feed(data))
        self._meter.crc_errors += decoder.crc_errors - crc_errors
        self._meter.skipped_bytes += decoder.skipped_bytes - skipped_bytes
        if "Traceback" in self._decoder.text:
            with contextlib.suppress(HubError):  # a partial traceback says more than a lost link
                for _ in range(_TRACEBACK_READS):
                    rest = self._transport.read(_TRACEBACK_PAUSE_S)
                    if not rest:
                        break
                    self._decoder.feed(rest)
            raise HubProgramError(describe_traceback(self._decoder.text, self._source))

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
