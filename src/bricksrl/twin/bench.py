"""Motors on the bench: no load, as the firmware's own motor simulation moves them.

The model is that of the firmware's test build (``motor_driver_virtual_simulation.c``, v4): a medium angular motor in
steps of 1 ms with the states angle, speed and current. It uses the same figures for every kind of motor, and so does
this; it also brakes when it coasts.
"""

from __future__ import annotations

import numpy as np

from bricksrl.errors import TwinError
from bricksrl.robots import Motor, PoweredUpSensor, Robot, UltrasonicSensor
from bricksrl.twin.physics import Physics, RandomPhysics
from bricksrl.twin.scene import OPEN_FLOOR, Scene
from bricksrl.twin.senses import UNSAID, Reading, Sense, Sensed, number, senses

_FRICTION_UNM = 21413.268
_FRICTION_FADES_BELOW_MDEG_S = 2000.0
_MAX_DUTY = 10_000
_BENCH_BATTERY_MV = 7200
_NEAREST_MM, _FARTHEST_MM = 40, 2000


class _BenchMotor:
    """Angle in mdeg, speed in mdeg/s, current in 0.1 mA, voltage in mV."""

    __slots__ = ("angle", "current", "speed", "voltage")

    def __init__(self) -> None:
        self.angle = self.speed = self.current = self.voltage = 0.0

    def step(self, friction_unm: float) -> None:
        """One millisecond."""
        v, i, u = self.speed, self.current, self.voltage
        torque = friction_unm * max(-1.0, min(1.0, v / _FRICTION_FADES_BELOW_MDEG_S))
        self.angle += (
            v * 0.0009981527613056019 + i * 0.001957577848006867 + u * 0.0002818172865566039 + torque * -9.498678309037282e-05
        )
        self.speed = v * 0.994653578576391 + i * 3.640640918794361 + u * 0.815657436669528 + torque * -0.18980175337809
        self.current = (
            v * -0.0021977502690683696 + i * 0.6348769647439378 + u * 0.335291816502189 + torque * 0.0002247101788128779
        )


class BenchBody:
    """A robot that is not assembled: motors turn freely, the hub lies still and level, nothing is in sight.

    This is also the twin of every robot that has no MuJoCo model. What its sensors read then follows from the angles of its
    motors, as the scene says.

    Args:
        scene: its ``readings``; an ultrasonic sensor without one sees nothing.
        physics: battery and friction in the motors, or how to draw them for each episode; ``None`` for the firmware's own
            motor simulation at 7.2 V.

    Raises:
        TwinError: the scene says nothing about one of the sensors, or something about one that is not there.
    """

    def __init__(self, robot: Robot, scene: Scene = OPEN_FLOOR, physics: Physics | RandomPhysics | None = None) -> None:
        self.motors = {motor.port: motor.kind for motor in robot.motors}
        self.distance_sensors = frozenset(s.port for s in robot.sensors if isinstance(s, UltrasonicSensor))
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        self._apply(physics if isinstance(physics, Physics) else Physics())
        if physics is None:
            self.battery_mv = _BENCH_BATTERY_MV
        self._readings = _by_sense(robot, scene)
        self._outputs = [(motor.name, motor.port, _mdeg_per_deg(motor)) for motor in robot.motors]
        self._motors = {port: _BenchMotor() for port in self.motors}
        self._time_ms = 0

    def _apply(self, physics: Physics) -> None:
        self.physics = physics
        self.battery_mv = round(physics.battery_v * 1000)

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to put back; physics that are random are drawn."""
        if self._random_physics is not None:
            self._apply(self._random_physics.sample(rng))

    def advance_to(self, time_ms: int) -> None:
        friction_unm = _FRICTION_UNM * self.physics.motor_friction_scale
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
        """What the scene lets a sensor sense at the present angles."""
        reading = self._readings.get((port, sense))
        if reading is None:
            return UNSAID[sense]
        return reading({name: self.angle_mdeg(p) / scale for name, p, scale in self._outputs})

    def distance_mm(self, port: str) -> int:
        if (port, Sense.DISTANCE) not in self._readings:
            return _FARTHEST_MM
        return min(max(round(number(self.sensed(port, Sense.DISTANCE))), _NEAREST_MM), _FARTHEST_MM)

    def tilt_deg(self) -> tuple[float, float]:
        return 0.0, 0.0

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        return 0.0, 0.0, 9810.0

    def heading_deg(self) -> float:
        return 0.0


def _mdeg_per_deg(motor: Motor) -> float:
    """Millidegrees of the shaft, clockwise, for one degree of the output, as a program counts it."""
    ratio = motor.gears[-1] / motor.gears[0] if motor.gears else 1.0
    return 1000.0 * ratio * motor.direction.value


def _by_sense(robot: Robot, scene: Scene) -> dict[tuple[str, Sense], Reading]:
    places = {}
    for sensor in robot.sensors:
        for index, sense in enumerate(senses(sensor)):
            places[f"{sensor.name}.{sense}" if index else sensor.name] = (sensor.port, sense)
    strangers = sorted(set(scene.readings) - set(places))
    if strangers:
        raise TwinError(f"robot '{robot.name}' has no sensor '{strangers[0]}'; it senses {', '.join(places) or 'nothing'}")
    for sensor in robot.sensors:
        if isinstance(sensor, PoweredUpSensor) and senses(sensor) and sensor.name not in scene.readings:
            raise TwinError(
                f"nothing says what '{sensor.name}' of robot '{robot.name}' reads; "
                f"give the task Scene(readings={{'{sensor.name}': a function of the motors' angles}})"
            )
    return {places[name]: reading for name, reading in scene.readings.items()}
