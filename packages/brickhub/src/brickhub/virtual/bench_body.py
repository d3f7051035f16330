"""Bench body: motors without load, with the motor model of the firmware's test build.

The model (``motor_driver_virtual_simulation.c``, v4) is a medium angular motor in steps of 1 ms with the states angle, speed and
current, used for every kind of motor. It brakes also when it should coast.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from brickhub.errors import SceneError, TwinError
from brickhub.robot import Motor, Robot, Sense, UltrasonicSensor
from brickhub.virtual.body import Rng
from brickhub.virtual.stimuli import DEFAULT_STIMULI, Reading, Sensed, number

_FRICTION_UNM = 21413.268
_FRICTION_LINEAR_BELOW_MDEG_S = 2000.0
_STOP_UNM_PER_MDEG, _STOP_UNM_PER_MDEG_S = 500.0, 5.0  # stiffness and damping of an end stop
_MAX_DUTY = 1000  # steps of the PWM (``PBDRV_MOTOR_DRIVER_MAX_DUTY``)
_NEAREST_MM, _FARTHEST_MM = UltrasonicSensor.NEAREST_MM, UltrasonicSensor.FARTHEST_MM


class BenchMotor:
    """Motor: angle in mdeg, speed in mdeg/s, current in 0.1 mA, voltage in mV, end ``stops`` in mdeg."""

    __slots__ = ("angle", "current", "speed", "stops", "voltage")

    def __init__(self, stops: tuple[float, float] | None = None) -> None:
        self.angle = self.speed = self.current = self.voltage = 0.0
        self.stops = stops

    def step(self, friction_unm: float) -> None:
        """One millisecond."""
        v, i, u = self.speed, self.current, self.voltage
        # In the firmware's order of operations, which decides the last digit of a drive base's angle.
        linear_below = _FRICTION_LINEAR_BELOW_MDEG_S
        torque = friction_unm if v > linear_below else -friction_unm if v < -linear_below else friction_unm * v / linear_below
        if self.stops is not None:
            excess = self.angle - max(self.stops[0], min(self.angle, self.stops[1]))
            if excess:
                torque += excess * _STOP_UNM_PER_MDEG + v * _STOP_UNM_PER_MDEG_S
        angle = self.angle + v * 0.0009981527613056019 + i * 0.001957577848006867
        self.angle = angle + u * 0.0002818172865566039 + torque * -9.498678309037282e-05
        self.speed = v * 0.994653578576391 + i * 3.640640918794361 + u * 0.815657436669528 + torque * -0.18980175337809
        self.current = (
            v * -0.0021977502690683696 + i * 0.6348769647439378 + u * 0.335291816502189 + torque * 0.0002247101788128779
        )


class BenchBody:
    """A robot that is not assembled: motors turn freely, the hub lies still and level, nothing is in sight.

    Args:
        robot: hub, motors and sensors.
        readings: readings of the sensors, by name, as functions of the angles of the motors (deg at the output, by name). The
            name of a sensor, such as ``"light"``, is that of its first quantity, ``"light.ambient"`` of another one. An
            ultrasonic sensor without a reading sees nothing.
        end_stops: lowest and highest angle (deg at the output) at which a motor is blocked, by name.

    Attributes:
        battery_mv: voltage of the battery; at first that of the firmware's motor simulation.
        motor_friction_scale: factor on the dry friction inside the motors.
        link_interval_ms: connection interval of the hub's link.

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
        self.link_interval_ms = 15.0
        self._readings = _readings_by_sense(robot, readings)
        self._outputs = [(motor.name, motor.port, _mdeg_per_deg(motor)) for motor in robot.motors]
        stops = _end_stops_mdeg(robot, end_stops)
        self._motors = {motor.port: BenchMotor(stops.get(motor.port)) for motor in robot.motors}
        self._time_ms = 0

    def reset(self, rng: Rng) -> None:
        """No effect."""

    def advance_to(self, time_ms: int) -> None:
        friction_unm = _FRICTION_UNM * self.motor_friction_scale
        while self._time_ms < time_ms:
            for motor in self._motors.values():
                motor.step(friction_unm)
            self._time_ms += 1

    def angle_mdeg(self, port: str) -> int:
        return int(self._motors[port].angle)

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        duty = int((voltage_mv or 0) * _MAX_DUTY / self.battery_mv)
        duty = max(-_MAX_DUTY, min(_MAX_DUTY, duty))
        self._motors[port].voltage = int(duty * self.battery_mv / _MAX_DUTY)

    def sensed(self, port: str, sense: Sense) -> Sensed:
        """Stimulus of a sensor at the present angles. Raises SceneError if its reading raises."""
        reading = self._readings.get((port, sense))
        if reading is None:
            return DEFAULT_STIMULI[sense]
        try:
            return reading({name: self.angle_mdeg(p) / scale for name, p, scale in self._outputs})
        except Exception as error:
            line = error.__traceback__.tb_next.tb_lineno if error.__traceback__ and error.__traceback__.tb_next else 0
            file = reading.__code__.co_filename if hasattr(reading, "__code__") else "its file"
            raise SceneError(
                f"the scene's reading for port {port} of '{self.robot.name}' raised {type(error).__name__}: {error} "
                f"({file.rpartition('/')[2]}, line {line}); correct it"
            ) from error

    def distance_mm(self, port: str) -> int:
        if (port, Sense.DISTANCE) not in self._readings:
            return _FARTHEST_MM
        return min(max(round(number(self.sensed(port, Sense.DISTANCE))), _NEAREST_MM), _FARTHEST_MM)

    def tilt_deg(self) -> tuple[float, float]:
        return -0.0, 0.0  # as computed from a vertical acceleration

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 9810.0

    def heading_deg(self) -> float:
        return 0.0

    def rotation_deg(self) -> tuple[float, float, float]:
        return 0.0, 0.0, -self.heading_deg()


