"""Bench: a robot that is not assembled, of given motors and sensors, or of those that a program
uses.

Its motors brake also when they should coast.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

from brickhub.errors import SceneError, TwinError, an
from brickhub.hub.link.profiles import usual_link
from brickhub.robot import AnyHub, MotorKind, Robot, Sense, SensorKind, UltrasonicSensor
from brickhub.virtual.bench_motor import BenchMotor, step_of
from brickhub.virtual.body import Rng
from brickhub.virtual.given_readings import GivenReading
from brickhub.virtual.stimuli import DEFAULT_STIMULI, Reading, Sensed, number

_MAX_DUTY = 1000
"""Steps of the PWM (``PBDRV_MOTOR_DRIVER_MAX_DUTY``)."""
_ALL_MM = (UltrasonicSensor.NEAREST_MM, UltrasonicSensor.FARTHEST_MM)
"""Range of an ultrasonic sensor whose kind nobody has said."""
_STALL_TRAVEL_MDEG = 90_000.0
_HEADING_PER_WHEEL = 0.25
"""Degrees that the hub turns for one of a wheel: wheels of 56 mm, 112 mm apart."""
_DEFAULTS: Mapping[Sense, Sensed] = {
    **DEFAULT_STIMULI,
    Sense.SURFACE: (0.0, 0.0, 0.0),
    Sense.FORCE: 0.0,
    Sense.TILT: (0.0, 0.0),
}


class BenchBody:
    """A robot that is not assembled: motors turn freely, the hub lies still and level, nothing is
    in sight.

    Args:
        robot: hub, motors and sensors.
        readings: readings of the sensors, by name, as functions of the angles of the motors (deg at
            the output, by name). The name of a sensor, such as ``"light"``, is that of its first
            quantity, ``"light.ambient"`` of another one. An ultrasonic sensor without a reading
            sees nothing.
        end_stops: lowest and highest angle (deg at the output) at which a motor is blocked, by
            name.

    Attributes:
        battery_mv: voltage of the battery; at first that of the firmware's motor simulation.
        motor_friction_scale: factor on the dry friction inside the motors.
        link: delays and losses of the hub's link.

    Raises:
        TwinError: a sensor has no reading, or a reading or end stop no device.
    """

    turns_with_its_wheels = False
    """Whether the hub turns when its motors do."""

    def __init__(
        self,
        robot: Robot,
        readings: Mapping[str, Reading] = MappingProxyType({}),
        end_stops: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    ) -> None:
        self.robot = robot
        self.battery_mv = 7200
        self.motor_friction_scale = 1.0
        self.link = usual_link(robot.hub.model)
        self._readings = _readings_by_sense(robot, readings)
        self._kinds = {sensor.port: sensor.kind for sensor in robot.sensors}
        # Angles are given at the output but bodies turn shafts, so each motor has its number of
        # mdeg for a degree.
        self._outputs = [
            (motor.name, motor.port, 1000.0 * motor.shaft_turns) for motor in robot.motors
        ]
        # Stops that are given here go before those of the description.
        stops = _end_stops_mdeg(robot, {**described_end_stops(robot), **end_stops})
        self._motors: dict[str, BenchMotor] = {}
        for motor in robot.motors:
            self._motors[motor.port] = BenchMotor(step_of(motor.kind), stops.get(motor.port))
        self._time_ms = 0

    def reset(self, rng: Rng) -> None:
        """No effect."""

    def advance_to(self, time_ms: int) -> None:
        friction_scale = self.motor_friction_scale
        while self._time_ms < time_ms:
            for motor in self._motors.values():
                motor.step(friction_scale)
            self._time_ms += 1

    def angle_mdeg(self, port: str) -> int:
        return int(self._motors[port].angle)

    def set_voltage(
        self,
        port: str,
        voltage_mv: int | None,
    ) -> None:
        # The voltage passes through the steps of the PWM, as in the firmware's test build, which
        # cost some millivolts.
        duty = int((voltage_mv or 0) * _MAX_DUTY / self.battery_mv)
        duty = max(-_MAX_DUTY, min(_MAX_DUTY, duty))
        motor = self._motors[port]
        motor.voltage = int(duty * self.battery_mv / _MAX_DUTY)

    def sensed(
        self,
        port: str,
        sense: Sense,
    ) -> Sensed:
        """Stimulus of a sensor at the present angles. Raises SceneError if its reading raises."""
        reading = self._readings.get((port, sense))
        if reading is None:
            return self._unread(port, sense)
        try:
            angles_deg = {
                name: self.angle_mdeg(motor_port) / mdeg_per_deg
                for name, motor_port, mdeg_per_deg in self._outputs
            }
            return reading(angles_deg)
        except Exception as error:
            file, line = _place(error, reading)
            raise SceneError(
                f"the scene's reading for port {port} of '{self.robot.name}' raised "
                f"{type(error).__name__}: {error} "
                f"({file}, line {line}); correct it"
            ) from error

    def _unread(self, port: str, sense: Sense) -> Sensed:
        """Stimulus of a sensor without a reading."""
        if sense is Sense.ROTATION:
            return self.heading_deg(), self.turn_rate_deg_s()
        range_mm = self._kinds[port].model.range_mm
        return _DEFAULTS[sense] if range_mm is None else range_mm[1]

    def distance_mm(self, port: str) -> int:
        nearest_mm, farthest_mm = self._kinds[port].model.range_mm or _ALL_MM
        distance_mm = round(number(self.sensed(port, Sense.DISTANCE)))
        return min(max(distance_mm, nearest_mm), farthest_mm)

    def tilt_deg(self) -> tuple[float, float]:
        # A vertical acceleration gives -0.0 here, not 0.0.
        return -0.0, 0.0

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 9810.0

    def heading_deg(self) -> float:
        return 0.0

    def turn_rate_deg_s(self) -> float:
        """Rate of the heading."""
        return 0.0

    def rotation_deg(self) -> tuple[float, float, float]:
        return 0.0, 0.0, -self.heading_deg()

    def true_place(self) -> tuple[float, float, float]:
        return 0.0, 0.0, self.heading_deg()


def _place(error: Exception, reading: Reading) -> tuple[str, int]:
    """File and line of a scene's reading at which it raised an error."""
    file = reading.__code__.co_filename if hasattr(reading, "__code__") else "its file"
    # The traceback begins with the call here; the next entry is the reading itself.
    here = error.__traceback__
    inside = here.tb_next if here else None
    line = inside.tb_lineno if inside else 0
    return file.rpartition("/")[2], line


