"""Link to the devices of LEGO's kits, through LEGO's own package.

No program of ours runs on a device, and so no watchdog: it gets only commands that end by
themselves, at the latest 0.4 s after the step. Speeds are whole percents there. A device reports by
itself, up to 67 times a second; a reading is its latest report. A step ends with reports that were
made under its commands, as that of a hub: those of the second connection event after it began.
"""

import asyncio
import atexit
import contextlib
import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from brickhub import errors
from brickhub.hub import interface as kinds
from brickhub.hub.link.robot_link import Reading, RobotLink
from brickhub.hub.link.states import Cause, LinkState, after
from brickhub.hub.protocol import EncodingError
from brickhub.kits.kit_protocol import FULL_SPEED_DEG_S, Product
from brickhub.kits.radio import KitPart, Radio, lego_package, parts_of
from brickhub.robot import Motor, Robot

_log = logging.getLogger(__name__)

PERIOD_MS = 15
"""Period of the reports: the shortest that a device takes."""
HOLD_S = 0.4
"""Time beyond the step after which an endless move ends, if no other command comes; as the watchdog
of a hub."""
_SILENCE_S = 1.0
"""Silence after which a device is taken for lost, whose reports come at least that often."""
_CONNECT_S = 20.0
_DISCONNECT_S = 3.0
_WAIT_S = 0.005
_DRIVE_DEG_S = 400.0
"""Speed of wheels that drive a distance or turn by an angle: Pybricks' default, 40 % of the
largest."""

Move = tuple[float, float | None]
"""Speed in deg/s, and the angle to turn by in deg, or ``None`` to go on; of a motor's output."""


class _Device:
    """One device, connected or not: LEGO's object, when its last report came, and the last one of a
    connection event before."""

    def __init__(self, part: KitPart, radio: Radio) -> None:
        self.part = part
        self._radio = radio
        self.lego: Any = vars(lego_package(is_silent=True))[part.product.title.replace(" ", "")]()
        self.arrived_s = self.before_s = -math.inf
        self.reports = 0
        self.lego.set_notification_callback(self._report)

    def _report(self, _notification: object) -> None:
        if not self.reports:
            asyncio.get_running_loop().set_exception_handler(_note)
        now_s = self._radio.now_s()
        # those of one event come at once, and are made further apart
        if now_s - self.arrived_s > PERIOD_MS / 2000:
            self.before_s = self.arrived_s
        self.arrived_s = now_s
        self.reports += 1

    def connect(self) -> None:
        """Raises HubNotFoundError if it is not in reach, HubRefusedError if its firmware does not
        suit LEGO's package."""
        found = self._radio.search(self.part)
        try:
            self._radio.run(
                lambda: self.lego.connect(device_notification_delay=PERIOD_MS, **found), _CONNECT_S
            )
        except errors.HubError:
            raise
        except Exception as error:
            raise errors.HubRefusedError(
                f"the {self.part.product.title} refuses the connection: {errors.message_of(error)}"
            ) from error
        if not self.lego.connected:
            raise errors.HubNotFoundError(
                f"no {self.part.product.title} is in reach; switch it on, and bring it near"
            )
        self.arrived_s = self._radio.now_s()

    def disconnect(self) -> None:
        """End the connection, if there is one, for a few seconds at most."""
        with contextlib.suppress(Exception):  # it may be gone already
            self._radio.run(self.lego.disconnect, _DISCONNECT_S)
        self.lego.connected = False


