"""Link to a hub that makes trials by itself.

The host sends the numbers of a trial and listens; nothing that it does or leaves undone within the
trial changes it. It repeats its request until something of the trial comes, and again when the end
is overdue: the hub makes a trial once, and tells its end again.

Whoever works step by step asks for the next reading of the trial, and for a trial with the first.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from brickhub.entry import Entry
from brickhub.errors import HubError, HubTimeoutError
from brickhub.hub import protocol
from brickhub.hub.interface import Interface
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.robot_link import Reading
from brickhub.hub.link.states import Cause, after
from brickhub.hub.program.generate import TILT_DEG, WATCHDOG_MS, generate_trials
from brickhub.hub.transport import HubProgram, Transport
from brickhub.hub.trial_protocol import TrialRecord, TrialWire
from brickhub.robot import Robot

_REPEAT_S = 0.4
"""Time without an answer after which a request is repeated."""
_LATE_S = 0.5
"""What a trial may take longer than its steps: a hub observes and computes before each."""
_HALF_TICK_S = 0.0005
"""Half a tick of a simulated clock: shorter waits do not advance it."""
_MOST_WAITS = 100_000
"""Most waits in a trial, in case the transport's clock stands still."""


class TrialLink(HubLink):
    """A :class:`HubLink`, with the same options, whose hub makes trials of a structured policy by
    itself.

    Args:
        numbers: the policy's numbers ``[p]``, with their ranges.
        policy: MicroPython that defines ``act_by(observed, numbers)``.
        tilt_deg: pitch or roll that ends a trial.

    Attributes:
        writes: frames that were written for trials.
    """

    def __init__(
        self,
        transport: Transport,
        robot: Robot,
        interface: Interface,
        numbers: Sequence[Entry],
        policy: str,
        *,
        tilt_deg: float = TILT_DEG,
        **options: Any,
    ) -> None:
        # Before the link is set up, which asks for the program.
        self.trial_wire = TrialWire(interface, robot, numbers)
        self._policy = policy
        self._tilt_deg = tilt_deg
        self.writes = 0
        # The trial that goes on, and what has come of it.
        self._trial: Iterator[Reading] | None = None
        self._record = TrialRecord(0)
        self._steps = 0
        self._tried: tuple[float, ...] = ()
        super().__init__(
            transport,
            robot,
            interface,
            **options,
        )

    def act(self, values: Iterable[float]) -> Reading:
        """Raise HubError: the hub acts by itself."""
        raise HubError("this hub acts by itself; use make_trial() or step()")

    def make_trial(
        self,
        numbers: Sequence[float],
        steps: int,
    ) -> list[Reading] | None:
        """Let the hub act by numbers ``[p]``, in their units, for some steps.

        Returns what it observed before each step and after the last one; fewer if the robot tilted,
        ``None`` if some of it was lost.

        Raises:
            EncodingError: the wrong number of numbers or steps, or one out of its range; nothing
                was sent.
            HubError: the link is not open, or failed, or the program on the hub has ended.
            HubTimeoutError: nothing of the trial came.
            HubProgramError: the program raised.
            StoppedError: an emergency stop came before or meanwhile.
        """
        readings = list(self._begin_trial(numbers, steps))
        return readings if self._record.is_whole else None

    def step(
        self,
        numbers: Sequence[float],
        steps: int,
    ) -> Reading:
        """The reading after the next step of the trial that goes on by numbers ``[p]``. If none
        does, or one by others, one of so many steps begins.

        A trial that ends early, by a tilt, has no further steps: the next one is that of a new
        trial. One that has tilted before its first step returns what it observed then.

        Raises:
            HubTimeoutError: nothing of the trial came, or something of it was lost.
            EncodingError, HubError, HubProgramError, StoppedError: as `make_trial`.
        """
        # One by other numbers is replaced by the new one, on the hub, too.
        if self._trial is not None and tuple(numbers) == self._tried:
            reading = self._next_of(self._trial)
            if reading is not None:
                return reading
        self._trial = self._begin_trial(numbers, steps)
        first = next(self._trial, None)
        reading = self._next_of(self._trial) or first
        # What was lost has raised, so that something has come.
        assert reading is not None  # noqa: S101
        return reading

    def _next_of(self, trial: Iterator[Reading]) -> Reading | None:
        """The next reading of a trial, or ``None`` if it has ended before. Raises HubTimeoutError
        if one was lost."""
        reading = next(trial, None)
        # After the last step nothing is left but the word that the motors stand.
        if reading is not None and len(self._record.answers) <= self._steps:
            return reading
        self._trial = None
        for _ in trial:
            pass
        if not self._record.is_whole:
            raise HubTimeoutError("an observation of a trial was lost; make the trial again")
        return reading

    def read(self) -> Reading:
        """Read the sensors without moving, as :class:`HubLink`; a trial that goes on is stopped."""
        if self._trial is not None:
            self.rest()
        return super().read()

    def rest(self) -> None:
        """Stop the motors, and a trial that goes on, as :class:`HubLink`."""
        self._trial = None
        super().rest()

    def _start_program(self) -> None:
        self._trial = None
        super()._start_program()

    def _begin_trial(
        self,
        numbers: Sequence[float],
        steps: int,
    ) -> Iterator[Reading]:
        """What the hub observes in a trial, as it comes. Raises before anything is sent as
        `make_trial`."""
        seq = protocol.next_seq(self._seq)
        frames = self.trial_wire.request(seq, numbers, steps)
        self._require_open()
        self._seq = seq
        self._steps = steps
        self._tried = tuple(numbers)
        self._record = TrialRecord(seq)
        # Before a frame is sent: if sending fails, the hub may still have got it and move.
        self.state = after(self.state, Cause.ACTED)
        return self._readings(self._record, frames, steps * self._longest_move_s)

    def _readings(
        self,
        record: TrialRecord,
        frames: Sequence[bytes],
        longest_s: float,
    ) -> Iterator[Reading]:
        with self._fault_with_cause():
            yield from self._listen(record, frames, longest_s)
        # Its motors stand.
        self.state = after(self.state, Cause.RESTED)

    def _listen(
        self,
        record: TrialRecord,
        frames: Sequence[bytes],
        longest_s: float,
    ) -> Iterator[Reading]:
        """Ask for a trial, and give what comes of it until it is over."""
        asked_s = self.now_s()
        give_up_s = asked_s + longest_s + self._timeout_s
        # While a trial goes on, there is nothing to ask for.
        overdue_s = asked_s
        for _ in range(_MOST_WAITS):
            if record.is_over:
                return
            now_s = self.now_s() + _HALF_TICK_S
            if now_s >= give_up_s:
                break
            if now_s >= overdue_s:
                for frame in frames:
                    self._write(frame)
                self.writes += len(frames)
                overdue_s = self.now_s() + _REPEAT_S
            frame_or_none = self._wait_for(self._is_of_hub, overdue_s - self.now_s())
            if frame_or_none is None or not record.take(frame_or_none):
                continue
            if isinstance(frame_or_none, protocol.DataFrame):
                self._compare_clocks(frame_or_none, asked_s)
                reading = self._reading(frame_or_none, self.now_s() - asked_s)
                # The next one comes after a step.
                overdue_s = self.now_s() + self._longest_move_s + _LATE_S
                yield reading
        raise self._timeout_error("the hub did not end its trial", give_up_s - asked_s)

    def _is_of_hub(self, frame: protocol.Frame) -> bool:
        """Whether a frame may be of a trial. Raises the error of a BYE."""
        if isinstance(frame, protocol.ControlFrame) and frame.kind in protocol.UP_PAYLOAD_BYTES:
            return super()._is_answer(frame)
        return True

    def _program_of(self, robot: Robot) -> HubProgram:
        return generate_trials(
            robot,
            self._interface,
            self.trial_wire.numbers,
            self._policy,
            tilt_deg=self._tilt_deg,
            pipe=self._pipe,
        )

    def _new_decoder(self) -> protocol.FrameDecoder:
        return self.trial_wire.decoder()

    def _needed_watchdog_ms(self) -> int:
        """The default: motors that stand between trials need no watchdog."""
        return WATCHDOG_MS
