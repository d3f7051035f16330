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
from brickhub.virtual.pybricks.device_modes import Plug
from brickhub.virtual.pybricks.parameters import nearest
from brickhub.virtual.stimuli import Hsv

Report = tuple[str, tuple[int, ...]]
_Command = Callable[[protocol.Message], None]
_END_STATES = ("COAST", "BRAKE", "HOLD", "CONTINUE", "COAST_SMART", "BRAKE_SMART", "BRAKE_SMART")
"""What a motor does after a move, by the number of the end state; the last one is that of -1."""
_DEFAULT_SPEED_PCT = 50
_ACCELERATION_DEG_S2_PER_PCT = 100
_FULL_LEVER_DEG = 45
_LEFT = 1
_RIGHT = 2
_FORWARD = 0
_BACKWARD = 1
_TO_LEFT = 2
_COUNTERCLOCKWISE = 1
_SHORTEST = 2
_DETECT = 1
_AMBIENT = 2
_NO_GESTURE = -1
_REST_DEG_S = 10
_WINDOW_MS = 20
_LONGEST_TIMED_MS = 20_000
_FULL_MV = 8300
_EMPTY_MV = 6000
_MG_PER_MM_S2 = 1000 / 9810
_DETECTABLE: Mapping[int, Hsv] = {
    protocol.NO_COLOR: (0, 0, 0), 1: (300, 100, 100), 2: (270, 100, 100), 3: (240, 100, 100),
    4: (200, 100, 100),
    5: (170, 100, 100), 6: (120, 100, 100), 7: (60, 100, 100), 8: (30, 100, 100), 9: (0, 100, 100),
    10: (0, 0, 100),
}  # fmt: skip


class KitDevice:
    """One device: it obeys the packets that reach it and leaves its own in ``outbox``.

    Attributes:
        part: what it is of the robot.
        address, name: by which this computer tells it from others.
        is_connected: whether a computer is connected to it.
    """

    product: protocol.Product

    def __init__(self, machine: Machine, part: KitPart) -> None:
        self.part = part
        self.address = f"virtual-{part.ports or 'controller'}"
        self.name = self.product.title
        self.outbox: list[bytes] = []
        self.is_connected = False
        self._machine = machine
        self._period_ms = self._due_ms = 0
        self._later: dict[str, _Command] = {
            "info": lambda _: self.outbox.append(protocol.encode_info(self.product)),
            "uuid": lambda message: self.outbox.append(
                bytes((message.answer_number, *self.address.encode()[-8:].rjust(8)))
            ),
            "notifications": self._notify,
        }
        """Commands that have an answer of their own, or at their end; the others are accepted at
        once."""
        self._commands: dict[str, _Command] = dict.fromkeys(
            ("program_flow", "light", "beep", "stop_sound"), lambda _: None
        )

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
            command = self._later.get(message.name) or self._commands.get(message.name)
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
        """What is due after a control step: ends of moves, and a notification."""
        if self._period_ms and self._machine.time_ms >= self._due_ms:
            self._due_ms = self._machine.time_ms + self._period_ms
            self.outbox.append(protocol.encode_notification(self._reports()))

    def _reports(self) -> list[Report]:
        battery_pct = 100 * (self._machine.body.battery_mv - _EMPTY_MV) // (_FULL_MV - _EMPTY_MV)
        return [
            ("info", (_clamp(battery_pct, 0, 100), 0)),
            ("card", (protocol.NO_COLOR, 0)),
            ("button", (0,)),
        ]

    def _notify(self, message: protocol.Message) -> None:
        self._answer(message)
        self._period_ms = message.values["delay_ms"]
        self._due_ms = self._machine.time_ms
        KitDevice.update(self)

    def _answer(self, message: protocol.Message, status: int = protocol.Done.COMPLETED) -> None:
        self.outbox.append(
            protocol.encode_answer(message.answer_number, status, message.values.get("motors"))
        )


@dataclass
class _Drive:
    """Settings of a motor, or of both as a pair."""

    speed_pct: int = _DEFAULT_SPEED_PCT
    then: OnCompletion = OnCompletion.BRAKE_SMART


@dataclass(frozen=True)
class _Move:
    """Command whose motors, by their bits, still move."""

    message: protocol.Message
    bits: frozenset[int]
    is_done: Callable[[], bool]


