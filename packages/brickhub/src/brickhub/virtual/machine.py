"""Machine behind a virtual hub: clock, the firmware's 5 ms control loop, and the body.

Time is a whole number of milliseconds and passes only in methods of :class:`Machine`; :class:`Pace`
keeps it in step with real time.
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from brickhub.errors import UnknownNameError, hint
from brickhub.robot.hardware import USUAL_HUB_NAME
from brickhub.virtual.air import Antenna
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.body import Body
from brickhub.virtual.firmware.drive_base import DriveBaseControl, GyroHeading
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.micropython.exceptions import SwitchedOff
from brickhub.virtual.own_devices import AnyOwnDevice
from brickhub.virtual.panel import Panel
from brickhub.virtual.run_log import RunLog

MAX_STEP_MS = 15
"""Maximum step of simulated time, for smooth pictures and a quick stop."""
CONTROL_LOOP_MS = 5
"""Period of the firmware's motor control."""
# A call takes some 10 us on a hub. Here calls are free, until there are many without a wait:
# otherwise no simulated time would ever pass in a program that only polls.
_FREE_CALLS = 200
_CALLS_PER_MS = 100
_DRAWINGS_PER_MS = 3
"""Drawings on a screen in a millisecond; an estimate from the pixels of a line of text, at 300
MHz."""
_AFTER_LOOP_TICKS = 10
"""Ticks (0.1 ms) from a control loop until the program goes on."""


@dataclass(frozen=True)
class FirmwareVersion:
    """A version of the firmware, by what a program can notice.

    Attributes:
        version, build: what ``pybricks.version`` tells.
        takes_packets: whether the input buffer takes at least a whole packet (since 4.1:
            pybricks/support#2788).
        has_hub_network: whether ``pybricks.messaging`` has ``HubNetwork``.
    """

    version: str
    build: str
    takes_packets: bool = False
    has_hub_network: bool = False


FIRMWARE_VERSIONS = {
    "4.1": FirmwareVersion(
        "4.1.0",
        "v4.1.0 on 2026-10-12",
        takes_packets=True,
        has_hub_network=True,
    ),
    "4.0": FirmwareVersion("4.0.1", "v4.0.1 on 2026-06-23"),
}
"""Stable versions, the newest first."""
NEWEST = "4.1"


def firmware_version(name: str) -> FirmwareVersion:
    """The version of that name. Raises UnknownNameError if it is not played."""
    if name not in FIRMWARE_VERSIONS:
        known = ", ".join(FIRMWARE_VERSIONS)
        raise UnknownNameError(
            f"the virtual hub plays no firmware '{name}'{hint(name, FIRMWARE_VERSIONS)}; "
            f"choose {known}"
        )
    return FIRMWARE_VERSIONS[name]


