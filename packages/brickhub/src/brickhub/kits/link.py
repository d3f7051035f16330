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
"""Time beyond the step after which an endless move ends, if no other command comes; as the shortest
time of the watchdog of a hub."""
_SILENCE_S = 1.0
"""Silence after which a device is taken for lost, whose reports come at least that often."""
_CONNECT_S = 20.0
_DISCONNECT_S = 3.0
_WAIT_S = 0.005
"""Pause between two looks for a report: a third of the period of the reports."""
_DRIVE_DEG_S = 400.0
"""Speed of wheels that drive a distance or turn by an angle: Pybricks' default, 40 % of the
largest."""

Move = tuple[float, float | None]
"""Speed in deg/s, and the angle to turn by in deg, or ``None`` to go on; of a motor's output."""


class _Device:
    """One device, connected or not: LEGO's object, when its last report came, and the last one of a
    connection event before."""

    def __init__(
        self,
        part: KitPart,
        radio: Radio,
    ) -> None:
        self.part = part
        self._radio = radio
        # LEGO's classes are named after the products, such as DoubleMotor.
        package = lego_package(is_silent=True)
        kind = getattr(package, part.product.title.replace(" ", ""))
        self.lego: Any = kind()
        self.arrived_s = -math.inf
        self.before_s = -math.inf
        self.reports = 0
        self.lego.set_notification_callback(self._report)

    def _report(self, _notification: object) -> None:
        # The first report is the first moment in the package's own thread, whose loop this is.
        if not self.reports:
            asyncio.get_running_loop().set_exception_handler(_note)
        now_s = self._radio.now_s()
        # The reports of one event come at once, and events are further apart than this.
        if now_s - self.arrived_s > PERIOD_MS / 2000:
            self.before_s = self.arrived_s
        self.arrived_s = now_s
        self.reports += 1

    def connect(self) -> None:
        """Raises HubNotFoundError if it is not in reach, HubRefusedError if its firmware does not
        suit LEGO's package."""
        title = self.part.product.title
        found = self._radio.search(self.part)

        def connect() -> None:
            self.lego.connect(device_notification_delay=PERIOD_MS, **found)

        try:
            self._radio.run(connect, _CONNECT_S)
        except errors.HubError:
            raise
        except Exception as error:
            # The package's errors have no common class; one of them says that versions do not
            # agree.
            reason = errors.message_of(error)
            raise errors.HubRefusedError(f"the {title} refuses the connection: {reason}") from error
        # The package raises nothing if a device is not found.
        if not self.lego.connected:
            raise errors.HubNotFoundError(
                f"no {title} is in reach; switch it on, and bring it near"
            )
        # A device's silence counts from here on, until it reports.
        self.arrived_s = self._radio.now_s()

    def disconnect(self) -> None:
        """End the connection, if there is one, for a few seconds at most."""
        # The device may be gone already.
        with contextlib.suppress(Exception):
            self._radio.run(self.lego.disconnect, _DISCONNECT_S)
        # This is done even if disconnecting failed, so that a later `open` connects it anew.
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

    def __init__(
        self,
        radio: Radio,
        robot: Robot,
        interface: kinds.Interface,
    ) -> None:
        super().__init__(HOLD_S)
        self._radio = radio
        self._robot = robot
        self._interface = interface
        _check(robot, interface)
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
                for part in self._parts:
                    self.devices[part.ports] = _Device(part, self._radio)
            for device in self.devices.values():
                # The package believes in a link until the radio gives it up, which takes long.
                if device.lego.connected and self._age_s(device) > _SILENCE_S:
                    device.disconnect()
                if not device.lego.connected:
                    device.connect()
            self._opened_s = self.now_s()
            self._due_s = -math.inf
            # Our handler must run before the one of the package, which ends its thread and could
            # not start it again.
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
        # Sleeping for no time lets a world in real time catch up with what the caller took.
        self._radio.sleep(0.0)
        started_s = self.now_s()
        amounts = self._amounts(list(values))
        self.state = after(self.state, Cause.ACTED)
        settle = self._interface.settle
        with self._fault():
            self._start(amounts)
            if settle.fixed_ms is not None:
                # Steps are counted from the end of the last one, so that they are equally long
                # whatever a caller takes in between. If it took longer than a step, they are
                # counted from now.
                step_s = settle.fixed_ms / 1000
                due_s = self._due_s + step_s
                self._due_s = due_s if due_s > started_s else started_s + step_s
                rest_s = self._due_s - self.now_s()
                self._radio.sleep(max(0.0, rest_s))
            else:
                self._await_moves(started_s + settle.longest_ms / 1000)
            self._await_reports(started_s, under_commands=True)
            # Another thread may have stopped the robot while this one waited.
            self._check_halted()
            return self._reading(started_s)

    def _amounts(self, values: list[float]) -> list[float]:
        """The commands, each within its range. Raises EncodingError if they are none."""
        commands = self._interface.commands
        count = len(commands)
        is_finite = all(map(math.isfinite, values))
        if len(values) != count or not is_finite:
            raise EncodingError(f"{values} are no {count} numbers; give one for each command")
        amounts = []
        for value, command in zip(values, commands, strict=True):
            amount = max(value, command.low)
            amounts.append(min(amount, command.high))
        return amounts

    def rest(self) -> None:
        """Stop the motors. Raises HubError if the link is not open, or failed."""
        self._require_open()
        with self._fault():
            self._stop_motors()
            self.state = after(self.state, Cause.RESTED)

    def emergency_stop(self) -> None:
        """Stop the motors at once, from any thread. All later calls raise ``StoppedError`` until
        ``release``."""
        # This is set first, so that no later step of another thread starts a motor again.
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

    def _find(self, motor: Motor) -> tuple[_Device, int]:
        """The device of a motor, and its number there."""
        for ports, device in self.devices.items():
            if motor.port in ports:
                return device, ports.index(motor.port)
        # This cannot happen, because `parts_of` has made a device of each motor.
        raise KeyError(motor.port)

    def _start(self, amounts: list[float]) -> None:
        """Start the moves of a step; those of one device in one packet."""
        moves = self._moves_of(amounts)
        for device in self.devices.values():
            motors: list[tuple[Motor, int]] = []
            for name in moves:
                motor = self._robot.motor(name)
                carrier, index = self._find(motor)
                if carrier is device:
                    motors.append((motor, index))
            if not motors:
                continue
            # One packet carries both commands, so that both wheels start at the same moment.
            with self._sending(device), device.lego.batch(blocking=False):
                for motor, index in motors:
                    speed_deg_s, angle_deg = moves[motor.name]
                    self._start_motor(
                        device.lego,
                        motor,
                        index,
                        speed_deg_s,
                        angle_deg,
                    )

    def _moves_of(self, amounts: list[float]) -> dict[str, Move]:
        """Moves of the motors, by name, in a step."""
        moves: dict[str, Move] = {}
        for command, amount in zip(self._interface.commands, amounts, strict=True):
            moves_by = _MOVES[type(command)]
            for name, (speed_deg_s, angle_deg) in moves_by(self._robot, command, amount).items():
                # A driving speed and a rate of turn move the same wheels, so they add up.
                before_deg_s, _ = moves.get(name, (0.0, None))
                moves[name] = (before_deg_s + speed_deg_s, angle_deg)
        return moves

    def _start_motor(
        self,
        lego: Any,
        motor: Motor,
        index: int,
        speed_deg_s: float,
        angle_deg: float | None,
    ) -> None:
        # Version 1.2.0 of the package rounds a negative number to the next larger one, -20 to -19,
        # so only directions are exact.
        shaft_deg_s = speed_deg_s * motor.shaft_turns
        is_reversed = shaft_deg_s * (1.0 if angle_deg is None else angle_deg) < 0
        how = {"motor": index, "direction": int(is_reversed), "blocking": False}
        speed_pct = round(100 * abs(shaft_deg_s) / FULL_SPEED_DEG_S)
        speed_pct = min(100, speed_pct)
        if angle_deg is not None:
            shaft_deg = round(abs(angle_deg * motor.shaft_turns))
            lego.motor_run_for_degrees(shaft_deg, speed=speed_pct, **how)
        elif speed_pct:
            # The move has to end by itself, in case no other command follows.
            step_ms = self._interface.settle.longest_ms
            hold_ms = step_ms + round(1000 * HOLD_S)
            lego.motor_run_for_time(hold_ms, speed=speed_pct, **how)
        else:
            lego.motor_stop(motor=index, blocking=False)

    def _stop_motors(self) -> None:
        for device in self.devices.values():
            product = device.part.product
            if product is Product.COLOR_SENSOR:
                continue
            # Without a name, `motor_stop` stops only the left motor of a pair.
            is_pair = product is Product.DOUBLE_MOTOR
            stop = device.lego.movement_stop if is_pair else device.lego.motor_stop
            with self._sending(device):
                stop(blocking=False)

    @contextlib.contextmanager
    def _sending(self, device: _Device) -> Iterator[None]:
        """Context of calls of LEGO's package, whose errors are those of a lost device."""
        if not device.lego.connected:
            raise errors.HubDisconnectedError(
                f"the {device.part.product.title} is gone; bring it near, and call open()"
            )
        try:
            yield
        # These errors are a mistake of ours in a call, and not one of the device.
        except (TypeError, ValueError):
            raise
        except Exception as error:
            raise errors.HubDisconnectedError(
                f"the {device.part.product.title} takes no command ({error}); call open()"
            ) from error

    def _age_s(self, device: _Device) -> float:
        return self.now_s() - device.arrived_s

    def _await_reports(
        self,
        since_s: float,
        *,
        under_commands: bool = False,
    ) -> None:
        """Wait until each device has reported after a time, or under the commands that were given
        then. Raises HubDisconnectedError or HubTimeoutError if one is lost."""
        for device in self.devices.values():
            title = device.part.product.title
            # The reports of the first event after the commands were made before these arrived, so
            # those of the second are awaited.
            while (device.before_s if under_commands else device.arrived_s) <= since_s:
                if not device.lego.connected:
                    raise errors.HubDisconnectedError(
                        f"the {title} is gone; bring it near, and call open()"
                    )
                if self._age_s(device) > _SILENCE_S:
                    raise errors.HubTimeoutError(
                        f"the {title} has been silent for {_SILENCE_S:g} s; check that it is on "
                        "and near, then call open()"
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
            # Waiting lets time pass, and raises if a device is lost meanwhile.
            self._await_reports(self.now_s())

    def _reading(self, started_s: float) -> Reading:
        values = []
        for channel in self._interface.channels:
            read = _VALUES[type(channel)]
            values.append(float(read(self, channel)))
        now_s = self.now_s()
        # A reading is only as fresh as the oldest of the reports that it is made of.
        age_s = max(self._age_s(device) for device in self.devices.values())
        round_trip_s = now_s - started_s
        self.statistics.record(round_trip_s, age_s)
        time_ms = round(1000 * (now_s - self._opened_s))
        return Reading(
            tuple(values),
            time_ms,
            round_trip_s,
            age_s,
        )


def _check(robot: Robot, interface: kinds.Interface) -> None:
    """Raise DescriptionError for what the devices cannot do, or cannot do safely."""
    for command in interface.commands:
        command.check(robot)
        if type(command) not in _MOVES:
            raise command.error(
                ": devices of LEGO's kits have no such move that ends by itself; use "
                "another command"
            )
    for channel in interface.channels:
        channel.check(robot)
        is_reported = type(channel) in _VALUES
        if isinstance(channel, kinds.SensorReading):
            is_reported = is_reported and channel.method in _METHODS
        if not is_reported:
            raise channel.error(": no device of LEGO's kits reports it; use another channel")
    # Our program on a hub clamps each target to the range, but here the device has the last word.
    for motor in robot.motors:
        if motor.range_deg is not None:
            raise errors.DescriptionError(
                f"motor '{motor.name}' has a range, which no device of LEGO's kits keeps; "
                "leave it out"
            )


def _note(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Say nothing of commands whose end nobody waits for, and whose device is lost."""
    if not isinstance(context.get("exception"), ConnectionError):
        loop.default_exception_handler(context)


def _rolled(
    robot: Robot,
    command: kinds.DriveStraight | kinds.Turn,
    amount: float,
) -> dict[str, Move]:
    names = command.motors(robot)
    turns_deg = command.wheel_turns_deg(robot, amount)
    return {name: (_DRIVE_DEG_S, turn) for name, turn in zip(names, turns_deg, strict=True)}


def _driven(
    robot: Robot,
    command: kinds.DriveSpeed | kinds.DriveTurnRate,
    rate: float,
) -> dict[str, Move]:
    # A rate has no turn of its own, but what the wheels turn for a distance or an angle is, for a
    # rate, their speed.
    names = command.motors(robot)
    speeds_deg_s = command.wheel_turns_deg(robot, rate)
    return {name: (speed, None) for name, speed in zip(names, speeds_deg_s, strict=True)}


def _turned(
    _robot: Robot,
    command: kinds.RunAngle,
    angle_deg: float,
) -> dict[str, Move]:
    return {command.motor: (command.speed_deg_s, angle_deg)}


def _run(
    _robot: Robot,
    command: kinds.RunSpeed,
    speed_deg_s: float,
) -> dict[str, Move]:
    return {command.motor: (speed_deg_s, None)}


_MOVES: Mapping[type[kinds.Command], Callable[[Robot, Any, float], dict[str, Move]]] = {
    kinds.RunAngle: _turned,
    kinds.RunSpeed: _run,
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
    # LEGO's package gives a list of motors for a Double Motor only.
    motors = device.lego.motor
    report = motors[index] if isinstance(motors, list) else motors
    angle_deg = float(report.position) / motor.shaft_turns
    return angle_deg % 360.0 if channel.wraps else angle_deg


def _imu(quantity: str) -> Callable[[KitLink, kinds.Channel], float]:
    def value(link: KitLink, _channel: kinds.Channel) -> float:
        # The first of its parts is the device that carries the robot.
        carrier = link.devices[link._parts[0].ports]
        number: float = vars(carrier.lego.imu_device)[quantity]
        return number

    return value


def _sensed(link: KitLink, channel: kinds.SensorReading) -> float:
    sensor = link._robot.sensor(channel.sensor)
    # A Color Sensor is a device of its own, so it is alone on its port.
    device = link.devices[sensor.port]
    return float(vars(device.lego.sensor)[_SEEN[channel.part]])


_VALUES: Mapping[type[kinds.Channel], Callable[[KitLink, Any], float]] = {
    kinds.MotorAngle: _motor_angle_deg,
    kinds.Pitch: _imu("pitch"),
    kinds.Roll: _imu("roll"),
    kinds.YawRate: _imu("gyroscopeZ"),
    kinds.SensorReading: _sensed,
}
"""Values of the channels that a device reports."""
