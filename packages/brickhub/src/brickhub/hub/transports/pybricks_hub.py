"""Transport to a real hub, independent of the medium: common part of Bluetooth and USB.

A hub keeps its program. The program that this computer downloaded last is recorded, and started
without a download if it is the wanted one; its HELLO confirms it. An unknown program is never
started, because it might move the robot.
"""

import asyncio
import atexit
import itertools
import json
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, TypeVar

from brickhub import errors
from brickhub.files import user_cache, write_durably
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.protocol import WRITE_BYTES, Up, control_frame, hello_payload
from brickhub.hub.transport import HubProgram, Pipe, app_data_slot
from brickhub.hub.transports.connection import HubConnection, HubIdentity, Port
from brickhub.hub.transports.event_loop import EventLoopThread, LoopRunner
from brickhub.hub.transports.profile import PybricksCommand, StatusReport

_T = TypeVar("_T")

_log = logging.getLogger(__name__)

_LONGEST_CONNECT_S = 10.0
"""Longest time of one attempt to connect; then the hub is searched for again."""
_HELLO_S = 3.0
"""Time in which a program that is on the hub says which one it is."""
_FIRST_PAUSE_S = 0.25
"""Pause before the second search for the hub; it doubles each time."""
_LONGEST_PAUSE_S = 2.0
_DOWNLOAD_S = 120.0
"""Time for the largest program over a slow link."""
_GRACE_S = 3.0
"""Time beyond a coroutine's own limit, so that its own error comes first, which says more."""


