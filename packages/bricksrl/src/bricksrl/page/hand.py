"""Hand at the page: it pulls a body of a virtual robot's world towards a point, for as long as it
is held."""

import time
from typing import Any

from bricksrl.page.server import is_finite
from bricktwin.twin.body import TwinBody
from bricktwin.twin.hand import Hand as TwinHand

TIMEOUT_S = 1.0
"""Time without a message of the page, which repeats a pull, after which the hand lets go, as the
tab may be closed."""


class Hand:
    """Hand of one user; set by the page's threads, felt in the thread that steps the robot."""

    def __init__(self) -> None:
        self._pull: tuple[int, float, float, float] | None = None
        self._in_world: tuple[TwinBody, TwinHand] | None = None

    def pull(self, value: Any) -> None:
        """Pull a body, by its number in the drawn scene, towards x and y (m); other values let
        go."""
        self._pull = None
        if not isinstance(value, list) or len(value) != 3 or not all(map(is_finite, value)):
            return
        number, x_m, y_m = value
        if isinstance(number, int):
            self._pull = (number, float(x_m), float(y_m), time.monotonic())

    def act(
        self,
        body: TwinBody,
        numbers: list[int],
    ) -> None:
        """Apply the force to the twin, given the model's number of each drawn body."""
        if self._in_world is None or self._in_world[0] is not body:
            self._in_world = (body, TwinHand(body.engine))
        _, hand = self._in_world
        pull = self._pull
        if pull is None:
            hand.let_go()
            return
        drawn, x_m, y_m, pulled_s = pull
        if not 0 <= drawn < len(numbers) or time.monotonic() - pulled_s > TIMEOUT_S:
            self._pull = None
            hand.let_go()
            return
        hand.pull(numbers[drawn], x_m, y_m)
