"""Child processes, with messages over a pipe in each direction. Importing this loads no torch."""

import atexit
import contextlib
import errno
import io
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, BinaryIO, NoReturn, cast

from brickhub.cli.ending import end_after, take_input

Message = tuple[str, Any]
"""A kind, and anything that can be pickled."""
END: Message = ("end", None)
"""Asks a child to end; also stands for the parent's disappearance."""
Deliver = Callable[[Message | None], None]
"""Receives messages in order, then ``None`` when the other side is gone; called in a separate
thread."""
ORPHAN_S = 1.0
"""Time after the parent's end, within which a child that is busy ends by force."""
Send = Callable[..., None]
"""Sends a message: a kind, and any content. Raises BrokenPipeError if the other side is gone."""


def open_channel(
    incoming: BinaryIO,
    outgoing: BinaryIO,
    deliver: Deliver,
) -> Send:
    """Deliver incoming messages from a separate thread. Returns the function that sends messages.
    The ends trust each other."""

    def send(kind: str, content: Any = None) -> None:
        data = io.BytesIO()
        _Pickler(data, pickle.HIGHEST_PROTOCOL).dump((kind, content))
        try:
            outgoing.write(data.getbuffer())
            outgoing.flush()
        except OSError as error:
            # Of another kind on Windows.
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)) from error

    def read() -> None:
        try:
            while True:
                deliver(pickle.load(incoming))  # noqa: S301  from a process of ours
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            # It is gone, maybe amid a message, or closed on this side.
            deliver(None)

    threading.Thread(
        target=read,
        name="channel",
        daemon=True,
    ).start()
    return send


class _Pickler(pickle.Pickler):
    """Pickles tensors of any device as arrays; torch's own format is fifty times slower."""

    def reducer_override(self, obj: Any) -> Any:
        from torch import Tensor, from_numpy

        # A subclass, such as a parameter, has a way of its own.
        if type(obj) is Tensor:
            return from_numpy, (obj.cpu().numpy(),)
        return NotImplemented


def own_python(*arguments: str) -> tuple[list[str], dict[str, str]]:
    """Command and environment variables of a process that runs Python with these arguments.

    It imports from where this process does. By itself Python would import first what lies in the
    present folder, where a stranger's ``copy.py`` may lie beside the run or the data that he sent.
    """
    # "" is the present folder, which has a name from now on; links stay as they are.
    folders = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    return [sys.executable, "-P", *arguments], variables


class ChildProcess:
    """A process that runs a module, with further environment ``variables``; Ctrl-C in the terminal
    does not reach it. Raises OSError if it cannot be started."""

    def __init__(
        self,
        module: str,
        deliver: Deliver,
        **variables: str,
    ) -> None:
        flags = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        command, own_variables = own_python("-m", module)
        self._process = subprocess.Popen(  # noqa: S603  our own interpreter
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**own_variables, **variables},
            start_new_session=True,
            creationflags=flags,
        )
        self.pid = self._process.pid
        stdout = cast(BinaryIO, self._process.stdout)
        stdin = cast(BinaryIO, self._process.stdin)
        self.send = open_channel(stdout, stdin, deliver)

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative signal number if killed), or ``None`` after the timeout."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return self._process.returncode

    def end(self, timeout_s: float = 0.0) -> int:
        """End the process, by force after the timeout. Returns its exit code."""
        self.wait(timeout_s)
        with contextlib.suppress(OSError), self._process:  # closes the pipes
            self._process.kill()
        return self._process.wait()


def parent_channel(deliver: Deliver) -> Send:
    """In a `ChildProcess`: deliver the parent's messages. Returns the function that sends messages
    to it.

    Once the parent is gone, the process has :data:`ORPHAN_S` to end by itself.
    """

    def deliver_and_end(message: Message | None) -> None:
        deliver(message)
        if message is None:
            end_after(ORPHAN_S)

    # A Ctrl-C is for the parent, which asks for the end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming = os.fdopen(take_input(), "rb")
    outgoing = os.fdopen(os.dup(1), "wb")
    # What a user's code prints must not mix with the messages.
    os.dup2(2, 1)
    return open_channel(incoming, outgoing, deliver_and_end)


def leave(code: int = 0) -> NoReturn:
    """In a `ChildProcess`: exit with a code, without waiting for the receiving thread."""
    # Replay buffers hold semaphores; unless they are given back, a warning is printed.
    atexit._run_exitfuncs()
    sys.stderr.flush()
    os._exit(code)
