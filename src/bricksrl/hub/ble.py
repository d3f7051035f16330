"""The transport over Bluetooth Low Energy, to a real hub.

A hub keeps its program. What this computer brought there last is written down, and is started without a download when
it is the one that is wanted; its HELLO then proves it. A program of somebody else's is never started: it might move.
"""

from __future__ import annotations

import asyncio
import atexit
import json
import logging
import os
import time
from pathlib import Path

from bricksrl.errors import HubError, HubProtocolError
from bricksrl.hub import pybricks_profile as profile
from bricksrl.hub.ble_connection import BleConnection, HubIdentity
from bricksrl.hub.compile import compile_mpy, program_blob
from bricksrl.hub.event_loop import EventLoopThread
from bricksrl.hub.failures import AmbiguousHubError, BluetoothUnavailableError, HubDisconnectedError
from bricksrl.hub.protocol import WRITE_BYTES, Up, control_frame, hello_payload
from bricksrl.hub.pybricks_profile import StatusReport
from bricksrl.hub.scan import BleBackend, find
from bricksrl.hub.transport import HubProgram
from bricksrl.robots import HubKind

_log = logging.getLogger(__name__)

_LONGEST_CONNECT_S = 10.0
_HELLO_S = 3.0
_FIRST_PAUSE_S = 0.25
_LONGEST_PAUSE_S = 2.0
_DOWNLOAD_S = 120.0
_GRACE_S = 3.0