def _mdeg_per_deg(motor: Motor) -> float:
    """Millidegrees of the shaft, clockwise, for one degree of the output in the program's direction."""
    ratio = motor.gears[-1] / motor.gears[0] if motor.gears else 1.0
    return 1000.0 * ratio * motor.direction.value


def _end_stops_mdeg(robot: Robot, end_stops: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """End stops by port, as clockwise angles of the shaft in mdeg."""
    motors = {motor.name: motor for motor in robot.motors}
    unknown = sorted(set(end_stops) - set(motors))
    if unknown:
        raise TwinError(f"robot '{robot.name}' has no motor '{unknown[0]}' for an end stop; it has {', '.join(motors) or 'none'}")
    stops = {}
    for name, angles_deg in end_stops.items():
        scale = _mdeg_per_deg(motors[name])
        low, high = sorted(angle * scale for angle in angles_deg)
        stops[motors[name].port] = low, high
    return stops


def _readings_by_sense(robot: Robot, readings: Mapping[str, Reading]) -> dict[tuple[str, Sense], Reading]:
    inputs = {}
    for sensor in robot.sensors:
        for index, sense in enumerate(sensor.kind.model.senses):
            inputs[f"{sensor.name}.{sense}" if index else sensor.name] = (sensor.port, sense)
    unknown = sorted(set(readings) - set(inputs))
    if unknown:
        raise TwinError(f"robot '{robot.name}' has no sensor '{unknown[0]}'; it senses {', '.join(inputs) or 'nothing'}")
    for sensor in robot.sensors:
        if sensor.kind.model.senses and sensor.kind.model.range_mm is None and sensor.name not in readings:
            raise TwinError(
                f"sensor '{sensor.name}' of robot '{robot.name}' has no reading; "
                f"give readings={{'{sensor.name}': a function of the motors' angles}}, for a task in its Scene"
            )
    return {inputs[name]: reading for name, reading in readings.items()}
