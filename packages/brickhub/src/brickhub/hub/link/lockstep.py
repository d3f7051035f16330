"""Lock-step exchange with the program on a hub: one command down, one answer up.

Lost frames: the host repeats the frame, during a step as a keepalive, and when its answer is
overdue (``timing.py``). The hub recognises a repeated sequence number: it resends its last answer,
or continues the current move, so that a command is never carried out twice. Answers to other
sequence numbers are ignored. If no answer comes in time, the link is in FAULT until ``open`` is
called; the hub stops its motors by itself. If the program on the hub has ended because the host was
silent for too long, ``read`` restarts it; ``act`` does not, because the robot has meanwhile stopped
holding its position. ``states.py`` has all transitions as a table.

``emergency_stop`` may be called from any thread. Nothing moves then until ``release``, even if
``open`` is called.
"""

import contextlib
import logging
import math
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator

from brickhub.errors import (
    HubError,
    HubProgramError,
    HubProtocolError,
    HubTimeoutError,
    SilentHubError,
)
from brickhub.hub import protocol
from brickhub.hub.interface import Interface
from brickhub.hub.link.profiles import PAUSE_MS
from brickhub.hub.link.robot_link import Reading, RobotLink, stopped_error
from brickhub.hub.link.states import Cause, LinkState, after
from brickhub.hub.link.timing import REPEATS_PER_WATCHDOG, HubClock, percentile, repeat_times_s
from brickhub.hub.program.generate import WATCHDOG_MS, generate
from brickhub.hub.program.run_program import describe_traceback
from brickhub.hub.transport import HubProgram, Pipe, Transport
from brickhub.robot import Robot

_log = logging.getLogger(__name__)

_HELLOS_PER_TIMEOUT = 4
"""Times that a HELLO is waited for: the one at the program's start, then those on request."""
_EXCHANGES_PER_WATCHDOG_CHECK = 50
_WATCHDOG_ROUND_TRIPS = 4
"""Least watchdog in 99th percentiles of the link's round trips, so that a slow link does not stop
the motors."""
_WATCHDOG_MAX_MS = 0xFFFF
"""Longest watchdog, because its frame carries an unsigned number of 16 bits."""
_READS_PER_WAIT = 1000
_CLOCK_TICK_S = 0.001
"""Tick of a virtual hub: a wait of less than half of it would not advance its clock."""
_TRACEBACK_READS = 50
"""Largest number of reads for the rest of a traceback."""
_TRACEBACK_PAUSE_S = 0.2
"""Silence after which a traceback is complete: it comes in notifications of 19 bytes."""


