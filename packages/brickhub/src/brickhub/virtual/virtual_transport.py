"""Transport to a virtual hub, which runs a LEGO hub's program on a body in simulated time.

The program is a greenlet that runs only while the host waits: no threads, reproducible runs. Bytes
travel as the profile of the body's link says: at connection events, as over Bluetooth.
"""

import itertools
import math
import sys
import threading
from collections import deque
from collections.abc import Callable

from greenlet import GreenletExit, getcurrent, greenlet

from brickhub.errors import HubError, HubProgramError, ProgramStoppedError, TwinError
from brickhub.hub.link.profiles import LinkProfile
from brickhub.hub.program.run_program import describe_traceback
from brickhub.hub.transport import HubProgram, Pipe, app_data_slot
from brickhub.virtual import interpreter
from brickhub.virtual.body import Body, Rng
from brickhub.virtual.link_radio import PLACEMENT_MS, Radio
from brickhub.virtual.machine import MAX_STEP_MS, Machine, Pace
from brickhub.virtual.micropython.exceptions import HostStop, SwitchedOff, is_program_error
from brickhub.virtual.micropython.text import format_traceback
from brickhub.virtual.pybricks import modules

MAX_WRITE_BYTES = 20
"""Largest write over Bluetooth without a larger MTU."""
_LONGEST_RUN_DOWN_MS = 1000
_AT_REST_MDEG = 50
"""Change of an angle in `MAX_STEP_MS` that nobody sees: some 3 degrees a second."""


class _Stopped(HostStop):
    """Thrown into a program to stop it."""


class _Wire:
    """Standard streams of the program, with bytes in transit to the host."""

    def __init__(self, hub: "VirtualHub") -> None:
        model = hub.robot.hub.model
        self._hub = hub
        self._capacity = model.stdin_bytes
        if hub.machine.firmware.takes_packets:
            self._capacity = max(model.stdin_bytes, model.packet_bytes)
        self._stdin = bytearray()
        self.inbox = bytearray()
        self.outbox: deque[tuple[float, bytes]] = deque()

    def available(self) -> int:
        return len(self._stdin)

    def read(self, n: int) -> bytes:
        # Time has to pass, so that the host's bytes can arrive.
        while len(self._stdin) < n:
            self._hub.machine.advance(1)
        data = bytes(self._stdin[:n])
        del self._stdin[:n]
        return data

    def write(self, data: bytes) -> None:
        self._hub.machine.charge_call()
        # The program never learns that its packet was lost.
        if self._hub.radio.loses_notification(self._hub.link):
            return
        due_ms = self._hub.arrival_ms()
        self.outbox.append((due_ms, data))
        # The program goes back to the host by then at the latest.
        alarm_ms = self._hub.machine.alarm_ms
        if alarm_ms is not None:
            self._hub.machine.alarm_ms = min(alarm_ms, math.ceil(due_ms))

    write_app_data = write

    def deliver_app_data(self, data: bytes) -> None:
        """Overwrite the AppData with the host's bytes."""
        if len(data) > len(self.inbox):
            raise HubError("the program on the hub has no AppData buffer; create AppData in it")
        self.inbox[: len(data)] = data

    def deliver(self, data: bytes) -> None:
        """Put the host's bytes into the ring buffer; like the firmware, refuses writes that do not
        fit."""
        if len(self._stdin) + len(data) > self._capacity:
            raise HubError(
                "the hub's input buffer is full; wait for the program's answer before writing"
            )
        self._stdin += data