def described_end_stops(robot: Robot) -> dict[str, tuple[float, float]]:
    """End stops of a description (deg of the output), by name of the motor. Raises TwinError if one
    does not begin at 0, where a motor on the bench is."""
    stops = {}
    for motor in robot.motors:
        if motor.end_stops_deg is not None:
            stops[motor.name] = motor.end_stops_deg
    for name, (low, high) in stops.items():
        if not low <= 0.0 <= high:
            raise TwinError(
                f"motor '{name}' of '{robot.name}' has end stops {low:g} and {high:g}, but starts "
                "at 0 on the bench; "
                "give the robot a model"
            )
    return stops


def _end_stops_mdeg(
    robot: Robot, end_stops: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """End stops by port, as clockwise angles of the shaft in mdeg."""
    motors = {motor.name: motor for motor in robot.motors}
    unknown = sorted(set(end_stops) - set(motors))
    if unknown:
        raise TwinError(
            f"robot '{robot.name}' has no motor '{unknown[0]}' for an end stop; it has "
            f"{', '.join(motors) or 'none'}"
        )
    stops = {}
    for name, angles_deg in end_stops.items():
        # For a motor that counts counterclockwise the scale is negative, so lowest and highest
        # change places.
        scale = 1000.0 * motors[name].shaft_turns
        low, high = sorted(angle * scale for angle in angles_deg)
        stops[motors[name].port] = low, high
    return stops


def _readings_by_sense(
    robot: Robot, readings: Mapping[str, Reading]
) -> dict[tuple[str, Sense], Reading]:
    # The first quantity of a sensor has the sensor's name alone.
    inputs = {}
    for sensor in robot.sensors:
        for index, sense in enumerate(sensor.kind.model.senses):
            name = f"{sensor.name}.{sense}" if index else sensor.name
            inputs[name] = (sensor.port, sense)
    unknown = sorted(set(readings) - set(inputs))
    if unknown:
        raise TwinError(
            f"robot '{robot.name}' has no sensor '{unknown[0]}'; it senses "
            f"{', '.join(inputs) or 'nothing'}"
        )
    for sensor in robot.sensors:
        model = sensor.kind.model
        # "Nothing near" is a sensible default for a distance, and a gyroscope turns with the hub,
        # but other sensors have none.
        is_known = model.range_mm is not None or Sense.ROTATION in model.senses
        needs_reading = model.senses and not is_known
        if needs_reading and sensor.name not in readings:
            raise TwinError(
                f"sensor '{sensor.name}' of robot '{robot.name}' has no reading; "
                f"give readings={{'{sensor.name}': a function of the motors' angles}}, for a task "
                "in its Scene"
            )
    return {inputs[name]: reading for name, reading in readings.items()}


def _of_its_family(kind: SensorKind, hub: AnyHub) -> SensorKind:
    """The kind of a sensor that a hub takes under the class of another one: who writes a class
    means that of the program. The same kind if there is none."""
    for other in SensorKind:
        if other.model.class_name == kind.model.class_name and hub.model.takes(other.model):
            return other
    return kind


def _check_ports(
    hub: AnyHub,
    device: str,
    fitting: str,
    named: Iterable[str],
) -> None:
    """Raises TwinError if something is said of a device on a port that never has one."""
    for port in named:
        if port not in fitting:
            raise TwinError(
                f"port {port} of the {hub.value} hub takes no {device}; name one of "
                f"{', '.join(fitting)}"
            )


class FittedBench(BenchBody):
    """A hub without devices until a program uses some, as the hub tells it; motors turn freely,
    sensors have given readings.

    With motors, the hub is mounted as the program says; alone, it lies flat. With a drive base, it
    turns as the wheels do. Without one, the first two motors are wheels if they are of one kind and
    their positive directions are opposite. A motor that runs until it stalls is blocked after 90
    degrees. Raises TwinError if a reading is for a port that the hub does not have.

    Args:
        hub: kind of hub.
        readings: of sensors; without one a sensor sees nothing near, dark, untouched and level.
        end_stops: lowest and highest angle of the motor on a port, deg of the shaft.
        starts: angle at which the motor on a port stands at first, deg of the shaft; 0 for others.
        devices: what is on a port, ``None`` for nothing; on others there is what the program asks
            for, motors of the kind that is usual for the hub.
        report: called with a line about what the bench assumes.

    Attributes:
        motors: kind of motor by port.
    """

    def __init__(
        self,
        hub: AnyHub,
        readings: Iterable[GivenReading] = (),
        end_stops: Mapping[str, tuple[float, float]] | None = None,
        devices: Mapping[str, MotorKind | SensorKind | None] = MappingProxyType({}),
        starts: Mapping[str, float] = MappingProxyType({}),
        report: Callable[[str], object] = lambda line: None,
    ) -> None:
        super().__init__(Robot("bench", hub, needs_imu=hub.model.has_imu))
        self._stops = dict(end_stops or {})
        self._starts = starts
        self._given_readings: dict[str, list[GivenReading]] = defaultdict(list)
        for reading in readings:
            self._given_readings[reading.port].append(reading)
        self.motors: dict[str, MotorKind] = {}
        self._devices: dict[str, str] = {}
        self._turns: dict[str, float] = {}
        self._heading_offset_deg = 0.0
        self._report: Callable[[str], object] | None = report
        self._tell = report
        self._up = (0.0, 0.0, 1.0)
        for port in (*self._given_readings, *self._stops, *starts, *devices):
            if port not in hub.model.ports:
                raise TwinError(
                    f"the {hub.value} hub has no port {port}; it has {', '.join(hub.model.ports)}"
                )
        _check_ports(hub, "sensor", hub.model.ports_for_sensors, self._given_readings)
        _check_ports(hub, "motor", hub.model.motor_ports, (*self._stops, *starts))
        for port, start_deg in starts.items():
            low, high = self._stops.get(port, (start_deg, start_deg))
            if not low <= start_deg <= high:
                raise TwinError(
                    f"the motor on port {port} starts at {start_deg:g} deg, beyond its end stops; "
                    "give a start between them"
                )
        self._free_ports = set(hub.model.ports) - set(devices)
        for port, kind in devices.items():
            if port in hub.model.own_motors:
                raise TwinError(
                    f"port {port} of the {hub.value} hub has the hub's own motor; say what is on "
                    "another port"
                )
            if kind is None:
                continue
            if isinstance(kind, SensorKind):
                kind = _of_its_family(kind, hub)
            if port not in hub.model.takes(kind.model):
                raise TwinError(
                    f"{an(kind.value)} does not fit port {port} of the {hub.value} hub; say what "
                    "else is there"
                )
            if isinstance(kind, MotorKind):
                self._add_motor(port, kind, kind.model.class_name)
            else:
                self._add_sensor(port, kind.value)

    def plug_in(
        self,
        port: str,
        device: str,
    ) -> bool:
        """Plug in a motor by its class, or a sensor by the name of its kind. Returns whether the
        port has it now. Raises TwinError if the port's reading does not suit the device."""
        if port not in self._free_ports:
            return self._devices.get(port) == device
        is_motor = device in ("Motor", "DCMotor")
        kind = self._usual_motor(port, device) if is_motor else SensorKind(device)
        if port not in self.robot.hub.model.takes(kind.model):
            return False
        self._free_ports.remove(port)
        if isinstance(kind, MotorKind):
            self._add_motor(port, kind, device)
        else:
            self._add_sensor(port, device)
        return True

    def _usual_motor(
        self,
        port: str,
        device: str,
    ) -> MotorKind:
        """The kind of motor that a program means by a class of motors."""
        hub = self.robot.hub.model
        if port in hub.own_motors:
            return MotorKind(hub.own_kind)
        plain = MotorKind.MEDIUM_LINEAR
        wants_plain = device == plain.model.class_name and hub.takes(plain.model)
        return plain if wants_plain else MotorKind(hub.usual_motor)

    def _add_motor(
        self,
        port: str,
        kind: MotorKind,
        device: str = "Motor",
    ) -> None:
        self._devices[port] = device
        self.motors[port] = kind
        stops_deg = self._stops.get(port)
        stops_mdeg = None
        if stops_deg is not None:
            low, high = stops_deg
            stops_mdeg = (low * 1000.0, high * 1000.0)
        start_mdeg = 1000.0 * self._starts.get(port, 0.0)
        if start_mdeg and not kind.model.is_absolute:
            self._tell(
                f"The motor on port {port} does not know its angle: a program counts from 0, "
                "wherever it stands."
            )
        self._motors[port] = BenchMotor(step_of(kind), stops_mdeg, start_mdeg)

    def _add_sensor(
        self,
        port: str,
        device: str,
    ) -> None:
        self._devices[port] = device
        self._kinds[port] = SensorKind(device)
        given: dict[Sense, GivenReading] = {}
        for reading in self._given_readings[port]:
            sense = reading.sense_of(device)
            if sense in given:
                raise TwinError(f"port {port} has two readings of {sense}; give one")
            given[sense] = reading
        for sense, reading in given.items():
            # What was set by hand since then holds.
            self._readings.setdefault((port, sense), self._in_time(reading))

    def set_reading(
        self,
        port: str,
        sense: Sense,
        stimulus: Sensed,
    ) -> None:
        """Let the sensor on a port sense this from now on, in place of its reading; also one that
        the program has not used yet."""
        self._readings[port, sense] = lambda _: stimulus

    def _in_time(self, reading: GivenReading) -> Reading:
        """Readings of a sensor, as given for each moment."""
        return lambda _: reading.at(self._time_ms / 1000)

    def block(
        self,
        port: str,
        direction: int,
    ) -> None:
        """Something is in the way of a motor that runs until it stalls, clockwise (1) or
        counterclockwise (-1)."""
        motor = self._motors[port]
        low, high = motor.stops or (-math.inf, math.inf)
        # This is said once, because from now on the motor has stops.
        if motor.stops is None:
            self._tell(
                f"The bench blocks the motor on port {port} after 90 degrees, as the program runs "
                "it until it stalls; "
                f"--end-stop {port}=-90..120 gives it other ends."
            )
        if direction > 0 and high == math.inf:
            motor.stops = low, motor.angle + _STALL_TRAVEL_MDEG
        elif direction < 0 and low == -math.inf:
            motor.stops = motor.angle - _STALL_TRAVEL_MDEG, high

    @property
    def turns_with_its_wheels(self) -> bool:  # type: ignore[override]
        return bool(self._turns)

    def put_on_wheels(self, turns: Mapping[str, float]) -> None:
        """The hub rides on wheels that do not slip: degrees that it turns clockwise for one
        millidegree of each motor."""
        # The heading goes on from where it is, whatever the wheels have turned before.
        heading_deg = self.heading_deg()
        self._turns = dict(turns)
        self._heading_offset_deg += heading_deg - self.heading_deg()

    def find_wheels(self, directions: Mapping[str, int]) -> None:
        """The program reads the gyroscope without a drive base: positive directions of its motors,
        clockwise 1 or counterclockwise -1, by port in order of creation."""
        pair = list(directions)[:2]
        is_settled = self._report is None or self._turns
        if is_settled or len(pair) < 2:
            return
        # As long as neither motor has turned, nobody can see a difference.
        first, second = pair
        has_turned = self._motors[first].angle or self._motors[second].angle
        if not has_turned:
            return
        first_kind = (self._devices[first], self.motors[first])
        second_kind = (self._devices[second], self.motors[second])
        report = self._tell
        are_opposite = directions[first] != directions[second]
        if are_opposite and first_kind == second_kind:
            self._turns = dict.fromkeys(pair, -_HEADING_PER_WHEEL / 1000.0)
            report(
                f"The bench takes the motors on ports {first} and {second} for wheels, as they "
                "come first and their positive "
                "directions are opposite: the hub turns with them."
            )
        else:
            report(
                "The hub lies still on the bench: its first two motors are not taken for wheels, "
                "as they are not of one kind "
                "with opposite positive directions. It turns with a drive base; or take a robot, "
                "such as --robot two-wheeler."
            )
        self._report = None

    def mount(self, up: tuple[float, float, float]) -> None:
        """Mount the hub of a robot with motors such that up is this direction in the hub's
        frame."""
        x, y, z = up
        # Adding 0.0 removes a -0.0, which would change the roll of a hub on end by 180 degrees.
        self._up = x + 0.0, y + 0.0, z + 0.0

    def heading_deg(self) -> float:
        turned_deg = sum(turn * self._motors[port].angle for port, turn in self._turns.items())
        return self._heading_offset_deg + turned_deg

    def turn_rate_deg_s(self) -> float:
        return sum(turn * self._motors[port].speed for port, turn in self._turns.items())

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return self._about_vertical(self.turn_rate_deg_s())

    def rotation_deg(self) -> tuple[float, float, float]:
        return self._about_vertical(self.heading_deg())

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        # A hub alone lies flat, whatever its program says of a robot.
        at_rest = super().acceleration_mm_s2()
        if not self.motors:
            return at_rest
        gravity = at_rest[2]
        x, y, z = self._up
        return gravity * x, gravity * y, gravity * z

    def tilt_deg(self) -> tuple[float, float]:
        if not self.motors:
            return super().tilt_deg()
        x, y, z = self._up
        pitch = math.atan2(-x, math.hypot(y, z))
        roll = math.atan2(y, z)
        return math.degrees(pitch), math.degrees(roll)

    def device(self, port: str) -> str | None:
        """Class name of the device on a port."""
        return self._devices.get(port)

    def _about_vertical(self, clockwise: float) -> tuple[float, float, float]:
        # A rotation vector points along its axis if the rotation is counterclockwise, but headings
        # count clockwise.
        x, y, z = self._up
        return -clockwise * x, -clockwise * y, -clockwise * z
