"""Lock-step exchange with the program on a hub: one command goes down, one answer comes up.

What happens when something is lost. The host sends the same frame again after a quarter of its timeout. The hub knows
a sequence number that comes again: it sends its last answer again, or goes on with the move that is under way, so
a command is never carried out twice. Answers to other sequence numbers are ignored. When nothing came in time, the
link is in FAULT until ``open`` is called; the hub stops its motors by itself.
When the host has been silent for so long that the program on the hub ended, ``read`` starts it again; ``act`` does
not, because the robot has let go of its position in the meantime.

``emergency_stop`` may be called from any thread. Nothing moves then until ``release``, whoever calls ``open`` meanwhile.
"""

from __future__ import annotations

import contextlib
import logging
import struct
import threading
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bricksrl.errors import HubError, HubProgramError, HubTimeoutError
from bricksrl.hub.interface import Interface, UntilDone
from bricksrl.hub.program import WATCHDOG_MS, generate
from bricksrl.hub.protocol import (
    UP_PAYLOAD_BYTES,
    ControlFrame,
    DataFrame,
    Down,
    Frame,
    FrameDecoder,
    Up,
    WireFormat,
    control_frame,
    data_frame,
    next_seq,
)
from bricksrl.hub.states import LinkState, ProgramEndedError, Reading, check_hello, is_hello, program_ended, stopped
from bricksrl.hub.statistics import LinkMeter, LinkStatistics
from bricksrl.hub.traceback import describe_traceback
from bricksrl.hub.transport import Transport
from bricksrl.robots import Robot

_log = logging.getLogger(__name__)

_SENDS_PER_TIMEOUT = 4
_READS_PER_SEND = 1000
_TRACEBACK_READS = 50
_TRACEBACK_PAUSE_S = 0.2
_EXCHANGES_PER_WATCHDOG_CHECK = 50
_WATCHDOG_ROUND_TRIPS = 4
_WATCHDOG_MAX_MS = 0xFFFF


