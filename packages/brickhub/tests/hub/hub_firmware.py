"""Simulated hub firmware: commands, errors, buffers, status, and a running program.

The downloaded bytecode is matched with known sources, which run in the virtual hub in real time.
Subclasses provide the transport.
"""

from __future__ import annotations

import asyncio
import functools
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine
from typing import Any

from brickhub.hub.program.compile import MAIN_MODULE, compile_mpy
from brickhub.hub.transport import MAIN_FILE, HubModule
from brickhub.hub.transports import profile
from brickhub.hub.transports.profile import CommandError, Event, PybricksCommand, Status
from brickhub.robot import HubKind, Robot
from brickhub.virtual import interpreter
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.body import Body
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.exceptions import ProgramInterrupt
from brickhub.virtual.micropython.text import format_traceback
from brickhub.virtual.pybricks import modules

STDOUT_BYTES = 41
NOTIFIED_BYTES = 19
_PRODUCT_IDS = {
    HubKind.MOVE: 0x40,
    HubKind.CITY: 0x41,
    HubKind.TECHNIC: 0x80,
    HubKind.PRIME: 0x81,
    HubKind.ESSENTIAL: 0x83,
    HubKind.EV3: 0xE2,
}


compiled = functools.cache(compile_mpy)
"""What a known program is on the hub; a large one takes longer than a host waits."""