class KitLink(RobotLink):
    """Link to one robot of LEGO's kits.

    Args:
        radio: how to reach the devices, real or virtual.
        robot, interface: robot, and its commands and channels.

    Attributes:
        devices: its devices, by the ports that they stand for; empty before the first ``open``.

    Raises:
        DescriptionError: a command does not end by itself, or no device reports a channel.
    """

    def __init__(self, radio: Radio, robot: Robot, interface: kinds.Interface) -> None:
        super().__init__(HOLD_S)
        self._radio = radio
        self._robot = robot
        self._interface = interface
        for command in interface.commands:
            command.check(robot)
            if type(command) not in _MOVES:
                raise command.error(
                    ": devices of LEGO's kits have no such move that ends by itself; use "
                    "another command"
                )
        for channel in interface.channels:
            channel.check(robot)
            if type(channel) not in _VALUES or (
                isinstance(channel, kinds.SensorReading) and channel.method not in _METHODS
            ):
                raise channel.error(": no device of LEGO's kits reports it; use another channel")
        for motor in robot.motors:
            if motor.range_deg is not None:
                raise errors.DescriptionError(
                    f"motor '{motor.name}' has a range, which no device of LEGO's kits keeps; "
                    "leave it out"
                )
        self._parts = parts_of(robot)
        self.devices: dict[str, _Device] = {}
        self._due_s = -math.inf
        self._opened_s = 0.0

    def open(self) -> None:
        """Connect to all devices that are not connected; without effect on an open link.

        Raises:
            MediumUnavailableError: LEGO's package is not installed.
            HubNotFoundError: a device is not in reach.
            HubTimeoutError, HubRefusedError: a device does not answer, or needs an update.
            StoppedError: an emergency stop came before.
        """
        self._check_halted()
        if self.is_open:
            return
        with self._fault():
            if not self.devices:
                self._radio.attach()
                self.devices = {part.ports: _Device(part, self._radio) for part in self._parts}
            for device in self.devices.values():
                if device.lego.connected and self._age_s(device) > _SILENCE_S:
                    device.disconnect()
                if not device.lego.connected:
                    device.connect()
            self._opened_s = self.now_s()
            self._due_s = -math.inf
            # before the package ends its thread, which it could not start again
            atexit.register(self.close)
            self.state = after(self.state, Cause.OPENED)

    def read(self) -> Reading:
        """Read the next reports. Raises HubError if the link is not open, HubDisconnectedError or
        HubTimeoutError if a device is lost."""
        self._require_open()
        with self._fault():
            started_s = self.now_s()
            self._await_reports(started_s)
            return self._reading(started_s)

    def act(self, values: Iterable[float]) -> Reading:
        """Give the commands ``[n_commands]``, in their units, and read the channels at the end of
        the step. Steps of a fixed time start that time apart, if the caller takes less time than
        that between them.

        Raises:
            EncodingError: the wrong number of values, or one that is not a number; nothing was
                sent.
            HubError: the link is not open, or a device is lost.
            StoppedError: an emergency stop came before or meanwhile.
        """
        self._require_open()
        self._radio.sleep(0.0)  # a world in real time catches up with what the caller took
        started_s = self.now_s()
        settle = self._interface.settle
        commands = self._interface.commands
        given = list(values)
        if len(given) != len(commands) or not all(map(math.isfinite, given)):
            raise EncodingError(
                f"{given} are no {len(commands)} numbers; give one for each command"
            )
        amounts = [
            min(max(value, command.low), command.high)
            for value, command in zip(given, commands, strict=True)
        ]
        self.state = after(self.state, Cause.ACTED)
        with self._fault():
            self._start(amounts)
            if settle.fixed_ms is not None:
                step_s = settle.fixed_ms / 1000
                self._due_s = (
                    self._due_s + step_s if self._due_s + step_s > started_s else started_s + step_s
                )
                self._radio.sleep(max(0.0, self._due_s - self.now_s()))
            else:
                self._await_moves(started_s + settle.longest_ms / 1000)
            self._await_reports(started_s, under_commands=True)
            self._check_halted()
            return self._reading(started_s)

    def rest(self) -> None:
        """Stop the motors. Raises HubError if the link is not open, or failed."""
        self._require_open()
        with self._fault():
            self._stop_motors()
            self.state = after(self.state, Cause.RESTED)

    def emergency_stop(self) -> None:
        """Stop the motors at once, from any thread. All later calls raise ``StoppedError`` until
        ``release``."""
        self._halted.set()
        if self.is_open:
            self._stop_motors()

    def now_s(self) -> float:
        """Time of the devices' clock: the computer's, or the simulated one."""
        return self._radio.now_s()

    def stop(self) -> None:
        """Stop the motors. Raises HubError if a device is lost; its last command then ends by
        itself."""
        if self.is_open:
            self._stop_motors()
        self.state = after(self.state, Cause.STOPPED)

    def close(self) -> None:
        """Stop and disconnect. May be called in any state and repeatedly, and never raises."""
        try:
            self.stop()
        except errors.HubError as error:
            _log.warning("closing the link to LEGO's devices: could not stop (%s)", error)
        for device in self.devices.values():
            if device.lego.connected:
                device.disconnect()
        self.state = LinkState.DISCONNECTED
        atexit.unregister(self.close)

    # ---- inside

    def _find(self, motor: Motor) -> tuple[_Device, int]:
        """The device of a motor, and its number there."""
        ports = next(ports for ports in self.devices if motor.port in ports)
        return self.devices[ports], ports.index(motor.port)

    def _start(self, amounts: list[float]) -> None:
        """Start the moves of a step; those of one device in one packet."""
        moves: dict[str, Move] = {}
        for command, amount in zip(self._interface.commands, amounts, strict=True):
            for name, (speed, angle) in _MOVES[type(command)](self._robot, command, amount).items():
                moves[name] = (moves.get(name, (0.0, None))[0] + speed, angle)
        for device in self.devices.values():
            motors = {
                m: self._find(m)[1]
                for name in moves
                if self._find(m := self._robot.motor(name))[0] is device
            }
            if motors:
                with self._sending(device), device.lego.batch(blocking=False):
                    for motor, index in motors.items():
                        self._start_motor(device.lego, motor, index, *moves[motor.name])

    def _start_motor(
        self, lego: Any, motor: Motor, index: int, speed_deg_s: float, angle_deg: float | None
    ) -> None:
        # Version 1.2.0 of the package rounds a negative number to the next larger one, -20 to -19:
        # only directions are exact.
        clockwise = speed_deg_s * motor.shaft_turns * (1.0 if angle_deg is None else angle_deg)
        how = {"motor": index, "direction": int(clockwise < 0), "blocking": False}
        speed_pct = min(100, round(100 * abs(speed_deg_s * motor.shaft_turns) / FULL_SPEED_DEG_S))
        if angle_deg is not None:
            lego.motor_run_for_degrees(
                round(abs(angle_deg * motor.shaft_turns)), speed=speed_pct, **how
            )
        elif speed_pct:
            hold_ms = self._interface.settle.longest_ms + round(1000 * HOLD_S)
            lego.motor_run_for_time(hold_ms, speed=speed_pct, **how)
        else:
            lego.motor_stop(motor=index, blocking=False)

    def _stop_motors(self) -> None:
        for device in self.devices.values():
            if device.part.product is not Product.COLOR_SENSOR:
                is_pair = device.part.product is Product.DOUBLE_MOTOR
                with self._sending(device):
                    (device.lego.movement_stop if is_pair else device.lego.motor_stop)(
                        blocking=False
                    )

    @contextlib.contextmanager
    def _sending(self, device: _Device) -> Iterator[None]:
        """Context of calls of LEGO's package, whose errors are those of a lost device."""
        if not device.lego.connected:
            raise errors.HubDisconnectedError(
                f"the {device.part.product.title} is gone; bring it near, and call open()"
            )
        try:
            yield
        except (TypeError, ValueError):
            raise
        except Exception as error:
            raise errors.HubDisconnectedError(
                f"the {device.part.product.title} takes no command ({error}); call open()"
            ) from error

    def _age_s(self, device: _Device) -> float:
        return self.now_s() - device.arrived_s

    def _await_reports(self, since_s: float, *, under_commands: bool = False) -> None:
        """Wait until each device has reported after a time, or under the commands that were given
        then. Raises HubDisconnectedError or HubTimeoutError if one is lost."""
        for device in self.devices.values():
            while (device.before_s if under_commands else device.arrived_s) <= since_s:
                if not device.lego.connected:
                    raise errors.HubDisconnectedError(
                        f"the {device.part.product.title} is gone; bring it near, and call open()"
                    )
                if self._age_s(device) > _SILENCE_S:
                    silence = (
                        f"the {device.part.product.title} has been silent for {_SILENCE_S:g} s"
                    )
                    raise errors.HubTimeoutError(
                        f"{silence}; check that it is on and near, then call open()"
                    )
                self._radio.sleep(_WAIT_S)

    def _await_moves(self, end_s: float) -> None:
        """Wait until all moves have ended; those that take longer are stopped."""
        motors = [
            device
            for device in self.devices.values()
            if device.part.product is not Product.COLOR_SENSOR
        ]
        while not all(device.lego.done() for device in motors):
            if self.now_s() >= end_s:
                self._stop_motors()
                return
            self._await_reports(self.now_s())

    def _reading(self, started_s: float) -> Reading:
        values = tuple(
            float(_VALUES[type(channel)](self, channel)) for channel in self._interface.channels
        )
        now_s = self.now_s()
        age_s = max(self._age_s(device) for device in self.devices.values())
        self.statistics.record(now_s - started_s, age_s)
        return Reading(values, round(1000 * (now_s - self._opened_s)), now_s - started_s, age_s)


