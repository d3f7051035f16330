"""Streaming link: the hub sends observations continuously, and applies the latest command.

In lock-step a step takes two connection intervals beyond its own time, during which the robot
idles. Here steps have a fixed rate: ``act`` sends the command and returns at the end of its step,
with the newest observation that the hub made under that command. Its age is in ``Reading.age_s``.

The frame is sent at least three times within the time of the watchdog, as a keepalive; the hub
ignores commands with a sequence number that it has seen.
"""

import math
import struct
from collections.abc import Iterable
from typing import Any

from brickhub.errors import DescriptionError
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.robot_link import Reading
from brickhub.hub.protocol import ControlFrame, DataFrame, Down, Frame, control_frame
from brickhub.hub.transport import Transport
from brickhub.robot import Robot

PERIOD_MS = 10
"""Period of the observations: 100 Hz."""
_SENDS_PER_WATCHDOG = 3
"""Times that a command is sent within the watchdog's time, so that two in a row may get lost."""
_HALF_TICK_S = 0.0005
"""Half a tick of a simulated clock: shorter waits do not advance it."""
_WAITS_PER_STEP = 100_000
"""Largest number of waits in a step, in case the transport's clock stands still."""


class StreamingLink(HubLink):
    """A :class:`HubLink`, with the same arguments, whose hub sends observations by itself. Raises
    DescriptionError if a step of this interface has no fixed time."""

    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        interface: Interface,
        **options: Any,
    ) -> None:
        super().__init__(
            transport,
            robot,
            interface,
            **options,
        )
        step_ms = interface.settle.fixed_ms
        if step_ms is None:
            raise DescriptionError(
                "a step that ends when its moves have ended cannot be streamed; omit streaming"
            )
        self._step_s = step_ms / 1000
        self._due_s = -math.inf

    def act(self, values: Iterable[float]) -> Reading:
        """Send a new command, and return at the end of the step with the newest observation made
        under it.

        Steps start ``settle.time_ms`` apart, if the caller takes less time than that between them.

        Raises:
            EncodingError, HubError, HubTimeoutError, HubProgramError: as in lock-step.
        """
        frame = self._next_frame(values)
        started_s = self.now_s()
        # Each step begins at the end of the one before, so that the caller's own time does not add
        # up. After a longer pause the rhythm begins anew, because several steps would otherwise be
        # over at once.
        next_due_s = self._due_s + self._step_s
        is_late = next_due_s <= started_s
        self._due_s = started_s + self._step_s if is_late else next_due_s
        with self._fault_with_cause():
            self._adapt_watchdog()
            reading = self._stream(frame, started_s)
            self.statistics.record(reading.round_trip_s, reading.age_s)
        return reading

    def _begin(self) -> None:
        self._due_s = -math.inf
        self._request_stream()

    def _request_stream(self) -> None:
        """Ask the hub to send observations."""
        self._write(control_frame(Down.STREAM, struct.pack("<H", PERIOD_MS)))

    def _is_answer(self, frame: Frame) -> bool:
        """Whether a frame answers; observations under an earlier command are normal here, and not
        counted as stale."""
        if isinstance(frame, ControlFrame):
            return super()._is_answer(frame)
        return frame.seq == self._seq

    def _stream(
        self,
        frame: bytes,
        started_s: float,
    ) -> Reading:
        """Collect observations until the step is over and there is one under this command."""
        keepalive_s = self._watchdog_ms / 1000 / _SENDS_PER_WATCHDOG
        give_up_s = self._due_s + self._timeout_s
        newest: DataFrame | None = None
        arrived_s = started_s
        next_send_s = started_s
        for _ in range(_WAITS_PER_STEP):
            now_s = self.now_s() + _HALF_TICK_S
            # Frames that have arrived by the end of the step may hold a newer observation.
            is_over = now_s >= self._due_s and not self._frames
            if newest is not None and is_over:
                return self._reading(newest, arrived_s - started_s)
            if now_s >= give_up_s:
                break
            if now_s >= next_send_s:
                is_first_send = next_send_s <= started_s
                # Either the command was lost, or the request for observations at the start, so both
                # are sent again.
                if newest is None and not is_first_send:
                    self.statistics.resends += 1
                    self._request_stream()
                self._write(frame)
                next_send_s = self.now_s() + keepalive_s
            # A step without an observation cannot end, however long it has lasted.
            end_s = give_up_s if newest is None else self._due_s
            wake_s = min(next_send_s, end_s)
            answer = self._wait_for(self._is_answer, wake_s - self.now_s())
            if isinstance(answer, DataFrame):
                # The first observation gives the round trip of the command; later ones come by
                # themselves.
                if newest is None:
                    arrived_s = self.now_s()
                newest = answer
                self._compare_clocks(answer, started_s)
        raise self._timeout_error("the hub sent no observation", give_up_s - started_s)
