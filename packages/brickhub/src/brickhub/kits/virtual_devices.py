"""Behaviour of the devices of LEGO's kits of 2026 on a virtual robot: what they do on each command,
and what they report.

Motors are controlled as the firmware of a hub does. What LEGO does not publish is estimated, as
docs/kits.md tells.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import trunc

from brickhub.kits import kit_protocol as protocol
from brickhub.kits.radio import KitPart
from brickhub.robot import Direction
from brickhub.robot.spec import LOOKS
from brickhub.virtual.firmware import RefusedError, UnavailableError
from brickhub.virtual.firmware.control import OnCompletion
from brickhub.virtual.firmware.servo import Servo
from brickhub.virtual.machine import Machine
from brickhub.virtual.pybricks.parameters import nearest
from brickhub.virtual.pybricks.plug import Plug
from brickhub.virtual.stimuli import Hsv

Report = tuple[str, tuple[int, ...]]
_Command = Callable[[protocol.Message], None]
_END_STATES = ("COAST", "BRAKE", "HOLD", "CONTINUE", "COAST_SMART", "BRAKE_SMART", "BRAKE_SMART")
"""Ends of a move, by the number of the end state; the last one is that of -1."""
_DEFAULT_SPEED_PCT = 50
"""Speed of a command without one: the default of ``movement_move_tank_for_degrees`` in LEGO's
package."""
_ACCELERATION_DEG_S2_PER_PCT = 100
"""An estimate after SPIKE App 3, whose accelerations go up to 10000 degrees/s²."""
_FULL_LEVER_DEG = 45
"""Angle of a lever at 100 %; an estimate."""

_LEFT = 1
_RIGHT = 2

_FORWARD = 0
_BACKWARD = 1
_TO_LEFT = 2

_COUNTERCLOCKWISE = 1
_SHORTEST = 2

# A Color Sensor measures in these modes only.
_DETECT = 1
_AMBIENT = 2

_NO_GESTURE = -1
"""Number of no gesture; a virtual device never notices one."""
_REST_DEG_S = 10
"""Speed below which a motor has stopped at the end of a turn."""
_WINDOW_MS = 20
"""Window over which the speed is measured that tells how long slowing down takes."""
_LONGEST_TIMED_MS = 20_000
"""Longest move for a time that the firmware plans as one; a longer one is endless, and stopped when
its time is over."""

_FULL_MV = 8300
_EMPTY_MV = 6000

_MG_PER_MM_S2 = 1000 / 9810
"""Thousandths of g of an acceleration: the unit of the reports, after SPIKE App 3."""
_DETECTABLE: Mapping[int, Hsv] = {
    protocol.NO_COLOR: (0, 0, 0),
    1: (300, 100, 100),
    2: (270, 100, 100),
    3: (240, 100, 100),
    4: (200, 100, 100),
    5: (170, 100, 100),
    6: (120, 100, 100),
    7: (60, 100, 100),
    8: (30, 100, 100),
    9: (0, 100, 100),
    10: (0, 0, 100),
}
"""Colors that a Color Sensor names, by LEGO's numbers for them; black is none."""