class HubLink(RobotLink):
    """Link to one robot, over any transport. Use it as a context manager: leaving stops the robot.

    Args:
        transport: transport to the hub; the link opens and closes it.
        robot, interface: robot and interface that the hub's program is generated from.
        timeout_s: time limit of an answer, beyond the duration of the commands.
        watchdog_s: silence after which the hub stops its motors; raised to four times the 99th
            percentile of the link's round trips if that is more.
        pipe: channel for input to the program.
        calibrate: applies the robot's calibration to the description; called when the hub is
            connected.

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
        pipe: Pipe = Pipe.STDIN,
        calibrate: Callable[[Robot], Robot] | None = None,
    ) -> None:
        super().__init__(WATCHDOG_MS / 1000)
        self._robot = robot
        self._interface = interface
        self._pipe = pipe
        self._calibrate = calibrate
        self.program = self._program_of(robot)
        self.wire = protocol.WireFormat(interface, robot)
        # These channels have been reported as saturated, which is done only once.
        self._saturated = set[str]()
        self._transport = transport
        self._transport_is_open = False
        self._has_started = False
        self._timeout_s = timeout_s
        # A program says HELLO only when all of its devices are set up, and a remote may take 10 s.
        longest_setup_s = max(channel.setup_s for channel in interface.channels)
        self._start_s = timeout_s + longest_setup_s
        settle = interface.settle
        self._longest_move_s = settle.longest_ms / 1000
        self._known_move_s = None if settle.fixed_ms is None else self._longest_move_s
        self._least_watchdog_ms = _watchdog_ms(watchdog_s)
        # The link changes this time once the program runs, so it begins with that of the program.
        self._watchdog_ms = WATCHDOG_MS
        self._seq = 0
        self._frame = b""
        self._sent_s = 0.0
        self._written_s = -math.inf
        self._clock = HubClock()
        self._begin_to_listen()

    def _program_of(self, robot: Robot) -> HubProgram:
        """Hook: the hub's program."""
        return generate(robot, self._interface, self._pipe)

    def _begin_to_listen(self) -> None:
        """Start with a new program: discard all earlier input."""
        self._decoder = self._new_decoder()
        self._frames: deque[protocol.Frame] = deque()

    def _new_decoder(self) -> protocol.FrameDecoder:
        """Hook: what finds the answers in the program's output."""
        return protocol.FrameDecoder(self.wire.answer_bytes, protocol.UP_PAYLOAD_BYTES)

    def open(self) -> None:
        """Connect, start the program and wait for its HELLO. Also leaves FAULT; without effect on
        an open link.

        Raises:
            HubError: the hub cannot be reached.
            HubProtocolError: another program answers.
            HubTimeoutError: no program answers.
            HubProgramError: the program raised at its start, for example because a device is not
                plugged in.
            StoppedError: an emergency stop came before or meanwhile.
        """
        self._check_halted()
        if self.is_open:
            return
        with self._fault():
            if not self._transport_is_open:
                self._transport.open()
                # A calibration belongs to a hub, whose address is known from here on.
                if self._calibrate is not None:
                    calibrated = self._calibrate(self._robot)
                    self.program = self._program_of(calibrated)
                self._transport_is_open = True
            self._start_program()

    def read(self) -> Reading:
        """Read the sensors without moving. Restarts the program if it ended by itself.

        Raises:
            HubError: the link is not open, or failed.
            HubTimeoutError: no answer came.
            HubProgramError: the program raised.
        """
        try:
            return self._read()
        except SilentHubError:
            _log.info("the program on the hub had ended; starting it again")
            self.open()
            return self._read()

    def act(self, values: Iterable[float]) -> Reading:
        """Carry out the commands ``[n_commands]``, in their units, and read the channels when they
        have settled.

        Raises:
            EncodingError: the wrong number of values, or one that is not a number; nothing was
                sent.
            HubError: the link is not open, or failed, or the program on the hub has ended.
            HubTimeoutError: no answer came; whether the robot moved is unknown.
            HubProgramError: the program raised.
            StoppedError: an emergency stop came before or meanwhile.
        """
        self.send(values)
        return self.receive()

    def send(self, values: Iterable[float]) -> None:
        """Send the commands ``[n_commands]``, in their units; `receive` then waits for the answer.
        So several robots move at the same time. Raises as `act`, except for timeouts."""
        self._frame = self._next_frame(values)
        with self._fault_with_cause():
            self._send(self._frame)

    def receive(self) -> Reading:
        """Wait for the answer to the commands that were sent last. Raises as `act`."""
        with self._fault_with_cause():
            return self._receive(self._frame, self._longest_move_s, self._known_move_s)

    def _next_frame(self, values: Iterable[float]) -> bytes:
        """Frame of the next commands. Raises the errors of `act` that come before anything is
        sent."""
        payload = self.wire.encode_actions(values)
        self._require_open()
        self._seq = protocol.next_seq(self._seq)
        # The state changes before the frame is sent: even if sending fails, the hub may have got it
        # and move.
        self.state = after(self.state, Cause.ACTED)
        return protocol.data_frame(self._seq, payload)

    def rest(self) -> None:
        """Stop the motors; the program keeps running, in READY. For a pause, in which ``read``
        keeps the program alive.

        Raises:
            HubError: the link is not open, or failed; the hub's watchdog then stops the motors.
            StoppedError: as ``act``.
        """
        self._require_open()
        with self._fault():
            # A HELLO request makes the hub stop its motors and forget its sequence number.
            self._request_hello()
            self._seq = 0
            self._begin()
            self.state = after(self.state, Cause.RESTED)

    def emergency_stop(self) -> None:
        """Stop motors and program at once, from any thread; a call that waits for an answer raises
        ``StoppedError``. Raises HubError if the hub could not be reached; its watchdog then stops
        the motors.

        All later calls raise ``StoppedError`` until ``release``.
        """
        # This is set first, so that a thread that waits for an answer finds the reason when it is
        # woken.
        self._halted.set()
        self._transport.stop()

    def now_s(self) -> float:
        """Time of the transport's clock: the computer's, or the simulated one."""
        return self._transport.now_s()

    def stop(self) -> None:
        """Stop the motors and the program. ``open`` starts it again. Raises HubError if the
        transport failed; the hub's watchdog then stops the motors."""
        if self.state is LinkState.DISCONNECTED:
            return
        # No command may follow, even if the transport fails to stop the hub.
        self.state = after(self.state, Cause.STOPPED)
        self._transport.stop()

    def close(self) -> None:
        """Stop the program and disconnect. May be called in any state and repeatedly, and never
        raises."""
        for name, step in (("stop", self.stop), ("disconnect", self._transport.close)):
            try:
                step()
            # Closing must go on whatever a transport raises, because the hub stops by itself.
            except Exception as error:  # noqa: BLE001
                # The trace of an error that is not one of ours points to a bug.
                is_ours = isinstance(error, HubError)
                _log.warning(
                    "closing the link to the hub: could not %s (%s)",
                    name,
                    error,
                    exc_info=not is_ours,
                )
        self._transport_is_open = False
        self._has_started = False
        self.state = after(self.state, Cause.STOPPED)

    def _run_program(self) -> None:
        """Start the program, after the end of one that runs. Raises StoppedError if an emergency
        stop came meanwhile."""
        self._begin_to_listen()
        if self._has_started:
            # If the hub is out of reach, the start will raise a better error.
            with contextlib.suppress(HubError):
                self._transport.stop()
        self._transport.start(self.program)
        self._has_started = True
        # An emergency stop during the start may have stopped only the program before this one.
        if self._halted.is_set():
            self._transport.stop()
            raise stopped_error()

    def _start_program(self) -> None:
        self._run_program()
        # These belong to one program, so a new one begins with a new clock, new sequence numbers
        # and a new watchdog.
        self._clock = HubClock()
        self._seq = 0
        self._watchdog_ms = WATCHDOG_MS
        self.statistics.watchdog_s = WATCHDOG_MS / 1000
        # The HELLO that the program sends at its start may get lost, and then one is requested.
        hello = self._receive_hello() or self._request_hello()
        check_hello(hello, self.program.hash)
        # After a reconnection the round trips of the link are already known.
        watchdog_ms = self._needed_watchdog_ms()
        if watchdog_ms != WATCHDOG_MS:
            self._set_watchdog(watchdog_ms)
        self._begin()
        self.state = after(self.state, Cause.OPENED)

    def _begin(self) -> None:
        """Hook: set up a program that has just sent its HELLO."""

    def _receive_hello(self) -> protocol.ControlFrame | None:
        """A HELLO, if it comes in its share of the time for the start."""
        frame = self._wait_for(_is_hello, self._start_s / _HELLOS_PER_TIMEOUT)
        return frame if isinstance(frame, protocol.ControlFrame) else None

    def _request_hello(self) -> protocol.ControlFrame:
        """Request a HELLO, on which the hub stops its motors, until it comes."""
        for _ in range(_HELLOS_PER_TIMEOUT - 1):
            self._write(protocol.control_frame(protocol.Down.HELLO))
            hello = self._receive_hello()
            if hello is not None:
                return hello
        raise self._timeout_error("the program did not say hello", self._start_s)

    def _read(self) -> Reading:
        self._require_open()
        self._seq = protocol.next_seq(self._seq)
        frame = protocol.control_frame(protocol.Down.READ, bytes((self._seq,)))
        with self._fault_with_cause():
            self._send(frame)
            return self._receive(frame, 0.0, 0.0)

    def _send(self, frame: bytes) -> None:
        """Send a frame; `_receive` then waits for its answer."""
        self._adapt_watchdog()
        self._sent_s = self.now_s()
        self._write(frame)

    def _write(self, frame: bytes) -> None:
        """Write a frame, and time the round trip of its acknowledgement, which after a pause is
        longer but then keeps no motor waiting."""
        started_s = self.now_s()
        before_s = self._written_s
        self._transport.write(frame)
        self._written_s = self.now_s()
        if started_s - before_s < PAUSE_MS / 1000:
            self.statistics.delays_s.append(self._written_s - started_s)

    def _receive(
        self,
        frame: bytes,
        longest_move_s: float,
        known_move_s: float | None,
    ) -> Reading:
        """Wait for the answer to a frame that was sent, and repeat it meanwhile. Raises
        HubTimeoutError if none comes in time.

        Most keepalives of a long step tell the watchdog's time instead, which the hub may not have
        heard, and ask for no answer.
        """
        limit_s = longest_move_s + self._timeout_s
        watchdog_s = self._watchdog_ms / 1000
        due_s = longest_move_s if known_move_s is None else known_move_s
        for number, time_s in enumerate(repeat_times_s(known_move_s, watchdog_s)):
            wake_s = self._sent_s + min(time_s, limit_s)
            answer = self._wait_for(self._is_answer, wake_s - self.now_s())
            if isinstance(answer, protocol.DataFrame):
                # A hub reads its sensors at the end of a step if its time is known, and at any time
                # otherwise.
                self._compare_clocks(answer, self._sent_s + (known_move_s or 0.0))
                reading = self._reading(answer, self.now_s() - self._sent_s)
                self.statistics.record(reading.round_trip_s, reading.age_s)
                return reading
            waited_s = self.now_s() - self._sent_s
            # Planned times count as well, in case the clock stands still.
            if max(time_s, waited_s) >= limit_s:
                break
            is_overdue = time_s > due_s
            self.statistics.resends += is_overdue
            # Sometimes the command itself is repeated, because the command may be what was lost.
            repeats_command = is_overdue or number % REPEATS_PER_WATCHDOG == 0
            self._write(frame if repeats_command else _watchdog_frame(self._watchdog_ms))
        raise self._timeout_error("the hub did not answer", limit_s)

    def _compare_clocks(
        self,
        answer: protocol.DataFrame,
        not_before_s: float,
    ) -> None:
        """Compare the clocks by an answer that has just arrived; its sensors were read after
        ``not_before_s``."""
        wrapped_ms = self.wire.hub_time_ms(answer.payload)
        time_ms = self._clock.unwrap(wrapped_ms)
        self._clock.compare(time_ms, not_before_s, self.now_s())

    def _reading(
        self,
        answer: protocol.DataFrame,
        round_trip_s: float,
    ) -> Reading:
        """Reading from the newest answer, as old as it is now."""
        wrapped_ms, values = self.wire.decode_answer(answer.payload)
        for name in self.wire.saturated(answer.payload):
            # Each channel is named once, because it stays at its end for many steps.
            if name not in self._saturated:
                self._saturated.add(name)
                _log.warning(
                    "the channel '%s' is beyond what 16 bits carry, and stays at their end; give "
                    "it a smaller scale",
                    name,
                )
        time_ms = self._clock.unwrap(wrapped_ms)
        age_s = self._clock.age_s(time_ms, self.now_s())
        return Reading(
            values,
            time_ms,
            round_trip_s,
            age_s,
        )

    @contextlib.contextmanager
    def _fault_with_cause(self) -> Iterator[None]:
        """``_fault`` that prefers the program's traceback or BYE to the error of the transport."""
        with self._fault():
            try:
                yield
            except (SilentHubError, HubProgramError):
                raise
            except HubError:
                self._raise_program_error()
                raise

    def _is_answer(self, frame: protocol.Frame) -> bool:
        if isinstance(frame, protocol.ControlFrame):
            if frame.kind == protocol.Up.BYE:
                raise bye_error(frame)
            return False
        # A frame that is repeated while its answer is on the way gets two answers.
        self.statistics.stale_answers += frame.seq != self._seq
        return frame.seq == self._seq

    def _adapt_watchdog(self) -> None:
        """Set the watchdog by the measured round trips, before an exchange: at once if one took
        long, and from time to time."""
        delays_s = self.statistics.delays_s
        is_slow = False
        if delays_s:
            last_needs_ms = _watchdog_ms(_WATCHDOG_ROUND_TRIPS * delays_s[-1])
            is_slow = last_needs_ms > self._watchdog_ms
        is_time_to_check = self.statistics.exchanges % _EXCHANGES_PER_WATCHDOG_CHECK == 0
        if not (is_slow or is_time_to_check):
            return
        needed_ms = self._needed_watchdog_ms()
        # The watchdog is raised at once, but lowered only if half of it would do: each change costs
        # one more write before a step.
        is_right = self._watchdog_ms / 2 <= needed_ms <= self._watchdog_ms
        if not is_right:
            self._set_watchdog(needed_ms)

    def _needed_watchdog_ms(self) -> int:
        p99_delay_s = percentile(self.statistics.delays_s, 99)
        return max(self._least_watchdog_ms, _watchdog_ms(_WATCHDOG_ROUND_TRIPS * p99_delay_s))

    def _set_watchdog(self, watchdog_ms: int) -> None:
        self._write(_watchdog_frame(watchdog_ms))
        self._watchdog_ms = watchdog_ms
        self.statistics.watchdog_s = watchdog_ms / 1000

    def _wait_for(
        self,
        is_wanted: Callable[[protocol.Frame], bool],
        window_s: float,
    ) -> protocol.Frame | None:
        """The first wanted frame that comes in time, or has come. The number of reads is bounded
        too, in case the clock stands still."""
        deadline_s = self._transport.now_s() + window_s
        for number in range(_READS_PER_WAIT):
            while self._frames:
                frame = self._frames.popleft()
                if is_wanted(frame):
                    return frame
            remaining_s = deadline_s - self._transport.now_s()
            # Bytes may already have come when the time is up, so there is at least one read.
            if remaining_s <= _CLOCK_TICK_S / 2 and number:
                return None
            self._feed(self._transport.read(max(0.0, remaining_s)))
        return None

    def _feed(self, data: bytes) -> None:
        """Take bytes, and count the invalid ones. Raises HubProgramError for a traceback among
        them."""
        decoder = self._decoder
        # A decoder counts from the start of its program, but the statistics from that of the link.
        crc_errors_before = decoder.crc_errors
        skipped_bytes_before = decoder.skipped_bytes
        self._frames.extend(decoder.feed(data))
        self.statistics.crc_errors += decoder.crc_errors - crc_errors_before
        self.statistics.skipped_bytes += decoder.skipped_bytes - skipped_bytes_before
        if "Traceback" not in decoder.text:
            return
        # The rest of the traceback is on the way, and even a part of one says more than a lost
        # link.
        with contextlib.suppress(HubError):
            for _ in range(_TRACEBACK_READS):
                rest = self._transport.read(_TRACEBACK_PAUSE_S)
                if not rest:
                    break
                decoder.feed(rest)
        raise HubProgramError(
            describe_traceback(decoder.text, self.program.source, self.program.name)
        )

    def _raise_program_error(self) -> None:
        """Raise the error of a traceback or a BYE frame, after a failure of the transport, whose
        own error says less."""
        try:
            self._feed(self._transport.read(0.0))
        except HubProgramError:
            raise
        except HubError:
            # The transport fails again, but has nothing to add to its first error.
            return
        for frame in self._frames:
            if isinstance(frame, protocol.ControlFrame) and frame.kind == protocol.Up.BYE:
                raise bye_error(frame)

    def _timeout_error(
        self,
        problem: str,
        waited_s: float,
    ) -> HubTimeoutError:
        """Error for a timeout, with the last line that the program printed."""
        printed = self._decoder.text.strip().splitlines()
        last_line = f" (it printed: {printed[-1]})" if printed else ""
        return HubTimeoutError(
            f"{problem} within {waited_s:g} s{last_line}; check that it is on and near, then "
            "call open()"
        )