class SingleMotor(KitDevice):
    """Device with a motor on each of its ports, in the order of their bits."""

    product = protocol.Product.SINGLE_MOTOR

    def __init__(self, machine: Machine, part: KitPart) -> None:
        super().__init__(machine, part)
        self._servos = {1 << index: machine.servos[port] for index, port in enumerate(part.ports)}
        self._drives = {bit: _Drive() for bit in self._servos}
        self._moves: list[_Move] = []
        self._endless: dict[int, float] = {}
        self._later |= {
            "run": self._run,
            "run_for_time": lambda m: self._run(m, time_ms=m.values["time_ms"]),
            "run_for_degrees": lambda m: self._run(m, lambda _: m.values["degrees"]),
            "run_to_absolute": self._run_to_absolute,
            "run_to_relative": lambda m: self._run_by(
                m, lambda servo: m.values["position"] - servo.angle_deg()
            ),
        }
        self._commands |= {
            "reset_position": lambda m: self._set(
                m, lambda servo: servo.reset_angle(m.values["position"])
            ),
            "set_duty": lambda m: self._set(
                m, lambda servo: servo.dc(trunc(m.values["duty"] / 100))
            ),
            "stop": lambda m: self._stop(self._named(m)),
            "set_speed": lambda m: self._set_speed(m, self._named(m)),
            "set_end_state": lambda m: self._set_end_state(m, self._named(m)),
            "set_acceleration": lambda m: self._set_acceleration(m, self._named(m)),
        }

    def connect(self) -> None:
        self.disconnect()
        super().connect()
        for servo in self._servos.values():
            servo.setup(Direction.CLOCKWISE, 1000, reset_angle=False, profile_deg=0)

    def disconnect(self) -> None:
        super().disconnect()
        self._moves.clear()
        self._endless.clear()
        for servo in self._servos.values():
            servo.close()

    def update(self) -> None:
        for move in list(self._moves):
            is_stalled = any(self._servos[bit].is_stalled() for bit in move.bits)
            if is_stalled or move.is_done():
                self._moves.remove(move)
                self._answer(
                    move.message,
                    protocol.Done.INTERRUPTED if is_stalled else protocol.Done.COMPLETED,
                )
        super().update()

    def _reports(self) -> list[Report]:
        return [*super()._reports(), *(("motor", self._motor_report(bit)) for bit in self._servos)]

    def _motor_report(self, bit: int) -> tuple[int, ...]:
        servo = self._servos[bit]
        voltage_mv = servo.voltage_mv
        battery_mv = self._machine.body.battery_mv
        state = protocol.MotorState.READY
        if voltage_mv is not None and servo.is_stalled():
            state = protocol.MotorState.STALLED
        elif servo.control.is_active:
            state = protocol.MotorState.HOLDING if servo.is_done() else protocol.MotorState.RUNNING
        elif voltage_mv:
            state = protocol.MotorState.DUTY
        absolute = self._machine.body.angle_mdeg(servo.port) % 360_000 // 1000
        speed_pct = _clamp(100 * servo.speed_deg_s() / protocol.FULL_SPEED_DEG_S, -128, 127)
        return (
            bit,
            state,
            absolute,
            trunc((voltage_mv or 0) * 10_000 / battery_mv),
            speed_pct,
            servo.angle_deg(),
            _NO_GESTURE,
        )

    def _named(self, message: protocol.Message) -> dict[int, _Drive]:
        """The motors that a message names, and their settings."""
        return {bit: drive for bit, drive in self._drives.items() if bit & message.values["motors"]}

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
        # beyond what the firmware plans as one move
        if time_ms is not None and time_ms > _LONGEST_TIMED_MS:
            until = self._stop_after(time_ms, drives)
            time_ms = None
        for bit, drive in drives.items():
            servo = self._servos[bit]
            speed = round(shares[bit] * drive.speed_pct * protocol.FULL_SPEED_DEG_S / 100)
            if time_ms is not None:
                servo.run_time(speed, time_ms, drive.then)
            elif angle_deg is not None:
                servo.run_angle(speed, round(angle_deg(bit)), drive.then)
            else:
                servo.run(speed)
        if time_ms is not None or angle_deg is not None:
            until = lambda: all(self._servos[bit].is_done() for bit in drives)  # noqa: E731
        if until is None:
            self._endless.update((bit, shares[bit]) for bit in drives)
            self._answer(message)
        else:
            self._moves.append(_Move(message, frozenset(drives), until))

    def _stop_after(self, time_ms: int, drives: Mapping[int, _Drive]) -> Callable[[], bool]:
        """Condition that holds after a time, and then stops motors."""
        end_ms = self._machine.time_ms + time_ms

        def is_done() -> bool:
            if self._machine.time_ms >= end_ms:
                self._halt(drives)
            return self._machine.time_ms >= end_ms

        return is_done

    def _halt(self, drives: Mapping[int, _Drive]) -> None:
        for bit, drive in drives.items():
            self._servos[bit].stop(
                OnCompletion.COAST if drive.then is OnCompletion.CONTINUE else drive.then
            )

    def _interrupt(self, bits: Iterable[int]) -> None:
        """End what these motors do: their next command has come."""
        chosen = set(bits)
        for move in [move for move in self._moves if move.bits & chosen]:
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
        self._start(
            message, drives, dict.fromkeys(drives, share), time_ms=time_ms, angle_deg=angle_deg
        )

    def _run_by(self, message: protocol.Message, angle_deg: Callable[[Servo], float]) -> None:
        """Turn each motor by an angle at the magnitude of its speed."""
        drives = self._named(message)
        shares = {bit: math.copysign(1.0, drive.speed_pct) for bit, drive in drives.items()}
        self._start(message, drives, shares, angle_deg=lambda bit: angle_deg(self._servos[bit]))

    def _run_to_absolute(self, message: protocol.Message) -> None:
        def angle_deg(servo: Servo) -> float:
            clockwise = (
                message.values["position"] - self._machine.body.angle_mdeg(servo.port) / 1000
            ) % 360.0
            ways = (clockwise, clockwise - 360.0)
            direction = message.values["direction"]
            return (
                ways[direction]
                if direction < _SHORTEST
                else (min, max)[direction - _SHORTEST](ways, key=abs)
            )

        self._run_by(message, angle_deg)

    def _set(self, message: protocol.Message, change: Callable[[Servo], None]) -> None:
        """Change each motor, which ends what it does."""
        self._interrupt(self._named(message))
        for bit in self._named(message):
            change(self._servos[bit])

    def _stop(self, drives: Mapping[int, _Drive]) -> None:
        self._interrupt(drives)
        self._halt(drives)

    def _set_speed(self, message: protocol.Message, drives: Mapping[int, _Drive]) -> None:
        for bit, drive in drives.items():
            drive.speed_pct = message.values["speed"]
            if bit in self._endless:
                self._servos[bit].run(
                    round(self._endless[bit] * drive.speed_pct * protocol.FULL_SPEED_DEG_S / 100)
                )

    def _set_end_state(self, message: protocol.Message, drives: Mapping[int, _Drive]) -> None:
        for drive in drives.values():
            drive.then = OnCompletion[_END_STATES[message.values["end_state"]]]

    def _set_acceleration(self, message: protocol.Message, drives: Mapping[int, _Drive]) -> None:
        rates = (
            max(message.values[name], 1) * _ACCELERATION_DEG_S2_PER_PCT
            for name in ("acceleration", "deceleration")
        )
        acceleration, deceleration = rates
        for bit in drives:
            settings = self._servos[bit].settings
            speed, _, _, torque = settings.limits()
            settings.set_limits(speed, acceleration, deceleration, torque)