class KitDevice:
    """One device: it obeys the packets that reach it and leaves its own in ``outbox``.

    Attributes:
        part: what it is of the robot.
        address, name: by which this computer tells it from others.
        is_connected: whether a computer is connected to it.
    """

    product: protocol.Product

    def __init__(
        self,
        machine: Machine,
        part: KitPart,
    ) -> None:
        self.part = part
        self.address = f"virtual-{part.ports or 'controller'}"
        self.name = self.product.title
        self.outbox: list[bytes] = []
        self.is_connected = False
        self._machine = machine
        # A device sends no notifications until a program asks for them.
        self._period_ms = 0
        self._due_ms = 0
        self._later: dict[str, _Command] = {
            "info": self._say_info,
            "uuid": self._say_uuid,
            "notifications": self._notify,
        }
        """Commands that have an answer of their own, or at their end; the others are accepted at
        once."""
        # What can only be seen or heard is accepted without effect, so that programs run unchanged.
        self._commands: dict[str, _Command] = {
            "program_flow": _ignore,
            "light": _ignore,
            "beep": _ignore,
            "stop_sound": _ignore,
        }

    def connect(self) -> None:
        """A computer connects: it takes commands from now on, and knows nothing of earlier ones."""
        self.is_connected = True
        self._period_ms = 0
        self.outbox.clear()

    def disconnect(self) -> None:
        """The link has ended: it stops, and can be found again."""
        self.is_connected = False

    def receive(self, packet: bytes) -> None:
        """Obey a packet. Raises HubProtocolError if it holds a message that no device knows."""
        for message in protocol.decode(packet):
            command = self._later.get(message.name)
            if command is None:
                command = self._commands.get(message.name)
            # The firmware answers what it refuses, and the device goes on.
            try:
                if command is None:
                    raise RefusedError("no such command")
                command(message)
            except (RefusedError, UnavailableError):
                self._answer(message, protocol.Done.REFUSED)
            else:
                if message.name in self._commands:
                    self._answer(message)

    def update(self) -> None:
        """Do what is due after a control step: ends of moves, and a notification."""
        if self._period_ms and self._machine.time_ms >= self._due_ms:
            self._due_ms = self._machine.time_ms + self._period_ms
            self.outbox.append(protocol.encode_notification(self._reports()))

    def _reports(self) -> list[Report]:
        charge_mv = self._machine.body.battery_mv - _EMPTY_MV
        battery_pct = 100 * charge_mv // (_FULL_MV - _EMPTY_MV)
        return [
            ("info", (_clamp(battery_pct, 0, 100), 0)),
            ("card", (protocol.NO_COLOR, 0)),
            ("button", (0,)),
        ]

    def _say_info(self, _message: protocol.Message) -> None:
        self.outbox.append(protocol.encode_info(self.product))

    def _say_uuid(self, message: protocol.Message) -> None:
        identity = self.address.encode()[-8:].rjust(8)
        self.outbox.append(bytes((message.answer_number, *identity)))

    def _notify(self, message: protocol.Message) -> None:
        self._answer(message)
        self._period_ms = message.values["delay_ms"]
        # The first notification comes with the answer, because a comment in LEGO's package expects
        # it within 0.2 s.
        self._due_ms = self._machine.time_ms
        # A subclass's `update` also ends moves, which happens after a control step and not within a
        # command.
        KitDevice.update(self)

    def _answer(
        self,
        message: protocol.Message,
        status: int = protocol.Done.COMPLETED,
    ) -> None:
        motors = message.values.get("motors")
        self.outbox.append(protocol.encode_answer(message.answer_number, status, motors))


def _ignore(_message: protocol.Message) -> None:
    """Accept a command of which a virtual device shows nothing."""


@dataclass
class _Drive:
    """Settings of a motor, or of both as a pair."""

    speed_pct: int = _DEFAULT_SPEED_PCT
    then: OnCompletion = OnCompletion.BRAKE_SMART

    def speed_deg_s(self, share: float) -> int:
        """A share of the speed, as the firmware takes it."""
        return round(share * self.speed_pct * protocol.FULL_SPEED_DEG_S / 100)


@dataclass(frozen=True)
class _Move:
    """Command whose motors, by their bits, still move."""

    message: protocol.Message
    bits: frozenset[int]
    is_done: Callable[[], bool]


