"""A robot within reach of an environment, and how it is reached again after its link broke."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bricksrl.envs.odometry import Odometer
    from bricksrl.envs.vision.camera import Camera
    from bricksrl.errors import HubError
    from bricksrl.hub.link.lockstep import HubLink
    from bricksrl.virtual_hub.transport import VirtualHub

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 15.0

Placement = Callable[[np.random.Generator], None]
"""Puts the robot where an episode starts. For a virtual robot a method, for a real one a hand."""


@dataclass(frozen=True)
class Connection:
    """A robot within reach.

    Attributes:
        link: to its hub; the environment opens and closes it.
        place: puts it where an episode starts, at every reset, while the link is open.
        odometer: tells how far it gets.
        twin: the virtual hub at the other end, for rendering; ``None`` where the robot is real.
        camera: what looks at it, for a task with a camera.
    """

    link: HubLink
    place: Placement
    odometer: Odometer
    twin: VirtualHub | None = None
    camera: Camera | None = None


@dataclass
class Reconnect:
    """Trying to reach a robot again whose link broke: at once, then after pauses that grow.

    Attributes:
        patience_s: how long to try before the error is raised; 0 raises it at once.
        wait: waits for so many seconds; it may raise.
        on_error: told each error, in a step or a reset.
    """

    patience_s: float = 0.0
    wait: Callable[[float], object] = time.sleep
    on_error: Callable[[HubError], None] = lambda _: None
    _error: HubError | None = None
    _since_s: float = 0.0
    _tries: int = 0

    def answered(self, *, to_step: bool) -> None:
        """The robot answered to a step, or to a reset only, with which nothing is mended yet that broke before."""
        if to_step or self._error is None:
            self._error, self._tries = None, 0

    def failed(self, error: HubError) -> None:
        """The link broke in a step or a reset."""
        self.on_error(error)
        self._since_s = time.monotonic() if self._error is None else self._since_s
        self._error = error

    def before_try(self) -> None:
        """Wait for the time of a reset.

        Raises:
            HubError: the last error, where it was tried for long enough.
        """
        if self._error is not None and self._tries:
            pause_s = min(_FIRST_PAUSE_S * 2.0 ** (self._tries - 1), _LONGEST_PAUSE_S)
            if time.monotonic() + pause_s - self._since_s >= self.patience_s:
                error, self._error, self._tries = self._error, None, 0
                raise error
            self.wait(pause_s)
        self._tries += 1
