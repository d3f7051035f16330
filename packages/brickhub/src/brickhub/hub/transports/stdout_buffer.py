"""Buffer of a hub program's output, between the receiving and the reading thread."""

from __future__ import annotations

import threading

from brickhub.errors import HubError


class Output:
    """Standard output of a program, and its end.

    After the end the rest can be read, then one read returns ``b""`` (so that a collected traceback is known to be
    complete), and later ones raise the reason of the end.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._data = bytearray()
        self._end: type[HubError] | None = HubError
        self._reason = "no program runs on the hub; start one"
        self._is_end_reported = True

    def begin(self) -> None:
        """Start with a new program: discard earlier output."""
        with self._changed:
            self._data.clear()
            self._end = None

    def put(self, data: bytes) -> None:
        """Add output."""
        with self._changed:
            self._data += data
            self._changed.notify_all()

    def end(self, kind: type[HubError], reason: str) -> None:
        """End the output. The last reason counts: the link may be lost after the program's end."""
        with self._changed:
            self._is_end_reported = self._is_end_reported and self._end is not None
            self._end, self._reason = kind, reason
            self._changed.notify_all()

    def contains(self, data: bytes) -> bool:
        """True if the unread output contains these bytes."""
        with self._changed:
            return data in self._data

    def check(self) -> None:
        """Raise HubError after the end."""
        if self._end is not None:
            raise self._end(self._reason)

    def read(self, timeout_s: float) -> bytes:
        """All unread output, as soon as there is some; ``b""`` if none came in time. Raises HubError if the program or the link
        has ended; see above."""
        with self._changed:
            self._changed.wait_for(lambda: self._data or self._end is not None, timeout_s)
            if self._data or self._end is None:
                data = bytes(self._data)
                self._data.clear()
                return data
            if self._is_end_reported:
                raise self._end(self._reason)
            self._is_end_reported = True
            return b""
