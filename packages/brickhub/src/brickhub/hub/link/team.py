"""Link of a robot in a team: all hubs are commanded before any is read."""

from __future__ import annotations

from collections.abc import Iterable

from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.receiver import Reading


class TeamLink(HubLink):
    """A `HubLink` with separate command and answer, so that several robots move at the same time."""

    _frame = b""
    _sent_s = 0.0

    def send(self, values: Iterable[float]) -> None:
        """Send the commands ``[n_commands]``, in their units; `receive` then waits for the answer.

        Raises:
            EncodingError: the wrong number of values, or one that is not a number; nothing was sent.
            HubError: the link is not open, or failed.
        """
        self._frame = self._next_frame(values)
        with self._fault_with_cause():
            self._adapt_watchdog()
            self._sent_s = self.now_s()
            self._transport.write(self._frame)

    def receive(self) -> Reading:
        """Wait for the answer to the last sent commands. Raises the same errors as `HubLink.act`."""
        known_s, resends = self._known_move_s, self._meter.resends
        with self._fault_with_cause():
            left_s = None if known_s is None else max(0.0, self._sent_s + known_s - self.now_s())
            window_s = self._longest_move_s + self._timeout_s / 2
            answer = self._await_answer(window_s, left_s)
            if answer is None:
                self._meter.resends += 1
                answer = self._send_and_wait(self._frame, self._longest_move_s, known_s)
            return self._answered(answer, self._sent_s, self._longest_move_s, known_s, resends)