def bye_error(bye: protocol.ControlFrame) -> SilentHubError:
    """Error for a BYE frame."""
    is_silence = bye.payload[0] == protocol.ByeReason.SILENCE
    why = "it had not heard from this computer for too long" if is_silence else "it was told to"
    return SilentHubError(
        f"the program on the hub ended because {why}; call open() to start it again"
    )


def check_hello(hello: protocol.ControlFrame, expected_hash: int) -> None:
    """Raise HubProtocolError unless the HELLO has the expected program hash and our protocol
    version."""
    version, program_hash = protocol.parse_hello(hello.payload)
    if version != protocol.PROTOCOL_VERSION:
        raise HubProtocolError(
            f"the hub speaks protocol {version}, this computer {protocol.PROTOCOL_VERSION}; "
            "install one version of brickhub"
        )
    if program_hash != expected_hash:
        raise HubProtocolError(
            f"another program runs on the hub (hash {program_hash:08x}, not {expected_hash:08x}); "
            "stop it and open again"
        )


def _is_hello(frame: protocol.Frame) -> bool:
    return isinstance(frame, protocol.ControlFrame) and frame.kind == protocol.Up.HELLO


def _watchdog_frame(watchdog_ms: int) -> bytes:
    return protocol.control_frame(protocol.Down.WATCHDOG, struct.pack("<H", watchdog_ms))


def _watchdog_ms(seconds: float) -> int:
    # A watchdog of 0 would stop the motors at once.
    return max(1, min(_WATCHDOG_MAX_MS, round(seconds * 1000)))