class DoubleMotor(SingleMotor):
    """Device with two motors, left and right, that also moves both as a pair, and with an IMU."""

    product = protocol.Product.DOUBLE_MOTOR

    def __init__(self, machine: Machine, part: KitPart) -> None:
        super().__init__(machine, part)
        self._pair = dict.fromkeys((_LEFT, _RIGHT), _Drive())
        self._steering_pct = 100
        self._yaw_face = 0
        self._yaw_offset = 0.0
        self._later |= {
            "move": lambda m: self._start(m, self._pair, self._shares(m)),
            "move_for_time": lambda m: self._start(
                m, self._pair, self._shares(m), time_ms=m.values["time_ms"]
            ),
            "move_for_degrees": lambda m: self._start(
                m, self._pair, self._shares(m), angle_deg=lambda _: m.values["degrees"]
            ),
            "tank": lambda m: self._tank(m, None),
            "tank_for_degrees": lambda m: self._tank(m, m.values["degrees"]),
            "turn_for_degrees": self._turn,
        }
        self._commands |= {
            "stop_moving": lambda _: self._stop(self._pair),
            "set_move_speed": lambda m: self._set_speed(m, self._pair),
            "set_move_end_state": lambda m: self._set_end_state(m, self._pair),
            "set_move_acceleration": lambda m: self._set_acceleration(m, self._pair),
            "set_steering": self._set_steering,
            "set_yaw_face": self._set_yaw_face,
            "reset_yaw": lambda m: self._set_yaw(m.values["yaw"]),
        }

    def connect(self) -> None:
        super().connect()
        self._set_yaw(0)

    def _reports(self) -> list[Report]:
        return [*super()._reports(), ("imu", self._imu_report()), ("gesture", (_NO_GESTURE,))]

    def _imu_report(self) -> tuple[int, ...]:
        body = self._machine.body
        force = body.acceleration_mm_s2()
        spin = body.angular_velocity_deg_s()
        face = max(range(len(protocol.FACES)), key=lambda index: _along(force, index))
        yaw = (self._turned() + self._yaw_offset + 180) % 360 - 180
        angles = (yaw, *body.tilt_deg(), *(_MG_PER_MM_S2 * value for value in force), *spin)
        return face, self._yaw_face, *(_clamp(angle, -32768, 32767) for angle in angles)

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
        direction = message.values["direction"]
        ahead = {_FORWARD: (1.0, 1.0), _BACKWARD: (-1.0, -1.0)}
        inner = 1.0 - self._steering_pct / 50
        left, right = ahead.get(direction, (inner, 1.0) if direction == _TO_LEFT else (1.0, inner))
        return {_LEFT: -left, _RIGHT: right}

    def _tank(self, message: protocol.Message, degrees: int | None) -> None:
        """Move at two speeds, by ``degrees`` of the faster motor."""
        shares = {_LEFT: -message.values["left"] / 100, _RIGHT: message.values["right"] / 100}
        fastest = max(map(abs, shares.values())) or 1.0
        drives = {bit: _Drive(100, drive.then) for bit, drive in self._pair.items()}
        by = None if degrees is None else lambda bit: degrees * abs(shares[bit]) / fastest
        self._start(message, drives, shares, angle_deg=by)

    def _turn(self, message: protocol.Message) -> None:
        """Turn by the IMU: slow down where the rest of the turn is as long as that takes, and
        stop."""
        start_deg = self._turned()
        wanted_deg = abs(message.values["degrees"])
        if message.values["degrees"] < 0:
            message.values["direction"] ^= 1
        servos = [self._servos[bit] for bit in self._pair]
        slowing: list[bool] = []

        def is_done() -> bool:
            if slowing:
                if any(abs(servo.speed_deg_s()) > _REST_DEG_S for servo in servos):
                    return False
                self._halt(self._pair)
                return True
            settings = servos[0].settings
            slow_s = (
                abs(servos[0].speed_deg_s(_WINDOW_MS))
                * settings.steps_per_unit
                / (2 * settings.deceleration)
            )
            left_deg = wanted_deg - abs(self._turned() - start_deg)
            if left_deg <= slow_s * abs(self._machine.body.angular_velocity_deg_s()[2]):
                slowing.append(True)
                for servo in servos:
                    servo.run(0)
            return False

        sharp = self._steering_pct
        self._steering_pct = 100
        self._start(message, self._pair, self._shares(message), until=is_done)
        self._steering_pct = sharp


