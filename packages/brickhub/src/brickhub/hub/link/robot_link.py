"""Link to a robot, as everybody uses one who commands it: to the program on a hub, or to the
devices of LEGO's kits."""

import contextlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from brickhub.errors import HubError, StoppedError
from brickhub.hub.link.states import Cause, LinkState, after, cause_of
from brickhub.hub.link.timing import LinkStatistics


@dataclass(frozen=True)
class Reading:
    """One answer of the hub.

    Attributes:
        values: ``[n_channels]``, in channel order and units, rounded to float32.
        hub_time_ms: the hub's clock when it read its sensors, since its program started; it does
            not wrap.
        round_trip_s: time from the first sending of the command to the first answer.
        age_s: age of the sensor values when the reading was returned; see ``timing.py``.
    """

    values: tuple[float, ...]
    hub_time_ms: int
    round_trip_s: float
    age_s: float = 0.0


class RobotLink(ABC):
    """Link to one robot. Use it as a context manager: leaving stops the robot. Methods raise as
    those of :class:`~brickhub.hub.link.lockstep.HubLink`, which documents them.

    Args:
        watchdog_s: time without a command after which the motors stop by themselves.

    Attributes:
        state: its state; ``statistics``: times of its exchanges.
    """

    def __init__(self, watchdog_s: float) -> None:
        self.state = LinkState.DISCONNECTED
        self.statistics = LinkStatistics(watchdog_s=watchdog_s)
        self._halted = threading.Event()

    @property
    def is_open(self) -> bool:
        """True if commands can be sent, as far as is known."""
        return self.state in (LinkState.READY, LinkState.ARMED)

    @abstractmethod
    def open(self) -> None:
        """Connect and get ready."""

    @abstractmethod
    def read(self) -> Reading:
        """Read the sensors without moving."""

    @abstractmethod
    def act(self, values: Iterable[float]) -> Reading:
        """Carry out the commands, and read the channels at the end of the step."""

    @abstractmethod
    def rest(self) -> None:
        """Stop the motors, for a pause."""

    @abstractmethod
    def emergency_stop(self) -> None:
        """Stop the motors at once, from any thread. All later calls raise ``StoppedError`` until
        ``release``."""

    def release(self) -> None:
        """End an emergency stop: ``open`` goes on."""
        # After a stop the program is gone, even if no call has failed yet, so the link is not open
        # any more.
        if self._halted.is_set() and self.is_open:
            self.state = after(self.state, Cause.HALTED)
        self._halted.clear()

    @abstractmethod
    def now_s(self) -> float:
        """Time of the link's clock: the computer's, or the simulated one."""

    @abstractmethod
    def stop(self) -> None:
        """Stop the motors; ``open`` goes on."""

    @abstractmethod
    def close(self) -> None:
        """Stop and disconnect. May be called in any state and repeatedly, and never raises."""

    def __enter__(self) -> Self:
        try:
            self.open()
        except BaseException:
            # Python calls __exit__ only after a successful __enter__, but the hub may be connected
            # already.
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check_halted(self) -> None:
        if self._halted.is_set():
            raise stopped_error()

    def _require_open(self) -> None:
        self._check_halted()
        if self.state is LinkState.FAULT:
            raise HubError("the link failed before; call open() to start it again")
        if self.state is LinkState.DISCONNECTED:
            raise HubError("the link is not open; call open() first")

    @contextlib.contextmanager
    def _fault(self) -> Iterator[None]:
        """Set the state that the table has for an error raised inside; during an emergency stop
        raise StoppedError instead."""
        try:
            yield
        except (HubError, StoppedError) as error:
            # During an emergency stop, an error of the transport is only its consequence.
            cause = Cause.HALTED if self._halted.is_set() else cause_of(error)
            self.state = after(self.state, cause)
            if self._halted.is_set() and not isinstance(error, StoppedError):
                raise stopped_error() from error
            raise


def stopped_error() -> StoppedError:
    """Error of a call during an emergency stop."""
    return StoppedError("the robot was stopped by hand; release it when it may move again")