class SingleMotor(KitDevice):
    """Device with a motor on each of its ports, in the order of their bits."""

    product = protocol.Product.SINGLE_MOTOR

    def __init__(
        self,
        machine: Machine,
        part: KitPart,
    ) -> None:
        super().__init__(machine, part)
        # Commands name motors by bits, so that one command can name several.
        self._servos: dict[int, Servo] = {}
        self._drives: dict[int, _Drive] = {}
        for index, port in enumerate(part.ports):
            bit = 1 << index
            self._servos[bit] = machine.servos[port]
            self._drives[bit] = _Drive()
        self._moves: list[_Move] = []
        self._endless: dict[int, float] = {}
        """Shares of the speed of motors, by their bits, that run until their next command."""
        self._later |= {
            "run": self._run,
            "run_for_time": self._run_for_time,
            "run_for_degrees": self._run_for_degrees,
            "run_to_absolute": self._run_to_absolute,
            "run_to_relative": self._run_to_relative,
        }
        self._commands |= {
            "reset_position": self._reset_position,
            "set_duty": self._set_duty,
            "stop": lambda message: self._stop(self._named(message)),
            "set_speed": lambda message: self._set_speed(message, self._named(message)),
            "set_end_state": lambda message: self._set_end_state(message, self._named(message)),
            "set_acceleration": lambda message: self._set_acceleration(
                message, self._named(message)
            ),
        }

    def connect(self) -> None:
        # If a lost link has not ended yet, its motors are still in use, and a servo refuses that
        # twice.
        self.disconnect()
        super().connect()
        for servo in self._servos.values():
            servo.setup(
                Direction.CLOCKWISE,
                1000,
                reset_angle=False,
                profile_deg=0,
            )

    def disconnect(self) -> None:
        super().disconnect()
        self._moves.clear()
        self._endless.clear()
        for servo in self._servos.values():
            servo.close()

    def update(self) -> None:
        for move in list(self._moves):
            # Stalls are looked at first, because `is_done` stops the motors when a timed move or a
            # turn ends.
            servos = [self._servos[bit] for bit in move.bits]
            is_stalled = any(servo.is_stalled() for servo in servos)
            if is_stalled or move.is_done():
                self._moves.remove(move)
                status = protocol.Done.INTERRUPTED if is_stalled else protocol.Done.COMPLETED
                self._answer(move.message, status)
        # This follows the ends of moves, so that a notification never shows an end before its
        # answer.
        super().update()

    def _reports(self) -> list[Report]:
        reports = super()._reports()
        for bit in self._servos:
            reports.append(("motor", self._motor_report(bit)))
        return reports

    def _motor_report(self, bit: int) -> tuple[int, ...]:
        servo = self._servos[bit]
        voltage_mv = servo.voltage_mv or 0
        # LEGO's message has the power in 0.01 %.
        power = trunc(voltage_mv * 10_000 / self._machine.body.battery_mv)
        angle_mdeg = self._machine.body.angle_mdeg(servo.port)
        absolute_deg = angle_mdeg % 360_000 // 1000
        speed_pct = 100 * servo.speed_deg_s() / protocol.FULL_SPEED_DEG_S
        return (
            bit,
            _state_of(servo),
            absolute_deg,
            power,
            _clamp(speed_pct, -128, 127),
            servo.angle_deg(),
            _NO_GESTURE,
        )

    def _named(self, message: protocol.Message) -> dict[int, _Drive]:
        """The motors that a message names, and their settings."""
        named_bits = message.values["motors"]
        named = {}
        for bit, drive in self._drives.items():
            if bit & named_bits:
                named[bit] = drive
        return named

    def _start(
        self,
        message: protocol.Message,
        drives: Mapping[int, _Drive],
        shares: Mapping[int, float],
        *,
        time_ms: int | None = None,
        angle_deg: Callable[[int], float] | None = None,
        until: Callable[[], bool] | None = None,
    ) -> None:
        """Move motors at shares of the speed of their settings: for a time, by angles, until
        something is so, or endlessly."""
        self._interrupt(drives)
        # The firmware does not plan longer moves as one.
        if time_ms is not None and time_ms > _LONGEST_TIMED_MS:
            until = self._stop_after(time_ms, drives)
            time_ms = None
        for bit, drive in drives.items():
            servo = self._servos[bit]
            speed_deg_s = drive.speed_deg_s(shares[bit])
            if time_ms is not None:
                servo.run_time(speed_deg_s, time_ms, drive.then)
            elif angle_deg is not None:
                servo.run_angle(speed_deg_s, round(angle_deg(bit)), drive.then)
            else:
                servo.run(speed_deg_s)
        if time_ms is not None or angle_deg is not None:
            until = self._all_done(drives)
        if until is not None:
            self._moves.append(_Move(message, frozenset(drives), until))
            return
        # An endless move is answered at once, because it has no end of its own.
        for bit in drives:
            self._endless[bit] = shares[bit]
        self._answer(message)

    def _all_done(self, drives: Mapping[int, _Drive]) -> Callable[[], bool]:
        """Condition that holds when the firmware's moves of all these motors have ended."""
        servos = [self._servos[bit] for bit in drives]
        return lambda: all(servo.is_done() for servo in servos)

    def _stop_after(
        self,
        time_ms: int,
        drives: Mapping[int, _Drive],
    ) -> Callable[[], bool]:
        """Condition that holds after a time, and then stops motors."""
        end_ms = self._machine.time_ms + time_ms

        def is_done() -> bool:
            if self._machine.time_ms < end_ms:
                return False
            self._halt(drives)
            return True

        return is_done

    def _halt(self, drives: Mapping[int, _Drive]) -> None:
        for bit, drive in drives.items():
            then = drive.then
            # Going on after a move has no meaning where the motor is to stop.
            if then is OnCompletion.CONTINUE:
                then = OnCompletion.COAST
            self._servos[bit].stop(then)

    def _interrupt(self, bits: Iterable[int]) -> None:
        """End what these motors do: their next command has come."""
        chosen = set(bits)
        for move in list(self._moves):
            if move.bits & chosen:
                self._moves.remove(move)
                self._answer(move.message, protocol.Done.INTERRUPTED)
        for bit in chosen:
            self._endless.pop(bit, None)

    def _run(
        self,
        message: protocol.Message,
        angle_deg: Callable[[int], float] | None = None,
        time_ms: int | None = None,
    ) -> None:
        drives = self._named(message)
        share = -1.0 if message.values["direction"] == _COUNTERCLOCKWISE else 1.0
        shares = dict.fromkeys(drives, share)
        self._start(
            message,
            drives,
            shares,
            time_ms=time_ms,
            angle_deg=angle_deg,
        )

    def _run_for_time(self, message: protocol.Message) -> None:
        self._run(message, time_ms=message.values["time_ms"])

    def _run_for_degrees(self, message: protocol.Message) -> None:
        self._run(message, lambda _bit: message.values["degrees"])

    def _run_by(
        self,
        message: protocol.Message,
        angle_deg: Callable[[Servo], float],
    ) -> None:
        """Turn each motor by an angle at the magnitude of its speed."""
        drives = self._named(message)
        # The sign of the angle gives the direction, and a sign of the speed would reverse it.
        shares = {}
        for bit, drive in drives.items():
            shares[bit] = math.copysign(1.0, drive.speed_pct)

        def angle_of(bit: int) -> float:
            return angle_deg(self._servos[bit])

        self._start(
            message,
            drives,
            shares,
            angle_deg=angle_of,
        )

    def _run_to_absolute(self, message: protocol.Message) -> None:
        direction = message.values["direction"]

        def angle_deg(servo: Servo) -> float:
            now_deg = self._machine.body.angle_mdeg(servo.port) / 1000
            clockwise_deg = (message.values["position"] - now_deg) % 360.0
            ways_deg = (clockwise_deg, clockwise_deg - 360.0)
            if direction < _SHORTEST:
                return ways_deg[direction]
            # At half a turn both ways are equally long, and the clockwise one comes first.
            choose = (min, max)[direction - _SHORTEST]
            return choose(ways_deg, key=abs)

        self._run_by(message, angle_deg)

    def _run_to_relative(self, message: protocol.Message) -> None:
        position_deg = message.values["position"]
        self._run_by(message, lambda servo: position_deg - servo.angle_deg())

    def _reset_position(self, message: protocol.Message) -> None:
        position_deg = message.values["position"]
        self._set(message, lambda servo: servo.reset_angle(position_deg))

    def _set_duty(self, message: protocol.Message) -> None:
        # LEGO's message has the duty in 0.01 %, but a servo takes percent.
        duty_pct = trunc(message.values["duty"] / 100)
        self._set(message, lambda servo: servo.dc(duty_pct))

    def _set(
        self,
        message: protocol.Message,
        change: Callable[[Servo], None],
    ) -> None:
        """Change each motor, which ends what it does."""
        drives = self._named(message)
        self._interrupt(drives)
        for bit in drives:
            change(self._servos[bit])

    def _stop(self, drives: Mapping[int, _Drive]) -> None:
        self._interrupt(drives)
        self._halt(drives)

    def _set_speed(
        self,
        message: protocol.Message,
        drives: Mapping[int, _Drive],
    ) -> None:
        for bit, drive in drives.items():
            drive.speed_pct = message.values["speed"]
            # A new speed acts at once on an endless move, but on other moves only with the next
            # one.
            share = self._endless.get(bit)
            if share is not None:
                self._servos[bit].run(drive.speed_deg_s(share))

    def _set_end_state(
        self,
        message: protocol.Message,
        drives: Mapping[int, _Drive],
    ) -> None:
        name = _END_STATES[message.values["end_state"]]
        for drive in drives.values():
            drive.then = OnCompletion[name]

    def _set_acceleration(
        self,
        message: protocol.Message,
        drives: Mapping[int, _Drive],
    ) -> None:
        # The firmware refuses an acceleration of 0.
        acceleration_pct = max(message.values["acceleration"], 1)
        deceleration_pct = max(message.values["deceleration"], 1)
        for bit in drives:
            settings = self._servos[bit].settings
            speed, _, _, torque = settings.limits()
            settings.set_limits(
                speed,
                acceleration_pct * _ACCELERATION_DEG_S2_PER_PCT,
                deceleration_pct * _ACCELERATION_DEG_S2_PER_PCT,
                torque,
            )


