"""Buffer of the output of the program on a hub, between the thread that receives it and the one that reads it."""

from __future__ import annotations

import threading

from bricksrl.errors import HubError


class Output:
    """Standard output of a program, and its end.

    After the end the rest can be read, then one read gives ``b""`` (so that whoever collects a traceback sees that it is
    complete), and the following ones raise the reason of the end.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._data = bytearray()
        self._end: type[HubError] | None = HubError
        self._reason = "no program runs on the hub; start one"
        self._is_end_told = True

    def begin(self) -> None:
        """A new program: forget what came before."""
        with self._changed:
            self._data.clear()
            self._end = None

    def put(self, data: bytes) -> None:
        """More output."""
        with self._changed:
            self._data += data
            self._changed.notify_all()

    def end(self, kind: type[HubError], reason: str) -> None:
        """No more output. The last reason counts: a link may be lost when the program has long ended."""
        with self._changed:
            self._is_end_told = self._is_end_told and self._end is not None
            self._end, self._reason = kind, reason
            self._changed.notify_all()

    def holds(self, data: bytes) -> bool:
        """True if these bytes lie among those not read yet."""
        with self._changed:
            return data in self._data

    def check(self) -> None:
        """Raises HubError after the end."""
        if self._end is not None:
            raise self._end(self._reason)

    def read(self, timeout_s: float) -> bytes:
        """All that is there, as soon as there is something; ``b""`` when nothing came in time.

        Raises:
            HubError: the program has ended, or the link has; see above.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._data or self._end is not None, timeout_s)
            if self._data or self._end is None:
                data = bytes(self._data)
                self._data.clear()
                return data
            if self._is_end_told:
                raise self._end(self._reason)
            self._is_end_told = True
            return b""
