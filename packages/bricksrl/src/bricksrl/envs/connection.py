"""Connection of an environment to its robot, and reconnection after the link broke."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from brickhub.errors import HubNotFoundError, MediumUnavailableError
from bricksrl.errors import BricksError, CameraError, HubError

if TYPE_CHECKING:
    from brickhub.hub.link.robot_link import RobotLink
    from brickhub.kits.virtual_kit import VirtualRobot
    from bricksrl.envs.host_sensors.host_sensor import Reader
    from bricksrl.envs.vision.camera import Camera
    from bricktwin.twin.standing import Pose

_T = TypeVar("_T")

_FIRST_PAUSE_S = 0.5
"""Pause after the second try in vain; each later one is twice as long."""
_LONGEST_PAUSE_S = 15.0
"""Longest pause between two tries."""

Placement = Callable[[np.random.Generator], None]
"""Places the robot at the start of an episode: a virtual robot is moved by a method, a real one by
a person."""


@dataclass(frozen=True)
class Connection:
    """A connected robot.

    Attributes:
        link: link to the robot; the environment opens and closes it.
        place: places the robot at the start of an episode; called at every reset, while the link is
            open.
        twin: the virtual hub, or devices of LEGO's kits, for rendering; ``None`` for a real robot.
        camera: source of images, for a task with a camera.
        sensors: readers of the task's sensors on the computer.
        true_pose: returns the pose of a virtual robot that has one.
    """

    link: RobotLink
    place: Placement
    twin: VirtualRobot | None = None
    camera: Camera | None = None
    true_pose: Callable[[], Pose] | None = None
    sensors: tuple[Reader, ...] = ()


@dataclass
class Reconnect:
    """Reconnection after the link broke: at once, then with exponential backoff. An error that
    lasts until a person acts, such as Bluetooth that is switched off, is raised at once if the
    robot has never answered.

    Attributes:
        patience_s: time to retry before the error is raised; 0 raises it at once. What a person
            takes, for a pause or to place the robot, does not count, nor does the time in which the
            robot answers.
        wait: sleeps for a number of seconds; may raise.
        on_error: called with each error of a step or a reset.
    """

    patience_s: float = 0.0
    wait: Callable[[float], object] = time.sleep
    on_error: Callable[[HubError | CameraError], None] = lambda _: None
    _has_answered: bool = False
    _error: HubError | CameraError | None = None
    _spent_s: float = 0.0
    """Time of vain tries and of the pauses between them since the link broke."""
    _excused_s: float = 0.0
    """Time of the present try that a person took."""
    _tries: int = 0

    def until_answered(
        self,
        begin: Callable[[], _T],
        is_final: Callable[[BricksError], bool] = lambda _: False,
    ) -> _T:
        """The result of ``begin``, which is tried again after each HubError or CameraError. Raises
        the error if it is final, if it is useless to try again, or if ``patience_s`` is used up."""
        while True:
            if self._error is not None and self._tries:
                pause_s = min(_FIRST_PAUSE_S * 2.0 ** (self._tries - 1), _LONGEST_PAUSE_S)
                self._spent_s += pause_s
                if self._spent_s >= self.patience_s:
                    error = self._error
                    self.recovered()
                    raise error
                self.wait(pause_s)
            self._tries += 1
            begun_s = time.monotonic()
            self._excused_s = 0.0
            try:
                begun = begin()
            except (HubError, CameraError) as error:
                if is_final(error):
                    raise
                self.failed(error)
                self._spent_s += time.monotonic() - begun_s - self._excused_s
            else:
                self._has_answered = True
                if self._error is None:
                    self._tries = 0
                return begun

    @contextmanager
    def by_hand(self) -> Iterator[None]:
        """Context of what waits for a person, whose time does not count."""
        begun_s = time.monotonic()
        try:
            yield
        finally:
            self._excused_s += time.monotonic() - begun_s

    def recovered(self) -> None:
        """Record an answer to a step; one to a reset does not count as recovery."""
        self._error = None
        self._tries = 0
        self._spent_s = 0.0

    def failed(self, error: HubError | CameraError) -> None:
        """Record that the link or the camera broke in a step or a reset. Raises the error if trying
        again is useless."""
        if not self._has_answered and _needs_a_person(error):
            self._tries = 0
            raise error
        self.on_error(error)
        self._error = error


def _needs_a_person(error: HubError | CameraError) -> bool:
    """Whether an error lasts until a person acts, if the robot has never answered."""
    if isinstance(error, MediumUnavailableError | HubNotFoundError):
        return error.reason.is_lasting
    return isinstance(error, CameraError)