def _state_of(servo: Servo) -> protocol.MotorState:
    if servo.voltage_mv is not None and servo.is_stalled():
        return protocol.MotorState.STALLED
    if servo.control.is_active:
        # An endless move counts as done from its beginning, and one that goes on from its end.
        goes_on = servo.control.on_completion is OnCompletion.CONTINUE
        is_holding = servo.is_done() and not goes_on
        return protocol.MotorState.HOLDING if is_holding else protocol.MotorState.RUNNING
    if servo.voltage_mv:
        return protocol.MotorState.DUTY
    return protocol.MotorState.READY


class DoubleMotor(SingleMotor):
    """Device with two motors, left and right, that also moves both as a pair, and with an IMU."""

    product = protocol.Product.DOUBLE_MOTOR

    def __init__(
        self,
        machine: Machine,
        part: KitPart,
    ) -> None:
        super().__init__(machine, part)
        # One object serves both, because settings of the pair hold for the pair.
        settings_of_pair = _Drive()
        self._pair = {_LEFT: settings_of_pair, _RIGHT: settings_of_pair}
        self._steering_pct = 100
        self._yaw_face = 0
        self._yaw_offset = 0.0
        self._later |= {
            "move": self._move,
            "move_for_time": self._move_for_time,
            "move_for_degrees": self._move_for_degrees,
            "tank": lambda message: self._tank(message, None),
            "tank_for_degrees": lambda message: self._tank(message, message.values["degrees"]),
            "turn_for_degrees": self._turn,
        }
        self._commands |= {
            "stop_moving": lambda _: self._stop(self._pair),
            "set_move_speed": lambda message: self._set_speed(message, self._pair),
            "set_move_end_state": lambda message: self._set_end_state(message, self._pair),
            "set_move_acceleration": lambda message: self._set_acceleration(message, self._pair),
            "set_steering": self._set_steering,
            "set_yaw_face": self._set_yaw_face,
            "reset_yaw": lambda message: self._set_yaw(message.values["yaw"]),
        }

    def connect(self) -> None:
        super().connect()
        self._set_yaw(0)

    def _reports(self) -> list[Report]:
        return [
            *super()._reports(),
            ("imu", self._imu_report()),
            ("gesture", (_NO_GESTURE,)),
        ]

    def _imu_report(self) -> tuple[int, ...]:
        # The order matters, because each reading of a noisy sensor draws a random number.
        body = self._machine.body
        force_mm_s2 = body.acceleration_mm_s2()
        spin_deg_s = body.angular_velocity_deg_s()
        # An accelerometer at rest feels a force upward, so the face with most of it is on top.
        parts_mm_s2 = [_along(force_mm_s2, face) for face in range(len(protocol.FACES))]
        upper_face = parts_mm_s2.index(max(parts_mm_s2))
        yaw_deg = self._turned() + self._yaw_offset
        yaw_deg = (yaw_deg + 180) % 360 - 180
        tilt_deg = body.tilt_deg()
        force_mg = [_MG_PER_MM_S2 * value for value in force_mm_s2]
        numbers = (yaw_deg, *tilt_deg, *force_mg, *spin_deg_s)
        # All numbers are int16 in a report.
        fields = [_clamp(number, -32768, 32767) for number in numbers]
        return (upper_face, self._yaw_face, *fields)

    def _turned(self) -> float:
        """Degrees by which it has turned clockwise, as seen on the yaw face."""
        return -_along(self._machine.body.rotation_deg(), self._yaw_face)

    def _set_yaw(self, yaw_deg: int) -> None:
        self._yaw_offset = yaw_deg - self._turned()

    def _set_yaw_face(self, message: protocol.Message) -> None:
        self._yaw_face = message.values["face"] % len(protocol.FACES)
        self._set_yaw(0)

    def _set_steering(self, message: protocol.Message) -> None:
        self._steering_pct = message.values["steering"]

    def _shares(self, message: protocol.Message) -> dict[int, float]:
        """Shares of the speed for a direction; the left motor is mounted the other way round."""
        # At a steering of 100 % the robot turns on the spot, at 50 % around its inner wheel, and at
        # 0 % it drives straight, so the inner wheel's share falls with it.
        inner = 1.0 - self._steering_pct / 50
        direction = message.values["direction"]
        if direction == _FORWARD:
            return {_LEFT: -1.0, _RIGHT: 1.0}
        if direction == _BACKWARD:
            return {_LEFT: 1.0, _RIGHT: -1.0}
        if direction == _TO_LEFT:
            return {_LEFT: -inner, _RIGHT: 1.0}
        return {_LEFT: -1.0, _RIGHT: inner}

    def _move(self, message: protocol.Message) -> None:
        self._start(message, self._pair, self._shares(message))

    def _move_for_time(self, message: protocol.Message) -> None:
        shares = self._shares(message)
        time_ms = message.values["time_ms"]
        self._start(
            message,
            self._pair,
            shares,
            time_ms=time_ms,
        )

    def _move_for_degrees(self, message: protocol.Message) -> None:
        shares = self._shares(message)
        degrees = message.values["degrees"]
        self._start(
            message,
            self._pair,
            shares,
            angle_deg=lambda _bit: degrees,
        )

    def _tank(
        self,
        message: protocol.Message,
        degrees: int | None,
    ) -> None:
        """Move at two speeds, by ``degrees`` of the faster motor."""
        left = -message.values["left"] / 100
        right = message.values["right"] / 100
        shares = {_LEFT: left, _RIGHT: right}
        # Both speeds are shares of the full one, whatever speed is set for the pair.
        drives = {}
        for bit, drive in self._pair.items():
            drives[bit] = _Drive(100, drive.then)
        if degrees is None:
            self._start(message, drives, shares)
            return
        # If both speeds are 0 there is no faster one, and dividing by 1 gives no turn.
        fastest = max(abs(left), abs(right)) or 1.0

        def angle_deg(bit: int) -> float:
            return degrees * abs(shares[bit]) / fastest

        self._start(
            message,
            drives,
            shares,
            angle_deg=angle_deg,
        )

    def _turn(self, message: protocol.Message) -> None:
        """Turn by the IMU: slow down where the rest of the turn is as long as that takes, and
        stop."""
        start_deg = self._turned()
        wanted_deg = abs(message.values["degrees"])
        # A negative angle turns the other way: 2 is to the left, 3 to the right.
        if message.values["degrees"] < 0:
            message.values["direction"] ^= 1
        servos = [self._servos[bit] for bit in self._pair]
        is_slowing = False

        def is_done() -> bool:
            nonlocal is_slowing
            if is_slowing:
                if any(abs(servo.speed_deg_s()) > _REST_DEG_S for servo in servos):
                    return False
                self._halt(self._pair)
                return True
            # A motor that brakes from speed v at deceleration a turns as far as at v in the time v
            # / 2a.
            settings = servos[0].settings
            speed_steps_s = abs(servos[0].speed_deg_s(_WINDOW_MS)) * settings.steps_per_unit
            slow_s = speed_steps_s / (2 * settings.deceleration)
            rest_deg = wanted_deg - abs(self._turned() - start_deg)
            _, _, yaw_rate_deg_s = self._machine.body.angular_velocity_deg_s()
            if rest_deg <= slow_s * abs(yaw_rate_deg_s):
                is_slowing = True
                for servo in servos:
                    servo.run(0)
            return False

        # A turn is always on the spot, because the steering that is set is for moves.
        steering_pct = self._steering_pct
        self._steering_pct = 100
        shares = self._shares(message)
        self._steering_pct = steering_pct
        self._start(
            message,
            self._pair,
            shares,
            until=is_done,
        )