class HubLink:
    """The link to one robot, over any transport. Use it as a context manager: leaving stops the robot.

    Args:
        transport: the hub; the link opens and closes it.
        robot, interface: what is at the other end; the hub's program is made from them.
        timeout_s: how long an answer may take beyond the time that the commands themselves take.
        watchdog_s: silence after which the hub stops its motors; grows to four times the slowest hundredth of the
            link's delays where that is more.
        calibrate: turns the description into that of the robot at hand; called when the hub is connected.

    Raises:
        DescriptionError, ProgramError: see ``generate``.
    """

    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        interface: Interface,
        *,
        timeout_s: float = 5.0,
        watchdog_s: float = WATCHDOG_MS / 1000,
        calibrate: Callable[[Robot], Robot] | None = None,
    ) -> None:
        self._robot, self._interface, self._calibrate = robot, interface, calibrate
        self.program = generate(robot, interface)
        self.wire = WireFormat.of(interface)
        self.state = LinkState.DISCONNECTED
        self._transport = transport
        self._transport_is_open = False
        self._has_started = False
        self._halted = threading.Event()
        self._timeout_s = timeout_s
        settle = interface.settle
        self._longest_move_s = (settle.timeout_ms if isinstance(settle, UntilDone) else settle.time_ms) / 1000
        self._known_move_s = None if isinstance(settle, UntilDone) else self._longest_move_s
        self._least_watchdog_ms = _watchdog_ms(watchdog_s)
        self._watchdog_ms = WATCHDOG_MS
        self._seq = 0
        self._decoder = self._new_decoder()
        self._frames: deque[Frame] = deque()
        self._hub_time_ms: int | None = None
        self._meter = LinkMeter()

    def open(self) -> None:
        """Connect, start the program and hear its HELLO. Also the way out of FAULT, and without effect when all is well.

        Raises:
            HubError: the hub cannot be reached.
            HubProtocolError: another program than ours answers.
            HubTimeoutError: none answers.
            HubProgramError: ours raised at its start, for example because a device is not plugged in.
            StoppedError: the robot was stopped by hand, before or meanwhile.
        """
        self._check_halted()
        if self.is_open:
            return
        if not self._transport_is_open:
            self._transport.open()
            self._transport_is_open = True
            if self._calibrate is not None:
                self.program = generate(self._calibrate(self._robot), self._interface)
        self._start_program()

    @property
    def is_open(self) -> bool:
        """Whether the program answers, as far as is known."""
        return self.state in (LinkState.READY, LinkState.ARMED)

    def read(self) -> Reading:
        """The sensors, without moving anything. Starts the program again where it ended by itself.

        Raises:
            HubError: the link is not open, or failed.
            HubTimeoutError: no answer came.
            HubProgramError: the program raised.
        """
        try:
            return self._read()
        except ProgramEndedError:
            _log.info("the program on the hub had ended; starting it again")
            self._start_program()
            return self._read()

    def act(self, values: Sequence[float] | NDArray[np.floating]) -> Reading:
        """Carry out the commands ``[n_commands]``, in their units, and read the channels when they have settled.

        Raises:
            EncodingError: the wrong number of values, or one that is not a number; nothing was sent.
            HubError: the link is not open, or failed, or the program on the hub has ended.
            HubTimeoutError: no answer came; whether the robot moved is unknown.
            HubProgramError: the program raised.
            StoppedError: the robot was stopped by hand, before or meanwhile.
        """
        payload = self.wire.encode_actions(values)
        self._require_open()
        self._seq = next_seq(self._seq)
        self.state = LinkState.ARMED
        return self._exchange(data_frame(self._seq, payload), self._longest_move_s, self._known_move_s)

    def rest(self) -> None:
        """Stop the motors; the program goes on, and is READY. For a pause, in which ``read`` keeps the program alive.

        Raises:
            HubError: the link is not open, or failed; the hub's watchdog then stops the motors.
            StoppedError: as ``act``.
        """
        self._require_open()
        try:
            self._say_hello()
        except HubError as error:
            self._fail(error)
            raise
        self._seq = 0
        self.state = LinkState.READY

    def emergency_stop(self) -> None:
        """Stop motors and program at once, from any thread; whoever waits for an answer gets a ``StoppedError``.

        Everything raises ``StoppedError`` from now on, until ``release``.

        Raises:
            HubError: the hub could not be told; its watchdog then stops the motors.
        """
        self._halted.set()
        self._transport.stop()

    def release(self) -> None:
        """After an emergency stop: ``open`` starts the program again."""
        if self._halted.is_set() and self.is_open:
            self.state = LinkState.FAULT
        self._halted.clear()

    def now_s(self) -> float:
        """The transport's clock: the computer's, or the simulated one."""
        return self._transport.now_s()

    def stop(self) -> None:
        """Stop the motors and the program. ``open`` starts it again.

        Raises:
            HubError: the transport could not do it; the hub's watchdog then does.
        """
        if self.state is LinkState.DISCONNECTED:
            return
        self.state = LinkState.DISCONNECTED
        self._transport.stop()

    def close(self) -> None:
        """Stop the program and disconnect. May be called in any state, twice too, and never raises."""
        for name, step in (("stop", self.stop), ("disconnect", self._transport.close)):
            try:
                step()
            except Exception:  # noqa: BLE001  closing goes on, and the hub stops by itself
                _log.warning("closing the link to the hub: could not %s", name, exc_info=True)
        self._transport_is_open = self._has_started = False
        self.state = LinkState.DISCONNECTED

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def statistics(self) -> LinkStatistics:
        """A snapshot."""
        return self._meter.snapshot(self._watchdog_ms / 1000)

    def _new_decoder(self) -> FrameDecoder:
        return FrameDecoder(self.wire.answer_bytes, UP_PAYLOAD_BYTES)

    def _check_halted(self) -> None:
        if self._halted.is_set():
            raise stopped()

    def _fail(self, error: HubError) -> None:
        """The link is not usable any more. Raises StoppedError where that is no failure, but what a human wanted."""
        self.state = LinkState.FAULT
        if self._halted.is_set():
            raise stopped() from error

    def _require_open(self) -> None:
        self._check_halted()
        if self.state is LinkState.FAULT:
            raise HubError("the link failed before; call open() to start it again")
        if self.state is LinkState.DISCONNECTED:
            raise HubError("the link is not open; call open() first")

    def _start_program(self) -> None:
        self.state = LinkState.FAULT
        self._decoder = self._new_decoder()
        self._frames.clear()
        self._hub_time_ms = None
        self._seq = 0
        self._watchdog_ms = WATCHDOG_MS
        if self._has_started:
            with contextlib.suppress(HubError):  # what has to be stopped may be out of reach, which the start will tell
                self._transport.stop()
        try:
            self._transport.start(self.program)
            self._has_started = True
            if self._halted.is_set():  # meanwhile, so that it may have stopped what was before
                self._transport.stop()
                raise stopped()
            self._expect_hello()
            if self._least_watchdog_ms != WATCHDOG_MS:
                self._set_watchdog(self._least_watchdog_ms)
        except HubError as error:
            self._fail(error)
            raise
        self.state = LinkState.READY

    def _expect_hello(self) -> None:
        """Wait for the HELLO that the program sends at its start, and ask for it where it does not come."""
        hello = self._hear_hello() or self._say_hello()
        check_hello(hello, self.program.hash)

    def _hear_hello(self) -> ControlFrame | None:
        frame = self._wait_for(is_hello, self._timeout_s / _SENDS_PER_TIMEOUT)
        return frame if isinstance(frame, ControlFrame) else None

    def _say_hello(self) -> ControlFrame:
        """Ask for a HELLO, with which the hub stops its motors, until it comes."""
        for _ in range(_SENDS_PER_TIMEOUT - 1):
            self._transport.write(control_frame(Down.HELLO))
            hello = self._hear_hello()
            if hello is not None:
                return hello
        raise HubTimeoutError(self._silence("the program did not say hello", self._timeout_s))

    def _read(self) -> Reading:
        self._require_open()
        self._seq = next_seq(self._seq)
        return self._exchange(control_frame(Down.READ, bytes((self._seq,))), 0.0, 0.0)

    def _exchange(self, frame: bytes, longest_move_s: float, known_move_s: float | None) -> Reading:
        """Send until the answer comes; the same frame may go out several times."""
        try:
            self._adapt_watchdog()
            started_s, resends = self._transport.now_s(), self._meter.resends
            answer = self._send_and_wait(frame, started_s + longest_move_s + self._timeout_s)
            if answer is None:
                raise HubTimeoutError(self._silence("the hub did not answer", longest_move_s + self._timeout_s))
            round_trip_s = self._transport.now_s() - started_s
            time_ms, values = self.wire.decode_answer(answer.payload)
        except HubError as error:
            self._fail(error)
            if not isinstance(error, (ProgramEndedError, HubProgramError)):
                self._look_for_last_words()
            raise
        # Waiting for what was lost is no delay of the link: counted, it would make the watchdog wait for ever longer.
        self._meter.record(round_trip_s, known_move_s if self._meter.resends == resends else None)
        return Reading(values, self._unwrap(time_ms), round_trip_s)

    def _send_and_wait(self, frame: bytes, deadline_s: float) -> DataFrame | None:
        window_s = self._timeout_s / _SENDS_PER_TIMEOUT
        sends = int((deadline_s - self._transport.now_s()) / window_s) + 1
        for attempt in range(sends):
            self._meter.resends += attempt > 0
            self._transport.write(frame)
            answer = self._wait_for(self._is_answer, min(window_s, deadline_s - self._transport.now_s()))
            if isinstance(answer, DataFrame):
                return answer
        return None

    def _is_answer(self, frame: Frame) -> bool:
        if isinstance(frame, ControlFrame):
            if frame.kind == Up.BYE:
                raise program_ended(frame)
            return False
        self._meter.stale_answers += frame.seq != self._seq
        return frame.seq == self._seq

    def _wait_for(self, is_wanted: Callable[[Frame], bool], window_s: float) -> Frame | None:
        """The first wanted frame that comes in time. Bounded in reads too, should the transport's clock stand still."""
        deadline_s = self._transport.now_s() + window_s
        for _ in range(_READS_PER_SEND):
            while self._frames:
                frame = self._frames.popleft()
                if is_wanted(frame):
                    return frame
            remaining_s = deadline_s - self._transport.now_s()
            if remaining_s <= 0:
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
            with contextlib.suppress(HubError):  # what there is of the traceback tells more than the end of the link
                for _ in range(_TRACEBACK_READS):
                    rest = self._transport.read(_TRACEBACK_PAUSE_S)
                    if not rest:
                        break
                    self._decoder.feed(rest)
            raise HubProgramError(describe_traceback(self._decoder.text, self.program.source))

    def _look_for_last_words(self) -> None:
        """After a failure: a program that raised or said good-bye explains it better than the transport can."""
        try:
            self._feed(self._transport.read(0.0))
        except HubProgramError:
            raise
        except HubError:
            return
        for frame in self._frames:
            if isinstance(frame, ControlFrame) and frame.kind == Up.BYE:
                raise program_ended(frame)

    def _silence(self, what: str, waited_s: float) -> str:
        said = self._decoder.text.strip().splitlines()
        last_line = f" (it printed: {said[-1]})" if said else ""
        return f"{what} within {waited_s:g} s{last_line}; check that it is on and near, then call open()"

    def _unwrap(self, time_ms: int) -> int:
        """The hub's clock without its wraps; answers are never a whole wrap (65.5 s) apart unless the program ended."""
        if self._hub_time_ms is None:
            self._hub_time_ms = time_ms
        else:
            self._hub_time_ms += (time_ms - self._hub_time_ms) & 0xFFFF
        return self._hub_time_ms

    def _adapt_watchdog(self) -> None:
        if self._meter.exchanges % _EXCHANGES_PER_WATCHDOG_CHECK:
            return
        needed_ms = _watchdog_ms(_WATCHDOG_ROUND_TRIPS * self._meter.delay_p99_s())
        if needed_ms > self._watchdog_ms:
            self._set_watchdog(needed_ms)

    def _set_watchdog(self, watchdog_ms: int) -> None:
        self._transport.write(control_frame(Down.WATCHDOG, struct.pack("<H", watchdog_ms)))
        self._watchdog_ms = watchdog_ms


def _watchdog_ms(seconds: float) -> int:
    return max(1, min(_WATCHDOG_MAX_MS, round(seconds * 1000)))
