"""Connection to one hub, over Bluetooth or USB: commands with timeouts, status, and the program's
output.

All methods of a connection run in the event loop's thread.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from brickhub.errors import (
    HubBusyError,
    HubDisconnectedError,
    HubError,
    HubProtocolError,
    HubTimeoutError,
    ProgramStoppedError,
)
from brickhub.hub.transports import profile
from brickhub.hub.transports.profile import PybricksCommand, Status, StatusReport
from brickhub.robot import HubKind

_log = logging.getLogger(__name__)

_FIRST_STATUS_S = 3 * profile.STATUS_PERIOD_S
"""Time for the first status report, two of which may get lost."""
_OUTPUT_GRACE_S = 0.3
"""Time for the rest of a program's output, which may arrive after the report of its end."""
_BUSY_PAUSE_S = 0.01
"""Pause before a command is repeated that a busy hub refused; it doubles each time."""
_LONGEST_BUSY_PAUSE_S = 0.16


class Output:
    """Standard output of a program, and its end: after that the rest can be read, and then reading
    raises its reason.

    A reader waits in its own thread; through that of the event loop, each exchange takes
    milliseconds longer on a busy computer.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._data = bytearray()
        # Before the first program there is an end too, so that reading does not wait in vain.
        self._end: type[HubError] | None = HubError
        self._reason = "no program runs on the hub; start one"

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

    def end(
        self,
        kind: type[HubError],
        reason: str,
    ) -> None:
        """End the output. The last reason counts: the link may be lost after the program's end."""
        with self._changed:
            self._end = kind
            self._reason = reason
            self._changed.notify_all()

    @property
    def is_readable(self) -> bool:
        """Whether reading returns something, or raises, at once."""
        return bool(self._data) or self._end is not None

    def contains(self, data: bytes) -> bool:
        """True if the unread output contains these bytes."""
        with self._changed:
            return data in self._data

    def check(self) -> None:
        """Raise HubError after the end."""
        if self._end is not None:
            raise self._end(self._reason)

    def read(self, timeout_s: float) -> bytes:
        """Read all output that was not read yet, as soon as there is some; ``b""`` if none came in
        time. Raises HubError if the program or the link has ended, and all was read."""
        with self._changed:
            self._changed.wait_for(lambda: self._data or self._end is not None, timeout_s)
            # Data from before the end is read first, because a traceback says why it ended.
            if not self._data:
                self.check()
            data = bytes(self._data)
            self._data.clear()
            return data


class Port(Protocol):
    """Medium of a connection, Bluetooth or USB.

    Errors are ``HubError`` or its subclasses; a call that takes too long is cancelled.

    Attributes:
        name, address: name and address of the hub.
        silence: likely cause, and what to do, when it is silent while connecting.
    """

    name: str
    address: str
    silence: str

    async def open(
        self,
        on_event: Callable[[bytes], None],
        on_loss: Callable[[str], None],
    ) -> None:
        """Connect. After ``subscribe``, each event goes to ``on_event``; the reason of a lost link
        goes to ``on_loss``."""

    async def read(self, characteristic: str) -> bytes:
        """Value of a characteristic, by its UUID."""

    async def subscribe(self) -> None:
        """Subscribe to the hub's events."""

    async def write(
        self,
        command: bytes,
        operation: str,
    ) -> None:
        """Write a command and wait for its acknowledgement; ``operation`` describes it in error
        messages."""

    async def close(self) -> None:
        """Disconnect."""


@dataclass(frozen=True)
class HubIdentity:
    """Identity that a connected hub reports.

    Attributes:
        name, address: advertised name and address; on macOS the address is valid on this computer
            only.
        kind: kind of hub.
        firmware: version of Pybricks, e.g. ``"4.0.1"``.
        profile_version: version of the Pybricks Profile, e.g. ``(1, 5)``.
        capabilities: sizes and features.
    """

    name: str
    address: str
    kind: HubKind
    firmware: str
    profile_version: tuple[int, int]
    capabilities: profile.Capabilities