class VirtualHub:
    """A :class:`~brickhub.hub.transport.Transport` to a virtual robot.

    Args:
        body: a ``BenchBody``, or a twin of ``bricktwin.twin``.
        realtime: run in real time: the robot moves on while the host computes.
        link: delays and losses of the link; ``None`` for those of the body.
        seed: their seed.

    Attributes:
        radio: when its messages arrive.
        in_reach: set to False to break the link.
        waits_for_acknowledgement: whether `write` waits for the hub's; set to False where a host
            writes to several hubs at once.
    """

    def __init__(
        self,
        body: Body,
        *,
        realtime: bool = False,
        link: LinkProfile | None = None,
        seed: int = 0,
    ) -> None:
        self.robot = body.robot
        self.body = body
        self._given_link = link
        self.radio = Radio(seed)
        self.machine = Machine(body)
        self.machine.on_alarm = self._switch_to_host
        self._wire = _Wire(self)
        self._program: greenlet | None = None
        self._host: greenlet | None = None
        self._thread = threading.get_ident()
        self._stop_requested = False
        self._error: str | None = None
        self._pipe = Pipe.STDIN
        self._counts = itertools.cycle(range(1, 256))
        self._pace = Pace() if realtime else None
        self.in_reach: Callable[[], bool] = lambda: True
        self.waits_for_acknowledgement = True

    @property
    def link(self) -> LinkProfile:
        """Present delays and losses."""
        return self.body.link if self._given_link is None else self._given_link

    @property
    def is_realtime(self) -> bool:
        """Whether the hub runs in real time."""
        return self._pace is not None

    def open(self) -> None:
        """Connect. Raises HubError if the hub is out of reach."""
        self._check_reach()

    def start(self, program: HubProgram) -> None:
        """Start a program; a running one is stopped first."""
        self.stop()
        # Another thread started the program, and cannot be made to end it.
        if self._program is not None:
            self.machine.stop_motors()
        self._pipe = program.pipe
        # An earlier request was meant for the program before this one.
        self._stop_requested = False
        self._error = None
        self._wire = _Wire(self)
        # Without this, a new program would take the real time that has passed for silence.
        self._keep_pace()
        self._program = greenlet(self._run)
        self._thread = threading.get_ident()
        self._run_until(self.machine.time_ms, program)

    def write(self, data: bytes) -> None:
        """Send bytes, and wait until the hub acknowledges them: two connection events later, or
        more. Raises HubError for over 20 bytes, no program, or a full input buffer, HubProgramError
        if the program raised."""
        if len(data) > MAX_WRITE_BYTES:
            raise HubError(
                f"{len(data)} bytes in one write; split them into {MAX_WRITE_BYTES} bytes or less"
            )
        self._check_reach()
        self._keep_pace()
        # The program runs once at least, even on a link without delay, because it may end, which
        # the check below notices.
        arrival_ms = math.ceil(self.radio.to_hub_ms(self.machine.body_ms, self.link))
        self._run_until(self._next_stop_ms(arrival_ms))
        self.run_on_until(arrival_ms)
        self._check()
        if self._pipe is Pipe.APP_DATA:
            self._wire.deliver_app_data(app_data_slot(next(self._counts), data))
        else:
            self._wire.deliver(data)
        if self.waits_for_acknowledgement:
            self.run_on_until(math.ceil(self.arrival_ms()))

    def read(self, timeout_s: float) -> bytes:
        """The program's next output; ``b""`` after the (simulated) timeout. Raises HubError if no
        program runs and no output is left, HubProgramError if the program raised."""
        self._check_reach()
        self._keep_pace()
        deadline_ms = self.machine.time_ms + round(timeout_s * 1000)
        outbox = self._wire.outbox
        while not (outbox and outbox[0][0] <= self.machine.time_ms):
            if not outbox:
                self._check()
            if self.machine.time_ms >= deadline_ms:
                return b""
            # The program runs until something arrives, or, if nothing is on its way, until it
            # writes.
            until_ms = deadline_ms
            if outbox:
                until_ms = min(deadline_ms, math.ceil(outbox[0][0]))
            self._run_until(self._next_stop_ms(until_ms))
            self._wait_for_real_time()
        # A computer that reads late gets all that has arrived as one piece.
        data = bytearray()
        while outbox and outbox[0][0] <= self.machine.time_ms:
            data += outbox.popleft()[1]
        self._keep_pace()
        return bytes(data)

    def stop(self) -> None:
        """Stop the program; the motors coast.

        A program runs in the thread that started it; other threads only request the stop.
        """
        if threading.get_ident() != self._thread:
            self._stop_requested = self._program is not None
            return
        self._stop_requested = False
        if self._program is not None:
            program = self._program
            self._program = None
            try:
                # While Python ends, greenlets cannot switch any more.
                if not program.dead and not sys.is_finalizing():
                    # At its end it comes back here: who ran it last may be another hub's program,
                    # which would go on.
                    program.parent = getcurrent()
                    # No time may pass here, because other hubs of the same world do not run now.
                    with self.machine.stopping():
                        program.throw(_Stopped)
            finally:
                self.machine.stop_motors()
            self._come_to_rest()

    close = stop

    def now_s(self) -> float:
        return self.machine.time_ms / 1000

    def reset(self, rng: Rng) -> None:
        """Place the robot at the start of an episode, while the program goes on.

        This takes longer than the hub's watchdog timeout.
        """
        self.run_on_until(self.machine.time_ms + PLACEMENT_MS)
        self.body.reset(rng)

    def arrival_ms(self) -> float:
        """Time at which what the hub sends now is with the host."""
        return self.radio.to_computer_ms(self.machine.body_ms, self.link)

    def _run_until(
        self,
        time_ms: int,
        new_program: HubProgram | None = None,
    ) -> None:
        """Run the program until a simulated time, its next output, or its end."""
        if self._stop_requested:
            self.stop()
        program = self._program
        if program is None or program.dead:
            # Without a program the robot goes on moving.
            self.machine.alarm_ms = None
            self.machine.advance(max(0, time_ms - self.machine.time_ms))
            return
        # The alarm and the end of the program switch back to its parent, which is whoever runs it
        # now.
        self._host = getcurrent()
        try:
            program.parent = self._host
        except ValueError:
            raise TwinError(
                "the virtual hub was started in another thread; use an environment in one "
                "thread, or make one in each"
            ) from None
        self.machine.alarm_ms = max(time_ms, self.machine.time_ms + 1)
        # The first switch into a greenlet gives its function the arguments.
        if new_program is None:
            program.switch()
        else:
            program.switch(new_program)
        self.machine.alarm_ms = None

    def run_on_until(self, time_ms: int) -> None:
        """Run the program until a simulated time, whatever it writes."""
        while self.machine.time_ms < time_ms:
            self._run_until(self._next_stop_ms(time_ms))
            self._wait_for_real_time()

    def _next_stop_ms(self, time_ms: int) -> int:
        """Next stop on the way to a simulated time."""
        if self._pace is None:
            return time_ms
        return min(time_ms, self.machine.time_ms + MAX_STEP_MS)

    def _come_to_rest(self) -> None:
        """Show how the motors run down after a stop, if the hub runs in real time."""
        if self._pace is None:
            return
        angles_before: list[int] = []
        end_ms = self.machine.time_ms + _LONGEST_RUN_DOWN_MS
        while self.machine.time_ms < end_ms:
            angles = [self.body.angle_mdeg(port) for port in self.machine.servos]
            if angles_before:
                pairs = zip(angles, angles_before, strict=True)
                moved_mdeg = max(abs(angle - before) for angle, before in pairs)
                if moved_mdeg <= _AT_REST_MDEG:
                    return
            angles_before = angles
            self.machine.advance(MAX_STEP_MS)
            self._wait_for_real_time()

    def _switch_to_host(self) -> None:
        self.machine.alarm_ms = None
        # Time may also pass in the host itself, without a program.
        if self._host is not None and getcurrent() is self._program:
            self._host.switch()

    def _run(self, program: HubProgram) -> None:
        """Body of the greenlet."""
        importable = modules(self.machine, self._wire)
        importable.find_module = {module.name: module for module in program.modules}.get
        try:
            interpreter.execute(
                program.source,
                program.name,
                importable,
                self._wire,
            )
        except (SystemExit, SwitchedOff, _Stopped):
            pass
        except BaseException as error:
            # A greenlet that nobody holds any more is ended by its own exception.
            if isinstance(error, GreenletExit) or not is_program_error(error):
                raise
            # The error is kept until the host asks, because the host may not be waiting for this
            # program.
            shown = format_traceback(error, program.name)
            self._error = describe_traceback(shown, program.source, program.name)
        finally:
            # The program was neither stopped nor replaced by that of another thread.
            if getcurrent() is self._program:
                self.machine.stop_motors()

    def _check_reach(self) -> None:
        if not self.in_reach():
            raise HubError(
                "the virtual hub is out of reach; bring it back, and open the link again"
            )

    def _check(self) -> None:
        if self._error is not None:
            raise HubProgramError(self._error)
        if self._program is None or self._program.dead:
            raise ProgramStoppedError("no program runs on the hub; start one")

    def _keep_pace(self) -> None:
        """Advance by the time that the host needed, or wait for it, if the hub runs in real
        time."""
        if self._pace is None:
            return
        wall_ms = self._pace.wall_ms()
        # Less than a millisecond behind still counts as in time.
        if self.machine.time_ms < wall_ms - 1:
            self.run_on_until(int(wall_ms))
        self._wait_for_real_time()

    def _wait_for_real_time(self) -> None:
        if self._pace is not None:
            self._pace.keep(self.machine.time_ms)