class ColorSensor(KitDevice):
    """Color sensor on a port."""

    product = protocol.Product.COLOR_SENSOR

    def __init__(
        self,
        machine: Machine,
        part: KitPart,
    ) -> None:
        super().__init__(machine, part)
        self._plug = Plug(machine, part.ports)
        self._mode = _DETECT
        self._commands["set_color_mode"] = self._set_mode

    def _set_mode(self, message: protocol.Message) -> None:
        self._mode = message.values["mode"]

    def _reports(self) -> list[Report]:
        color = (*self._seen(), self._mode)
        return [*super()._reports(), ("color", color)]

    def _seen(self) -> tuple[int, ...]:
        """Color, reflection, raw red, green and blue, hue, saturation, value."""
        if self._mode != _DETECT:
            ambient_pct = round(self._plug.ambient_pct()) if self._mode == _AMBIENT else 0
            return protocol.NO_COLOR, 0, 0, 0, 0, 0, 0, ambient_pct
        raw = self._plug.raw_rgb(False)
        hsv = self._plug.reflected_hsv(False)
        index = nearest(hsv, list(_DETECTABLE.values()))
        color = protocol.NO_COLOR if index is None else list(_DETECTABLE)[index]
        # The raw values of SPIKE's sensor have 10 bits, and those of the kits 8.
        reflection_pct = sum(raw) * 100 // 3072
        raw_8_bits = [min(value // 4, 255) for value in raw]
        return color, reflection_pct, *raw_8_bits, *hsv


class Controller(KitDevice):
    """Two levers in a person's hands. ``levers_pct``: their positions, left and right, -100 to
    100."""

    product = protocol.Product.CONTROLLER

    def __init__(
        self,
        machine: Machine,
        part: KitPart,
    ) -> None:
        super().__init__(machine, part)
        self.levers_pct = (0, 0)

    def _reports(self) -> list[Report]:
        levers_deg = (round(lever * _FULL_LEVER_DEG / 100) for lever in self.levers_pct)
        levers = (*self.levers_pct, *levers_deg)
        return [*super()._reports(), ("controller", levers)]


def devices_of(machine: Machine, parts: Iterable[KitPart]) -> list[KitDevice]:
    """The devices of a robot, and a Controller."""
    devices: list[KitDevice] = []
    for part in parts:
        kind = _KINDS[part.product]
        devices.append(kind(machine, part))
    # A Controller is no part of any robot, but a program may ask for one.
    devices.append(Controller(machine, KitPart(protocol.Product.CONTROLLER, "")))
    return devices


_KINDS = {kind.product: kind for kind in (SingleMotor, DoubleMotor, ColorSensor)}


def _along(vector: tuple[float, float, float], face: int) -> float:
    """Component of a vector in the axes of a device out of one of its faces."""
    direction = LOOKS[protocol.FACES[face]]
    return sum(a * b for a, b in zip(vector, direction, strict=True))


def _clamp(
    value: float,
    low: int,
    high: int,
) -> int:
    return max(low, min(high, round(value)))