class HubConnection:
    """Connection to a hub, from ``connect`` to ``disconnect`` or to a failure; it cannot be reused.

    Attributes:
        identity: identity of the hub; set by ``connect``.
        status: last status report; set by ``connect``.
        output: buffer of the program's output and its end.
    """

    identity: HubIdentity
    status: StatusReport

    def __init__(
        self,
        port: Port,
        *,
        answer_timeout_s: float,
        connect_timeout_s: float,
    ) -> None:
        self.output = Output()
        self._port = port
        self._answer_timeout_s = answer_timeout_s
        self._connect_timeout_s = connect_timeout_s
        self._loss: str | None = "not connected yet"
        self._reports = 0
        # The end of a program is news only if it was expected to run: not after a stop, and not if
        # it was there before.
        self._is_running_expected = False
        self._end_timer: asyncio.TimerHandle | None = None
        self._changed = asyncio.Event()
        self._write_lock = asyncio.Lock()
        self._write_timeout: asyncio.Timeout | None = None

    @property
    def is_connected(self) -> bool:
        return self._loss is None

    @property
    def is_running(self) -> bool:
        """True if a program runs on the hub, by its last report."""
        return self.is_connected and Status.USER_PROGRAM_RUNNING in self.status.flags

    async def connect(self) -> None:
        """Connect, identify the hub, and subscribe to its reports. Raises a subclass of HubError
        with the reason."""
        # A loss may be noticed from here on.
        self._loss = None
        try:
            async with asyncio.timeout(self._connect_timeout_s):
                await self._port.open(self._on_event, self._lose)
                # An unknown hub is refused before anything is asked of it.
                self.identity = await self._identify()
                await self._port.subscribe()
                has_report = await self._wait_for(lambda: self._reports > 0, _FIRST_STATUS_S)
                if not has_report:
                    raise HubTimeoutError(
                        "the hub does not report its status; switch it off and on"
                    )
                self._check_connected()
        except TimeoutError as error:
            await self.disconnect()
            # A HubTimeoutError is also a TimeoutError, but has its reason already.
            if isinstance(error, HubError):
                raise
            raise HubTimeoutError(
                f"the hub did not answer while connecting; {self._port.silence}"
            ) from None
        except BaseException:
            await self.disconnect()
            raise

    async def disconnect(self) -> None:
        """Disconnect. Never raises, and has a timeout."""
        self._lose("this computer disconnected")
        try:
            async with asyncio.timeout(self._answer_timeout_s):
                await self._port.close()
        # A backend may raise anything here, but the hub notices the end by itself.
        except Exception as error:  # noqa: BLE001
            _log.debug("disconnecting from the hub: %s", error)

    async def command(
        self,
        data: bytes,
        operation: str,
    ) -> None:
        """Write a command; retry while the hub is busy.

        Raises:
            HubBusyError: the hub stayed busy.
            HubRefusedError: the hub refused the command.
            HubTimeoutError: the hub did not acknowledge it; the link is dropped, since its state is
                unknown.
            HubDisconnectedError: the link is broken.
        """
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._answer_timeout_s
        pause_s = _BUSY_PAUSE_S
        while True:
            try:
                await self._write(data, operation)
            except HubBusyError:
                if loop.time() + pause_s > deadline_s:
                    raise
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, _LONGEST_BUSY_PAUSE_S)
            else:
                return

    async def download(self, blob: bytes) -> None:
        """Download a program to the hub.

        Raises:
            HubProtocolError: the program is too large for the hub, or the hub cannot run it.
            HubError: see ``command``.
        """
        capabilities = self.identity.capabilities
        if not capabilities.features & profile.Feature.MPY_V6:
            raise HubProtocolError(
                "the hub's firmware cannot run our programs; update it on code.pybricks.com"
            )
        if len(blob) > capabilities.max_program_bytes:
            raise HubProtocolError(
                f"the program has {len(blob)} bytes, the hub takes "
                f"{capabilities.max_program_bytes}; use a larger hub"
            )
        for command in profile.download(blob, capabilities.max_write_bytes):
            await self.command(command, "write the program onto the hub")

    async def start_program(self) -> None:
        """Start the program on the hub and wait until it runs or has ended.

        Raises:
            HubError: see ``command``.
        """
        slot = (self.status.slot,) if self.identity.capabilities.slots else ()
        # The last program has just ended, and the rest of its output may still come.
        if self._end_timer is not None:
            await asyncio.sleep(_OUTPUT_GRACE_S)
        self.output.begin()
        await self.command(
            bytes((PybricksCommand.START_USER_PROGRAM, *slot)),
            "write the command that starts the program",
        )
        self._is_running_expected = True
        # The first report from now on may still be from before the start, but the second one is
        # not.
        reports = self._reports
        await self._wait_for(
            lambda: self.is_running or self._reports >= reports + 2, self._answer_timeout_s
        )
        self._check_connected()
        # A short program may have ended between two reports.
        if not self.is_running:
            self._end_program()

    async def stop_program(self) -> None:
        """Stop the program, and with it the motors; wait until it has ended.

        Raises:
            HubTimeoutError: the program did not end.
            HubError: see ``command``.
        """
        self._is_running_expected = False
        await self.command(
            bytes((PybricksCommand.STOP_USER_PROGRAM,)), "write the command that stops the program"
        )
        # The acknowledgement only says that the command has arrived; that the motors stand, a
        # report says.
        has_ended = await self._wait_for(lambda: not self.is_running, self._answer_timeout_s)
        if not has_ended:
            raise HubTimeoutError("the program on the hub does not stop; press the hub's button")
        self.output.end(ProgramStoppedError, "the program on the hub was stopped; start it again")
        self._changed.set()
        self._check_connected()

    async def wait_for_output(
        self,
        data: bytes,
        timeout_s: float,
    ) -> bool:
        """True if the program writes these bytes in time; they remain in the buffer."""
        await self._wait_for(lambda: self.output.contains(data) or not self.is_running, timeout_s)
        return self.output.contains(data)

    async def wait_until_readable(self, timeout_s: float) -> None:
        """Wait until reading the output returns something, or raises, or the time is up."""
        await self._wait_for(lambda: self.output.is_readable, timeout_s)

    async def _identify(self) -> HubIdentity:
        version = profile.parse_version(await self._port.read(profile.PROFILE_VERSION_UUID))
        # Newer versions only add to the profile, as it promises.
        if version > profile.NEWEST_PROFILE:
            newest = ".".join(map(str, profile.NEWEST_PROFILE))
            _log.warning(
                "the hub speaks Pybricks Profile %d.%d, newer than the known %s; update brickhub",
                *version,
                newest,
            )
        if version < profile.OLDEST_PROFILE:
            raise HubProtocolError(
                f"the hub speaks Pybricks Profile {version[0]}.{version[1]}; update it on "
                "code.pybricks.com"
            )
        pnp_id = await self._port.read(profile.PNP_ID_UUID)
        kind = profile.parse_hub_kind(pnp_id, self._port.name)
        firmware = await self._port.read(profile.FIRMWARE_REVISION_UUID)
        capabilities = await self._port.read(profile.CAPABILITIES_UUID)
        return HubIdentity(
            name=self._port.name,
            address=self._port.address,
            kind=kind,
            firmware=firmware.decode("utf-8", "replace"),
            profile_version=version,
            capabilities=profile.parse_capabilities(capabilities),
        )

    async def _write(
        self,
        data: bytes,
        operation: str,
    ) -> None:
        # There is a timeout, because a hub may lose the acknowledgement of a write when a report
        # crosses it.
        try:
            async with asyncio.timeout(self._answer_timeout_s) as timeout, self._write_lock:
                self._check_connected()
                self._write_timeout = timeout
                try:
                    await self._port.write(data, operation)
                finally:
                    self._write_timeout = None
        except HubDisconnectedError:
            self._lose("it takes no commands")
            raise
        except TimeoutError:
            # A loss ends a pending write by its timeout, but is the better reason.
            self._check_connected()
            self._lose("it did not acknowledge a command")
            raise HubTimeoutError(
                f"could not {operation}: the hub did not acknowledge it within "
                f"{self._answer_timeout_s:g} s; open the link again"
            ) from None

    async def _wait_for(
        self,
        condition: Callable[[], bool],
        timeout_s: float,
    ) -> bool:
        """Wait until ``condition()``, or until the link is lost or the time is up."""
        try:
            async with asyncio.timeout(timeout_s):
                while not condition() and self.is_connected:
                    # Nothing can change in between, because events are handled in this same thread.
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            pass
        return condition()

    def _check_connected(self) -> None:
        if self._loss is not None:
            raise HubDisconnectedError(f"the link to the hub is lost ({self._loss}); open it again")

    def _on_event(self, data: bytes) -> None:
        # One broken notification is no reason to give up the link.
        try:
            event = profile.parse_event(data)
        except HubProtocolError as error:
            _log.warning("%s", error)
            return
        if isinstance(event, bytes):
            self.output.put(event)
        elif isinstance(event, StatusReport):
            self._on_status(event)
        self._changed.set()

    def _on_status(self, report: StatusReport) -> None:
        # A report comes every 500 ms, so only what is new in it is passed on.
        before = self.status.flags if self._reports else Status(0)
        self._reports += 1
        self.status = report
        set_flags = report.flags & ~before
        cleared_flags = before & ~report.flags
        if set_flags & (Status.BATTERY_LOW | Status.BATTERY_EMPTY):
            _log.warning("the hub's battery is low; charge it soon")
        if set_flags & (Status.BATTERY_HOT | Status.BATTERY_TOO_HOT):
            _log.warning("the hub's battery is hot; let it rest")
        # The hub itself announces its shutdown, before the link breaks.
        if set_flags & (Status.SHUTDOWN | Status.SHUTDOWN_REQUESTED):
            self._lose("the hub is switching off")
        elif cleared_flags & Status.USER_PROGRAM_RUNNING and self._is_running_expected:
            self._end_program()

    def _end_program(self) -> None:
        self._is_running_expected = False
        self._end_timer = asyncio.get_running_loop().call_later(_OUTPUT_GRACE_S, self._end_output)

    def _end_output(self) -> None:
        self._end_timer = None
        self.output.end(ProgramStoppedError, "the program on the hub has ended; start it again")
        self._changed.set()

    def _lose(self, reason: str) -> None:
        # The first reason is the cause, and later ones are its consequences.
        if self._loss is not None:
            return
        self._loss = reason
        if self._end_timer is not None:
            self._end_timer.cancel()
        self.output.end(
            HubDisconnectedError, f"the link to the hub is lost ({reason}); open it again"
        )
        # This wakes up a pending write, for which no backend promises an error.
        if self._write_timeout is not None and not self._write_timeout.expired():
            self._write_timeout.reschedule(0)
        self._changed.set()
