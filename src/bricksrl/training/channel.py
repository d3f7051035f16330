"""Messages between two processes, over a pipe in each direction. Importing this loads no torch."""

from __future__ import annotations

import io
import pickle
import struct
import threading
from collections.abc import Callable
from typing import Any, BinaryIO

_LENGTH = struct.Struct("<Q")


class Channel:
    """Sends messages, and hands on what arrives, as bytes, in a thread of its own: the other side never waits for long.

    The two ends are processes of ours, so that `unpack` may trust what it gets.

    Args:
        deliver: called for each message that arrives, in their order, and with ``None`` when the other side has gone.
    """

    def __init__(self, incoming: BinaryIO, outgoing: BinaryIO, deliver: Callable[[bytes | None], None]) -> None:
        self._incoming, self._outgoing, self._deliver = incoming, outgoing, deliver
        self._thread = threading.Thread(target=self._read, name="channel", daemon=True)
        self._thread.start()

    def send(self, message: Any) -> None:
        """Send anything that can be pickled.

        Raises:
            OSError: the other side has gone.
        """
        data = io.BytesIO()
        _Pickler(data, pickle.HIGHEST_PROTOCOL).dump(message)
        self._outgoing.write(_LENGTH.pack(data.tell()))
        self._outgoing.write(data.getbuffer())
        self._outgoing.flush()

    def _read(self) -> None:
        try:
            while True:
                (length,) = _LENGTH.unpack(self._exactly(_LENGTH.size))
                self._deliver(self._exactly(length))
        except (OSError, EOFError, ValueError):  # gone, or closed on this side
            self._deliver(None)

    def _exactly(self, length: int) -> bytes:
        data = self._incoming.read(length)
        if len(data) < length:
            raise EOFError
        return data


class _Pickler(pickle.Pickler):
    """Lets tensors travel as arrays: torch's own way makes an archive of each, in fifty times the time."""

    def reducer_override(self, obj: Any) -> Any:
        from torch import Tensor, from_numpy

        return (from_numpy, (obj.numpy(),)) if type(obj) is Tensor else NotImplemented


def unpack(data: bytes) -> Any:
    """The message in what a `Channel` delivered."""
    return pickle.loads(data)  # noqa: S301  from a process of ours