def _note(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Say nothing of commands whose end nobody waits for, and whose device is lost."""
    if not isinstance(context.get("exception"), ConnectionError):
        loop.default_exception_handler(context)


def _rolled(
    robot: Robot, command: kinds.DriveStraight | kinds.Turn, amount: float
) -> dict[str, Move]:
    turns_deg = command.wheel_turns_deg(robot, amount)
    return {
        name: (_DRIVE_DEG_S, turn_deg)
        for name, turn_deg in zip(command.motors(robot), turns_deg, strict=True)
    }


def _driven(
    robot: Robot, command: kinds.DriveSpeed | kinds.DriveTurnRate, rate: float
) -> dict[str, Move]:
    speeds_deg_s = command.wheel_turns_deg(robot, rate)
    return {
        name: (speed_deg_s, None)
        for name, speed_deg_s in zip(command.motors(robot), speeds_deg_s, strict=True)
    }


_MOVES: Mapping[type[kinds.Command], Callable[[Robot, Any, float], dict[str, Move]]] = {
    kinds.RunAngle: lambda robot, command, amount: {command.motor: (command.speed_deg_s, amount)},
    kinds.RunSpeed: lambda robot, command, amount: {command.motor: (amount, None)},
    kinds.DriveSpeed: _driven,
    kinds.DriveTurnRate: _driven,
    kinds.DriveStraight: _rolled,
    kinds.Turn: _rolled,
}
"""Moves of the motors by a command, which add up where several commands move one; others do not end
by themselves."""
_METHODS = ("reflection", "hsv")
_SEEN = {"hue": "hue", "saturation": "saturation", "value": "value", None: "reflection"}


def _motor_angle_deg(link: KitLink, channel: kinds.MotorAngle) -> float:
    motor = link._robot.motor(channel.motor)
    device, index = link._find(motor)
    # a Single Motor has one
    reports = device.lego.motor if isinstance(device.lego.motor, list) else [device.lego.motor]
    angle_deg = float(reports[index].position) / motor.shaft_turns
    return angle_deg % 360.0 if channel.wraps else angle_deg


def _imu(quantity: str) -> Callable[[KitLink, kinds.Channel], float]:
    return lambda link, channel: vars(link.devices[link._parts[0].ports].lego.imu_device)[quantity]


def _sensed(link: KitLink, channel: kinds.SensorReading) -> float:
    sensor = link.devices[link._robot.sensor(channel.sensor).port].lego.sensor
    return float(vars(sensor)[_SEEN[channel.part]])


_VALUES: Mapping[type[kinds.Channel], Callable[[KitLink, Any], float]] = {
    kinds.MotorAngle: _motor_angle_deg,
    kinds.Pitch: _imu("pitch"),
    kinds.Roll: _imu("roll"),
    kinds.YawRate: _imu("gyroscopeZ"),
    kinds.SensorReading: _sensed,
}
"""Values of the channels that a device reports."""