class BleTransport:
    """A :class:`~bricksrl.hub.transport.Transport` to a hub that runs Pybricks.

    Args:
        name, address: which hub, by either; with neither it must be the only one in reach.
        backend: what reaches the radio; ``None`` for bleak's own choice.
        timeout_s: how long the hub may take to be found and connected. A hub whose link was lost can be found again when
            its program has ended, ten seconds later.
        answer_timeout_s: how long the hub may take to acknowledge one command.
        record: file that remembers which program is on which hub; ``None`` for one in the user's cache.
    """

    def __init__(
        self,
        name: str | None = None,
        address: str | None = None,
        *,
        backend: BleBackend | None = None,
        timeout_s: float = 20.0,
        answer_timeout_s: float = 2.0,
        record: Path | None = None,
    ) -> None:
        self._name, self._address = name, address
        self._backend = backend
        self._timeout_s = timeout_s
        self._answer_timeout_s = answer_timeout_s
        self._record = _Record(record or _cache_folder() / "programs.json")
        self._loop: EventLoopThread | None = None
        self._connection: BleConnection | None = None

    @property
    def identity(self) -> HubIdentity | None:
        """What the hub is; ``None`` while it is not connected."""
        return self._connection.identity if self._connection is not None else None

    @property
    def status(self) -> StatusReport | None:
        """What the hub reported last; ``None`` while it is not connected."""
        return self._connection.status if self._connection is not None else None

    def open(self) -> None:
        """Find the hub and connect to it, in as many attempts as fit the time.

        Raises:
            BluetoothUnavailableError: this computer has no Bluetooth that may be used.
            HubNotFoundError: the hub is not in reach.
            HubProtocolError: it needs newer firmware.
            HubError: it cannot be connected.
        """
        if self._loop is None:
            self._loop = EventLoopThread("bricksrl-ble")
            atexit.register(self.close)
        self._loop.run(self._connected(), self._timeout_s + _GRACE_S, "connect to the hub")

    def start(self, program: HubProgram) -> None:
        """Bring the program onto the hub, where it is not there yet, and start it. Connects again after a loss.

        Raises:
            ProgramError: the program is wrong, or too large for the hub.
            HubError: the hub cannot be reached, or does not take the program.
        """
        mpy = compile_mpy(program.source)
        if self._loop is None:
            self.open()
        limit_s = self._timeout_s + _DOWNLOAD_S + _GRACE_S
        self._running_loop().run(self._start(program, mpy), limit_s, "start the program on the hub")

    def write(self, data: bytes) -> None:
        """Write to the program's standard input; waits, for a time, while its buffer is full.

        Raises:
            HubBusyError: the buffer stayed full.
            HubTimeoutError: the hub did not acknowledge the bytes; the link is given up.
            HubDisconnectedError: the link is lost.
            HubError: no program runs, or the data has more than 20 bytes.
        """
        if len(data) > WRITE_BYTES:
            raise HubError(f"{len(data)} bytes in one write; a hub takes {WRITE_BYTES} at most, split them")
        connection = self._require_connection()
        connection.output.check()
        command = connection.command(profile.write_stdin(data), "write to the program")
        self._running_loop().run(command, 2 * self._answer_timeout_s + _GRACE_S, "write to the program")

    def read(self, timeout_s: float) -> bytes:
        """The program's next output; ``b""`` when none came in time, and once when the program has ended.

        Raises:
            HubDisconnectedError: the link is lost, and everything has been read.
            HubError: the program has ended, and everything has been read.
        """
        return self._require_connection().output.read(timeout_s)

    def stop(self) -> None:
        """Stop the program, and with it the motors. Where the link is lost, the hub does it by itself.

        Raises:
            HubError: the hub does not answer, or does not stop.
        """
        connection = self._connection
        if connection is None or not connection.is_connected:
            return
        self._running_loop().run(connection.stop_program(), 3 * self._answer_timeout_s + _GRACE_S, "stop the program")

    def close(self) -> None:
        """Stop the program and disconnect. May be called in any state, twice too; what fails is logged."""
        loop, self._loop = self._loop, None
        connection, self._connection = self._connection, None
        if loop is None:
            return
        atexit.unregister(self.close)
        try:
            if connection is not None:
                loop.run(self._close(connection), 4 * self._answer_timeout_s + _GRACE_S, "disconnect from the hub")
        except HubError as error:
            _log.warning("%s", error)
        finally:
            loop.close()

    def now_s(self) -> float:
        return time.monotonic()

    # ---- in the thread of the event loop

    async def _connected(self) -> BleConnection:
        """The connection, made anew where there is none."""
        if self._connection is not None:
            if self._connection.is_connected:
                return self._connection
            await self._connection.disconnect()
            self._connection = None
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._timeout_s
        pause_s = _FIRST_PAUSE_S
        while True:
            try:
                self._connection = await self._connect(deadline_s - loop.time())
            except (AmbiguousHubError, BluetoothUnavailableError, HubProtocolError):
                raise
            except HubError as error:
                if loop.time() + pause_s >= deadline_s:
                    raise
                _log.info("%s; trying again", error)
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            else:
                return self._connection

    async def _connect(self, timeout_s: float) -> BleConnection:
        device = await find(self._name, self._address, timeout_s, self._backend)
        connection = BleConnection(
            device,
            self._backend.client if self._backend else None,
            answer_timeout_s=self._answer_timeout_s,
            connect_timeout_s=min(timeout_s, _LONGEST_CONNECT_S),
        )
        await connection.connect()
        self._address = device.address  # after a loss it has to be the same hub
        identity = connection.identity
        _log.info("connected to the %s hub '%s', firmware %s", identity.kind.value, identity.name, identity.firmware)
        return connection

    async def _start(self, program: HubProgram, mpy: bytes) -> None:
        connection = await self._connected()
        kind, address = connection.identity.kind, connection.identity.address
        if kind is HubKind.MOVE:
            raise HubProtocolError("a Move Hub has no standard input; use another hub")
        blob = program_blob(mpy, kind)
        if connection.is_running:
            await connection.stop_program()
        if self._record.get(address) == program.hash and await _start_present(connection, program):
            return
        self._record.set(address, None)
        await connection.download(blob)
        self._record.set(address, program.hash)
        await connection.start_program()

    async def _close(self, connection: BleConnection) -> None:
        try:
            if connection.is_connected:
                await connection.stop_program()
        finally:
            await connection.disconnect()

    # ---- in the caller's thread

    def _running_loop(self) -> EventLoopThread:
        if self._loop is None:
            raise HubError("the link to the hub is not open; open it first")
        return self._loop

    def _require_connection(self) -> BleConnection:
        if self._connection is None:
            raise HubDisconnectedError("the hub is not connected; open the link first")
        return self._connection


async def _start_present(connection: BleConnection, program: HubProgram) -> bool:
    """Start the program that is on the hub. Whether it is the one that is meant; any other is stopped again."""
    hello = control_frame(Up.HELLO, hello_payload(program.hash))
    try:
        await connection.start_program()
        if await connection.wait_for_output(hello, _HELLO_S):
            return True
    except HubError as error:
        if not connection.is_connected:
            raise
        _log.info("the program on the hub cannot be started: %s", error)
    if connection.is_running:
        await connection.stop_program()
    return False


class _Record:
    """Which program this computer brought onto which hub last. A convenience: without it, programs are downloaded."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, address: str) -> int | None:
        """The program's hash, if known."""
        found = self._load().get(address)
        return found if isinstance(found, int) else None

    def set(self, address: str, program_hash: int | None) -> None:
        known = self._load()
        known[address] = program_hash
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            draft = self._path.with_name(f"{self._path.name}.{os.getpid()}")
            draft.write_text(json.dumps(known), encoding="utf-8")
            draft.replace(self._path)
        except OSError as error:
            _log.debug("cannot note which program is on the hub: %s", error)

    def _load(self) -> dict[str, object]:
        try:
            known = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return known if isinstance(known, dict) else {}


def _cache_folder() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bricksrl"