class Refusal(Exception):
    """Error code of a refused command."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = int(code)


class _Stopped(BaseException):
    """Thrown into a program to stop it; programs cannot catch it."""


class ProgramRun:
    """A running program in a thread."""

    def __init__(self, hub: PlayedFirmware, found: dict[str, HubModule]) -> None:
        self._hub, self._found, self._machine = hub, found, hub.machine
        self._lock = threading.Lock()
        self._stdin, self._stdout = bytearray(), bytearray()
        self.inbox = bytearray()
        self._heard_ms = self._machine.time_ms
        self._stop = False
        self._start_s = time.monotonic() - self._machine.time_ms / 1000
        self._thread = threading.Thread(target=self._run, name="hub program", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stop = True

    def join(self) -> None:
        self._thread.join(5)

    def deliver(self, data: bytes) -> None:
        """Deliver bytes from the host, all or none."""
        with self._lock:
            if len(self._stdin) + len(data) > self._hub.machine.robot.hub.model.stdin_bytes:
                raise Refusal(CommandError.BUSY)
            self._stdin += data
            self._heard_ms = self._machine.time_ms

    def deliver_app_data(self, offset: int, data: bytes) -> None:
        """Overwrite the AppData, if the program has a buffer."""
        if not self.inbox:
            return
        if offset + len(data) > len(self.inbox):
            raise Refusal(CommandError.VALUE_NOT_ALLOWED)
        self.inbox[offset : offset + len(data)] = data

    def take(self) -> bytes:
        """Content of the next notification."""
        with self._lock:
            data = bytes(self._stdout[:NOTIFIED_BYTES])
            del self._stdout[:NOTIFIED_BYTES]
            return data

    # ---- the console of the program

    def available(self) -> int:
        return len(self._stdin)

    def read(self, n: int) -> bytes:
        while len(self._stdin) < n:
            self._machine.advance(1)
        with self._lock:
            data = bytes(self._stdin[:n])
            del self._stdin[:n]
            return data

    def write(self, data: bytes) -> None:
        while data and self._hub.is_connected:  # without a host, output is dropped
            with self._lock:
                room = STDOUT_BYTES - len(self._stdout)
                self._stdout += data[:room]
            data = data[room:]
            self._hub.request_flush()
            if data:
                self._machine.advance(1)

    def write_app_data(self, data: bytes) -> None:
        if not self._hub.is_connected:
            raise OSError(1)
        self._hub.submit(self._hub.notify(bytes((Event.WRITE_APP_DATA,)) + data))
        self._machine.advance(1)

    # ---- the thread

    def _run(self) -> None:
        self._machine.on_alarm = self._keep_pace
        self._machine.alarm_ms = self._machine.time_ms
        words = ""
        main = self._found[MAIN_MODULE]
        try:
            importable = modules(self._machine, self)
            importable.find_module = self._found.get
            interpreter.execute(main.source, main.file, importable, self)
        except (SystemExit, _Stopped):
            words = "\nThe program was stopped (SystemExit).\n"
        except (Exception, ProgramInterrupt) as error:  # noqa: BLE001  a program may raise anything
            words = format_traceback(error, main.file)
        self._machine.alarm_ms = None
        self._machine.stop_motors()
        with self._lock:
            self._stdout += words.replace("\n", "\r\n").encode()
        self._hub.submit(self._hub.program_ended(self))

    def _keep_pace(self) -> None:
        if self._stop:
            raise _Stopped
        while self._hub.by_hand:
            self._hub.by_hand.pop()()
        now_ms = self._machine.time_ms
        self._machine.alarm_ms = now_ms + 1
        if self._hub.is_driven:
            self._hub.longest_silent_drive_ms = max(
                self._hub.longest_silent_drive_ms, now_ms - self._heard_ms
            )
        ahead_s = self._start_s + self._machine.time_ms / 1000 - time.monotonic()
        if ahead_s > 0:
            time.sleep(ahead_s)


class PlayedFirmware(ABC):
    """A switched-on hub.

    Attributes:
        library: known programs.
        files: other known files by name.
        faults: error codes for the next commands of each kind.
        commands: kinds of all received commands.
        size: of the stored program, 0 for none.
        runs: number of program starts.
        longest_silent_drive_ms: longest time (hub time) with motor voltage and a silent host.
        flushes_late: whether it reports the program's end before its last output.
        by_hand: what somebody does with the robot, at its next moment while a program runs.
    """

    def __init__(self, robot: Robot, name: str, body: Body | None = None) -> None:
        self.name = name
        self.body = body or BenchBody(robot)
        self._watch_voltages()
        self.machine = Machine(self.body)
        self.library: list[str] = []
        self.files: dict[str, str] = {}
        self.faults: dict[PybricksCommand, list[int]] = {}
        self.commands: list[int] = []
        self.profile_version = "1.5.0"
        self.battery = Status(0)
        self.size = 0
        self.runs = 0
        self.longest_silent_drive_ms = 0
        self.flushes_late = False
        self.by_hand: list[Callable[[], object]] = []
        self._ram = bytearray(robot.hub.model.program_bytes)
        self._run: ProgramRun | None = None

    @property
    @abstractmethod
    def is_connected(self) -> bool:
        """Whether a host listens."""

    @abstractmethod
    def submit(self, coroutine: Coroutine[Any, Any, Any]) -> Any:
        """Run in the link's thread."""

    @abstractmethod
    async def notify(self, event: bytes) -> None:
        """Send an event to the host."""

    @abstractmethod
    async def settle(self) -> None:
        """A program has ended: whatever a hub does then."""

    def _watch_voltages(self) -> None:
        self.voltages_mv = dict.fromkeys((motor.port for motor in self.body.robot.motors), 0)
        set_voltage = self.body.set_voltage

        def watched(port: str, voltage_mv: int | None) -> None:
            set_voltage(port, voltage_mv)
            self.voltages_mv[port] = voltage_mv or 0

        self.body.set_voltage = watched

    @property
    def is_running(self) -> bool:
        return self._run is not None

    @property
    def is_driven(self) -> bool:
        """Whether a motor is under voltage."""
        return any(self.voltages_mv.values())

    def wait_until(self, attribute: str, value: object, timeout_s: float = 5.0) -> float:
        """Wait until an attribute has a value. Returns the seconds; fails after a timeout."""
        start_s = time.monotonic()
        while getattr(self, attribute) != value:
            assert time.monotonic() - start_s < timeout_s, (
                f"{attribute} is not {value} after {timeout_s} s"
            )
            time.sleep(0.005)
        return time.monotonic() - start_s

    def press_button(self) -> None:
        """The user presses the stop button."""
        if self._run is not None:
            self._run.stop()

    def close(self) -> None:
        run = self._run
        if run is not None:
            run.stop()
            run.join()

    def request_flush(self) -> None:
        self.submit(self._flush())

    @property
    def can_send(self) -> bool:
        """Whether output can be sent; otherwise it is buffered."""
        return True

    # ---- in the thread of the link

    @property
    def product(self) -> bytes:
        return struct.pack(
            "<BHHH", 1, profile.LEGO_COMPANY_ID, _PRODUCT_IDS[self.machine.robot.hub], 0
        )

    def capabilities(self, max_write_bytes: int) -> bytes:
        program_bytes = self.machine.robot.hub.model.program_bytes
        value = struct.pack("<HIIB", max_write_bytes, profile.Feature.MPY_V6 | 1, program_bytes, 5)
        return value if self._speaks(1, 5) else value[:-1]

    def _speaks(self, major: int, minor: int) -> bool:
        return profile.parse_version(self.profile_version.encode()) >= (major, minor)

    async def command(self, value: bytes) -> None:
        """One command; raises what it is refused with."""
        self.commands.append(value[0])
        refusals = self.faults.get(
            PybricksCommand(value[0])
            if value[0] in set(PybricksCommand)
            else PybricksCommand.START_REPL
        )
        if refusals:
            raise Refusal(refusals.pop(0))
        kind, payload = value[0], value[1:]
        if kind == PybricksCommand.STOP_USER_PROGRAM:
            self.press_button()
        elif kind == PybricksCommand.WRITE_STDIN:
            if self._run is not None:
                self._run.deliver(payload)
        elif kind == PybricksCommand.START_USER_PROGRAM and len(payload) > 1:
            raise Refusal(CommandError.VALUE_NOT_ALLOWED)
        elif kind in (
            PybricksCommand.START_USER_PROGRAM,
            PybricksCommand.WRITE_USER_PROGRAM_META,
            PybricksCommand.WRITE_USER_RAM,
        ):
            if self._run is not None:
                raise Refusal(CommandError.BUSY)
            await self._change_program(kind, payload)
        elif kind == PybricksCommand.WRITE_APP_DATA:
            if self._run is not None and self._run.inbox and len(payload) <= 2:
                raise Refusal(CommandError.VALUE_NOT_ALLOWED)
            if self._run is not None:
                self._run.deliver_app_data(struct.unpack("<H", payload[:2])[0], payload[2:])
        else:
            raise Refusal(CommandError.INVALID_COMMAND)

    async def _change_program(self, kind: int, payload: bytes) -> None:
        if kind == PybricksCommand.START_USER_PROGRAM:
            found = self._recognised()
            if MAIN_MODULE not in found:
                raise Refusal(CommandError.INVALID_COMMAND)
            self.runs += 1
            self._run = ProgramRun(self, found)
            await self.send_status()
            return
        number = struct.unpack("<I", payload[:4])[0]
        if number + len(payload) - 4 > len(self._ram):
            raise Refusal(CommandError.VALUE_NOT_ALLOWED)
        if kind == PybricksCommand.WRITE_USER_PROGRAM_META:
            self.size = number
        else:
            self._ram[number : number + len(payload) - 4] = payload[4:]

    def _recognised(self) -> dict[str, HubModule]:
        """Modules in memory by name."""
        known = [(MAIN_FILE, source) for source in self.library] + list(self.files.items())
        found, place = {}, 0
        while place < self.size:
            (length,) = struct.unpack_from("<I", self._ram, place)
            head, _, rest = bytes(self._ram[place + 4 : self.size]).partition(b"\0")
            name = head.decode("utf-8", "replace")
            for file, source in known:
                if compiled(source, file) == rest[:length]:
                    found[name] = HubModule(name, file, source)
            place += 4 + len(head) + 1 + length
        return found

    async def program_ended(self, run: ProgramRun) -> None:
        if not self.flushes_late:
            await self._flush()
        self._run = None
        await self.send_status()
        if self.flushes_late:
            await asyncio.sleep(0.1)
            await self._flush(run)
        await self.settle()

    async def _flush(self, run: ProgramRun | None = None) -> None:
        run = run or self._run
        while run is not None and self.can_send and (data := run.take()):
            await self.notify(bytes((Event.WRITE_STDOUT,)) + data)

    async def send_status(self) -> None:
        flags = self.battery | (Status.USER_PROGRAM_RUNNING if self._run is not None else 0)
        report = struct.pack("<BIBB", Event.STATUS_REPORT, flags, 0, 0)
        await self.notify(report[: 7 if self._speaks(1, 5) else 6 if self._speaks(1, 4) else 5])

    async def report_for_ever(self) -> None:
        while True:
            await asyncio.sleep(profile.STATUS_PERIOD_S)
            await self.send_status()