class ProfileTransport(ABC):
    """A :class:`~brickhub.hub.transport.Transport` to a hub that runs Pybricks.

    Args:
        timeout_s: time limit to find and connect the hub. A hub whose link was lost can be found
            again after its program has ended, ten seconds later.
        answer_timeout_s: time limit for the acknowledgement of a command.
        record: file that records which program is on which hub; ``None`` for the file in the user's
            cache.
    """

    def __init__(
        self,
        *,
        timeout_s: float = 20.0,
        answer_timeout_s: float = 2.0,
        record: Path | None = None,
    ) -> None:
        self._timeout_s = timeout_s
        self._answer_timeout_s = answer_timeout_s
        self._record = record or user_cache() / "programs.json"
        self._loop: LoopRunner | None = None
        self._connection: HubConnection | None = None
        self._first_hub: HubIdentity | None = None
        """Hub of the first connection; after a loss, only this one is reconnected."""
        self._pipe = Pipe.STDIN
        self._counts = itertools.cycle(range(1, 256))

    @abstractmethod
    async def _find(self, timeout_s: float) -> Port:
        """Find the hub; on a reconnection, the same one."""

    def _new_loop(self) -> LoopRunner:
        """Hook: what runs the coroutines of the connection."""
        return EventLoopThread("bricksrl-hub")

    @property
    def identity(self) -> HubIdentity | None:
        """Identity of the hub; ``None`` while it is not connected."""
        return self._connection.identity if self._connection is not None else None

    @property
    def status(self) -> StatusReport | None:
        """Latest status report of the hub; ``None`` while it is not connected."""
        return self._connection.status if self._connection is not None else None

    def open(self) -> None:
        """Find the hub and connect to it, with retries until the timeout.

        Raises:
            MediumUnavailableError: Bluetooth or USB is not available on this computer.
            HubNotFoundError: the hub is not in reach.
            HubProtocolError: the hub needs newer firmware.
            HubError: the hub cannot be connected.
        """
        if self._loop is None:
            self._loop = self._new_loop()
            # A program that ends without closing must not leave motors running.
            atexit.register(self.close)
        self._run(self._connected(), self._timeout_s, "connect to the hub")

    def start(self, program: HubProgram) -> None:
        """Download the program to the hub, unless it is there already, and start it. Reconnects
        after a loss.

        Raises:
            ProgramError: the program is invalid or too large for the hub.
            HubError: the hub cannot be reached, or refuses the program.
        """
        # The program is compiled first, because one that cannot be compiled needs no hub.
        modules = compile_program(program)
        if self._loop is None:
            self.open()
        self._pipe = program.pipe
        self._run(
            self._start(program, modules),
            self._timeout_s + _DOWNLOAD_S,
            "start the program on the hub",
        )

    def write(self, data: bytes) -> None:
        """Write to the program; waits, with a timeout, while its buffer is full.

        Raises:
            HubBusyError: the buffer stayed full.
            HubTimeoutError: the hub did not acknowledge the bytes; the link is dropped.
            HubDisconnectedError: the link is lost.
            HubError: no program runs, or the data has more than 20 bytes.
        """
        if len(data) > WRITE_BYTES:
            raise errors.HubError(
                f"{len(data)} bytes in one write; a hub takes {WRITE_BYTES} at most, split them"
            )
        connection = self._require_connection()
        connection.output.check()
        if self._pipe is Pipe.APP_DATA:
            offset = bytes(2)
            slot = app_data_slot(next(self._counts), data)
            packet = bytes((PybricksCommand.WRITE_APP_DATA,)) + offset + slot
        else:
            packet = bytes((PybricksCommand.WRITE_STDIN,)) + data
        self._run(
            connection.command(packet, "write to the program"),
            2 * self._answer_timeout_s,
            "write to the program",
        )

    def read(self, timeout_s: float) -> bytes:
        """Next output of the program; ``b""`` if none came in time.

        Raises:
            HubDisconnectedError: the link is lost, and everything has been read.
            ProgramStoppedError: the program has ended, and everything has been read.
        """
        return self._require_connection().output.read(timeout_s)

    def stop(self) -> None:
        """Stop the program, and with it the motors. If the link is lost, the hub does so by itself.
        Raises HubError if the hub does not answer, or does not stop."""
        connection = self._connection
        if connection is None or not connection.is_connected:
            return
        self._run(connection.stop_program(), 3 * self._answer_timeout_s, "stop the program")

    def close(self) -> None:
        """Stop the program and disconnect. May be called in any state and repeatedly; failures are
        logged."""
        # The loop is taken out first, so that a second call finds nothing to do.
        loop = self._loop
        self._loop = None
        connection = self._connection
        self._connection = None
        if loop is None:
            return
        atexit.unregister(self.close)
        try:
            if connection is not None:
                loop.run(
                    self._close(connection),
                    4 * self._answer_timeout_s + _GRACE_S,
                    "disconnect from the hub",
                )
        except errors.HubError as error:
            _log.warning("%s", error)
        finally:
            loop.close()

    def now_s(self) -> float:
        # On Windows the monotonic clock has ticks of 16 ms, which is too coarse.
        return time.perf_counter()

    # The methods from here on run in the thread of the event loop.

    async def _connected(self) -> HubConnection:
        """The open connection; connects if there is none."""
        if self._connection is not None:
            if self._connection.is_connected:
                return self._connection
            # A connection cannot be used again after its loss.
            await self._connection.disconnect()
            self._connection = None
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._search_s()
        pause_s = _FIRST_PAUSE_S
        while True:
            try:
                self._connection = await self._connect(deadline_s - loop.time())
            # Trying again does not help here, because a person has to do something.
            except (
                errors.AmbiguousHubError,
                errors.HubTakenError,
                errors.MediumUnavailableError,
                errors.HubProtocolError,
            ):
                raise
            except errors.HubError as error:
                if loop.time() + pause_s >= deadline_s:
                    raise
                _log.info("%s; trying again", error)
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            else:
                return self._connection

    def _search_s(self) -> float:
        """Time limit to find and connect the hub now."""
        return self._timeout_s

    async def _connect(self, timeout_s: float) -> HubConnection:
        port = await self._find(timeout_s)
        connect_timeout_s = min(timeout_s, _LONGEST_CONNECT_S)
        connection = HubConnection(
            port, answer_timeout_s=self._answer_timeout_s, connect_timeout_s=connect_timeout_s
        )
        await connection.connect()
        self._first_hub = identity = connection.identity
        _log.info(
            "connected to the %s hub '%s', firmware %s",
            identity.kind.value,
            identity.name,
            identity.firmware,
        )
        return connection

    async def _start(
        self,
        program: HubProgram,
        modules: dict[str, bytes],
    ) -> None:
        connection = await self._connected()
        kind = connection.identity.kind
        location = f"{connection.identity.address} slot {connection.status.slot}"
        if kind.model.stdin_bytes == 0 and program.says_hello:
            raise errors.HubProtocolError("a Move Hub cannot run our programs; use another hub")
        blob = program_blob(modules, kind)
        # A running program makes the hub refuse both a download and a start.
        if connection.is_running:
            await connection.stop_program()
        is_stored = program.says_hello and self._stored_programs().get(location) == program.hash
        if is_stored and await _start_stored_program(connection, program):
            return
        # A download may be interrupted, which leaves no known program on the hub.
        self._note_program(location, None)
        await connection.download(blob)
        self._note_program(location, program.hash if program.says_hello else None)
        await connection.start_program()

    async def _close(self, connection: HubConnection) -> None:
        try:
            if connection.is_connected:
                await connection.stop_program()
        finally:
            await connection.disconnect()

    def _stored_programs(self) -> dict[str, object]:
        """Hashes of the programs that this computer downloaded last, by address and slot of the
        hub."""
        # A record that cannot be read costs no more than a download.
        try:
            hashes = json.loads(self._record.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return hashes if isinstance(hashes, dict) else {}

    def _note_program(
        self,
        location: str,
        program_hash: int | None,
    ) -> None:
        programs = {**self._stored_programs(), location: program_hash}
        try:
            write_durably(self._record, json.dumps(programs).encode())
        except OSError as error:
            _log.debug("cannot note which program is on the hub: %s", error)

    # The methods from here on run in the thread of the caller.

    def _run(
        self,
        coroutine: Coroutine[Any, Any, _T],
        limit_s: float,
        operation: str,
    ) -> _T:
        if self._loop is None:
            coroutine.close()
            raise errors.HubError("the link to the hub is not open; open it first")
        return self._loop.run(coroutine, limit_s + _GRACE_S, operation)

    def _require_connection(self) -> HubConnection:
        if self._connection is None:
            raise errors.HubDisconnectedError("the hub is not connected; open the link first")
        return self._connection


async def _start_stored_program(connection: HubConnection, program: HubProgram) -> bool:
    """Start the program that is on the hub; True if it is the expected one, else it is stopped
    again."""
    hello = control_frame(Up.HELLO, hello_payload(program.hash))
    try:
        await connection.start_program()
        if await connection.wait_for_output(hello, _HELLO_S):
            return True
    except errors.HubError as error:
        if not connection.is_connected:
            raise
        _log.info("the program on the hub cannot be started: %s", error)
    # Another computer has downloaded a different program in the meantime, which might move the
    # robot.
    if connection.is_running:
        await connection.stop_program()
    return False