class Pace:
    """Delays simulated time to real time. ``clock_s, sleep``: replaced in tests."""

    def __init__(
        self,
        clock_s: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock_s = clock_s
        self._sleep = sleep
        self._start_s = clock_s()

    def wall_ms(self) -> float:
        """Real time since the start."""
        return (self._clock_s() - self._start_s) * 1000

    def keep(self, time_ms: float) -> None:
        """Wait if simulated time is ahead."""
        ahead_ms = time_ms - self.wall_ms()
        if ahead_ms > 0:
            self._sleep(ahead_ms / 1000)


@dataclass
class PortMode:
    """Mode of the device on a port, as the firmware's driver knows it (``port_lump.c``).

    Attributes:
        name: mode that it is in, or changes to.
        previous: mode in which the driver takes it to be until the hub is beyond ``changed_ms``.
        changed_ms: simulated time at which the device told its change of mode.
        ready_ms: simulated time from which its values are fresh and it can change its mode again.
    """

    name: str
    previous: str = ""
    changed_ms: int = -1
    ready_ms: int = 0


class Machine:
    """Clock, servos and drive bases of one virtual hub.

    Attributes:
        firmware: version of the firmware that is played.
        runs_program: whether a program runs that the stop button can stop.
        pace: keeps simulated time to real time at each control loop; ``None`` for as fast as
            possible.
        log: log of the run; ``None`` for none.
        own_devices: devices of the user's own, by port.
        antenna: what the hub broadcasts and hears.
        hub_name: what the hub is called.
        storage: what its programs have stored.
        panel: buttons, light, display and loudspeaker.
        heading: heading of the robot by the gyroscope.
        modes: mode of each device that has modes, by port.
        check_memory: returns the number of branches until its next call. Raises MemoryError if the
            program does not fit.
        time_ms: simulated time since the hub was switched on.
        time_ticks: the same for the motor control, in ticks of 0.1 ms. After the control loop the
            firmware sleeps until its next event, at most 1 ms, before it resumes the program:
            commands are that much later than the loop of the same ms.
        alarm_ms: simulated time at which ``on_alarm`` is called from within :meth:`advance`;
            ``None`` for never.
    """

    def __init__(
        self,
        body: Body,
        panel: Panel | None = None,
    ) -> None:
        self.robot = body.robot
        self.body = body
        self.panel = panel or Panel(body.robot.hub)
        # The panel has no clock of its own, so its lights and sounds go by simulated time.
        self.panel.clock_ms = lambda: self.time_ms
        self.firmware = FIRMWARE_VERSIONS[NEWEST]
        self.runs_program = False
        self.pace: Pace | None = None
        self.log: RunLog | None = None
        self.antenna = Antenna()
        self.own_devices: Mapping[str, AnyOwnDevice] = {}
        self.hub_name = USUAL_HUB_NAME
        self.storage = bytearray(body.robot.hub.model.storage_bytes)
        self.time_ms = 0
        self.time_ticks = _AFTER_LOOP_TICKS
        self.alarm_ms: int | None = None
        self.on_alarm: Callable[[], None] = lambda: None
        self.heading = GyroHeading(body)
        kinds = {motor.port: motor.kind for motor in body.robot.motors}
        # A bench may have motors that its robot does not name.
        if isinstance(body, FittedBench):
            kinds |= body.motors
        self.servos = {port: Servo(kind, port, body, self) for port, kind in kinds.items()}
        self.drive_bases: list[DriveBaseControl] = []
        self.modes: dict[str, PortMode] = {}
        # Where nobody counts memory, so long an interval means that hardly anybody asks again.
        self.check_memory: Callable[[], int] = lambda: 1 << 30
        self._branches_to_check = 0
        # The calls of the program are counted since it last waited.
        self._calls = 0
        self._products = 0
        self._drawings = 0
        # The body may be 1 ms ahead of the program, as after a stop in between; this tells whether
        # it is.
        self._is_ahead = False
        self._is_stopping = False

    @property
    def body_ms(self) -> int:
        """Simulated time of the body: the program's, or 1 ms ahead of it."""
        return self.time_ms + self._is_ahead

    def plug_in(
        self,
        port: str,
        device: str,
    ) -> bool:
        """Plug a device into a :class:`FittedBench`; returns whether it is on the port now."""
        if not (isinstance(self.body, FittedBench) and self.body.plug_in(port, device)):
            return False
        if port in self.body.motors and port not in self.servos:
            self.servos[port] = Servo(
                self.body.motors[port],
                port,
                self.body,
                self,
            )
        return True

    def new_drive_base(
        self,
        left: Servo,
        right: Servo,
        wheel_diameter_um: int,
        axle_track_um: int,
    ) -> DriveBaseControl:
        """A drive base in the control loop. Raises ValueError and OSError as
        :class:`DriveBaseControl`."""
        base = DriveBaseControl(
            left,
            right,
            wheel_diameter_um,
            axle_track_um,
            self.heading,
        )
        self.drive_bases.append(base)
        # A bench learns its wheels only now, and turns with them from here on. A wheel of diameter
        # d on a track t turns the robot by d / (2 t) times its own angle.
        if isinstance(self.body, FittedBench):
            turn = wheel_diameter_um / (2 * axle_track_um * left.settings.steps_per_unit)
            turns = {left.port: turn * left.direction, right.port: -turn * right.direction}
            self.body.put_on_wheels(turns)
        return base

    def advance(self, duration_ms: int) -> None:
        """Let time pass: physics, control loop, alarm."""
        # A program that waits pays nothing for what it computed before.
        self._calls = 0
        self._products = 0
        end_ms = self.time_ms + duration_ms
        while self.time_ms < end_ms:
            self._advance_towards(end_ms)

    def advance_to_alarm(self, duration_ms: int) -> int:
        """Let time pass, but not beyond the next alarm, which may bring input; returns the ms that
        passed."""
        self._calls = 0
        self._products = 0
        start_ms = self.time_ms
        end_ms = start_ms + duration_ms
        while self.time_ms < end_ms and not self._advance_towards(end_ms):
            pass
        return self.time_ms - start_ms

    def _advance_towards(self, end_ms: int) -> bool:
        """Advance to the next control loop, panel event or alarm, at most to ``end_ms``; returns
        whether it was an alarm."""
        time_ms = self.time_ms
        event_ms = self.panel.next_ms
        if self._is_ahead:
            # The body is there already, so only the program has to follow.
            stop_ms = time_ms + 1
            self.time_ms = stop_ms
            self._is_ahead = False
        else:
            next_ms = time_ms - time_ms % CONTROL_LOOP_MS + CONTROL_LOOP_MS
            stop_ms = next_ms if next_ms < end_ms else end_ms
            if event_ms is not None and event_ms < stop_ms:
                stop_ms = max(event_ms, time_ms + 1)
            alarm_ms = self.alarm_ms
            if alarm_ms is not None and time_ms < alarm_ms < stop_ms:
                stop_ms = alarm_ms
            self._run_to(stop_ms)
        self.time_ticks = stop_ms * 10 + _AFTER_LOOP_TICKS
        has_event = event_ms is not None and event_ms <= stop_ms
        if has_event and self.panel.poll(stop_ms) and self.runs_program:
            # The program ends before the millisecond of the event, but the body is already in it.
            self.time_ms = stop_ms - 1
            self.time_ticks = stop_ms * 10
            self._is_ahead = True
            raise SwitchedOff if self.panel.is_off else SystemExit
        if self.alarm_ms is None or stop_ms < self.alarm_ms:
            return False
        self.on_alarm()
        return True

    def _run_to(self, time_ms: int) -> None:
        """Advance the body to a time, and run the control loop if due."""
        self.body.advance_to(time_ms)
        self.time_ms = time_ms
        if time_ms % CONTROL_LOOP_MS == 0:
            self.time_ticks = time_ms * 10
            # Drive bases come first, because they tell their motors what to do in this loop.
            for base in self.drive_bases:
                base.update()
            for servo in self.servos.values():
                servo.update()
            if self.log is not None and time_ms % self.log.period_ms == 0:
                self.log.sample(time_ms, self.servos)
            if self.pace is not None:
                self.pace.keep(time_ms)

    def branch(self, value: Any) -> Any:
        """``value``, on which the program branches; the rest of the hub catches up first.

        A program resumes at the beginning of a millisecond, the rest of the hub only at the
        program's first branch in it, such as the next iteration of a loop.
        """
        # The innermost loops of programs come through here, so there are plain attributes and no
        # calls.
        if not (self._is_ahead or self._is_stopping):
            # The program has not resumed yet, so the old millisecond goes on for it.
            time_ms = self.time_ms
            time_ticks = self.time_ticks
            self._run_to(time_ms + 1)
            self.time_ms = time_ms
            self.time_ticks = time_ticks
            self._is_ahead = True
            self._branches_to_check -= 1
            if self._branches_to_check < 0:
                self._branches_to_check = self.check_memory()
        return value

    def turn(self, value: Any) -> Any:
        """``value``, for one iteration of a loop that ends by itself."""
        if not (self._is_ahead or self._is_stopping):
            self.branch(None)
        self._branches_to_check -= 1
        if self._branches_to_check < 0:
            self._branches_to_check = self.check_memory()
        return value

    @contextlib.contextmanager
    def stopping(self) -> Iterator[None]:
        """Context in which branches let no time pass."""
        self._is_stopping = True
        try:
            yield
        finally:
            self._is_stopping = False

    def turn_loop(self) -> None:
        """One iteration of a loop that may not wait."""
        self.turn(None)
        self.charge_call()

    def charge_call(self) -> None:
        """Count a call that takes no simulated time; time passes after many of them."""
        calls = self._calls + 1
        self._calls = calls
        if calls > _FREE_CALLS and calls % _CALLS_PER_MS == 0:
            self.advance(1)
            # The program did not wait here, so its calls are counted on.
            self._calls = calls

    def charge_product(self) -> None:
        """Count a product of floats; time passes by whole ms, so that what takes less between two
        waits is free."""
        self._products += 1
        if self._products * self.robot.hub.model.product_us >= 1000:
            self.advance(1)

    def charge_drawing(self) -> None:
        """Count a drawing on a screen; time passes by whole ms, after some of them."""
        self._drawings += 1
        if self._drawings >= _DRAWINGS_PER_MS:
            self._drawings = 0
            self.advance(1)

    @property
    def is_driven(self) -> bool:
        """Whether a motor has a voltage, be it 0, as one that brakes; the others coast."""
        return any(servo.voltage_mv is not None for servo in self.servos.values())

    def stop_motors(self) -> None:
        """End a program as the firmware does: motors coast and are closed, drive bases are
        released, the display is cleared, the radio is silent."""
        self.runs_program = False
        self.panel.start_program()
        self.antenna.fall_silent(self.time_ms)
        # Drive bases come before their motors, because they drive them.
        for base in self.drive_bases:
            base.release()
        self.drive_bases.clear()
        for servo in self.servos.values():
            servo.close()
        if self.log is not None:
            self.log.sample(self.time_ms, self.servos)