class ColorSensor(KitDevice):
    """Color sensor on a port."""

    product = protocol.Product.COLOR_SENSOR

    def __init__(self, machine: Machine, part: KitPart) -> None:
        super().__init__(machine, part)
        self._plug = Plug(machine, part.ports)
        self._mode = _DETECT
        self._commands["set_color_mode"] = self._set_mode

    def _set_mode(self, message: protocol.Message) -> None:
        self._mode = message.values["mode"]

    def _reports(self) -> list[Report]:
        return [*super()._reports(), ("color", (*self._seen(), self._mode))]

    def _seen(self) -> tuple[int, ...]:
        """Color, reflection, raw red, green and blue, hue, saturation, value."""
        if self._mode != _DETECT:
            ambient_pct = round(self._plug.ambient_pct()) if self._mode == _AMBIENT else 0
            return protocol.NO_COLOR, 0, 0, 0, 0, 0, 0, ambient_pct
        raw = self._plug.raw_rgb(False)
        hsv = self._plug.reflected_hsv(False)
        index = nearest(hsv, list(_DETECTABLE.values()))
        color = protocol.NO_COLOR if index is None else list(_DETECTABLE)[index]
        return color, sum(raw) * 100 // 3072, *(min(value // 4, 255) for value in raw), *hsv


class Controller(KitDevice):
    """Two levers in a person's hands. ``levers_pct``: their positions, left and right, -100 to
    100."""

    product = protocol.Product.CONTROLLER

    def __init__(self, machine: Machine, part: KitPart) -> None:
        super().__init__(machine, part)
        self.levers_pct = (0, 0)

    def _reports(self) -> list[Report]:
        degrees = (round(lever * _FULL_LEVER_DEG / 100) for lever in self.levers_pct)
        return [*super()._reports(), ("controller", (*self.levers_pct, *degrees))]


def devices_of(machine: Machine, parts: Iterable[KitPart]) -> list[KitDevice]:
    """The devices of a robot, and a Controller."""
    return [
        *(_KINDS[part.product](machine, part) for part in parts),
        Controller(machine, KitPart(protocol.Product.CONTROLLER, "")),
    ]


_KINDS = {kind.product: kind for kind in (SingleMotor, DoubleMotor, ColorSensor)}


def _along(vector: tuple[float, float, float], face: int) -> float:
    """Component of a vector in the axes of a device out of one of its faces."""
    return sum(a * b for a, b in zip(vector, LOOKS[protocol.FACES[face]], strict=True))


def _clamp(value: float, low: int, high: int) -> int:
    return max(low, min(high, round(value)))
