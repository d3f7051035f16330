"""Link to a robot, as everybody uses one who commands it: to the program on a hub, or to the devices of LEGO's kits."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from brickhub.hub.link.receiver import Reading
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.timing import LinkStatistics


class RobotLink(Protocol):
    """Link to one robot. Methods raise as those of :class:`~brickhub.hub.link.lockstep.HubLink`, which documents them."""

    state: LinkState
    statistics: LinkStatistics

    @property
    def is_open(self) -> bool:
        """True if commands can be sent, as far as is known."""

    def open(self) -> None:
        """Connect and get ready."""

    def read(self) -> Reading:
        """Read the sensors without moving."""

    def act(self, values: Iterable[float]) -> Reading:
        """Carry out the commands, and read the channels at the end of the step."""

    def rest(self) -> None:
        """Stop the motors, for a pause."""

    def emergency_stop(self) -> None:
        """Stop the motors at once, from any thread."""

    def release(self) -> None:
        """End an emergency stop."""

    def now_s(self) -> float:
        """Time of the link's clock."""

    def stop(self) -> None:
        """Stop the motors; ``open`` goes on."""

    def close(self) -> None:
        """Stop and disconnect; never raises."""
