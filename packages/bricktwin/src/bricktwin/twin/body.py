"""Body of a robot on an engine: voltages in, angles and sensor readings out.

It needs neither NumPy nor MuJoCo: whatever the engine, its senses, battery, starts and noise are
computed here.
"""

import math
from typing import NamedTuple

from brickhub.robot import Robot, Sense
from brickhub.virtual.body import Rng
from brickhub.virtual.stimuli import Sensed
from bricktwin.twin.engines.conventions import TIMESTEP_S
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.engines.rotations import Vector, dot, plus
from bricktwin.twin.model_physics import up
from bricktwin.twin.models.turning_parts import TurningParts
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import INFRARED_MM, SENSOR_DRIFTS, Noise, SummedNoise
from bricktwin.twin.standing import StandingRobot

_GRAVITY_MM_S2 = 9810.0
_STEPS_PER_UPDATE = 20
"""Steps between two updates of the turns: few enough that no robot turns by half a turn."""
STEPS_PER_LOAD = 2
"""Steps between two loads of the battery: the 5 ms of the firmware's control loop."""
_LOADS_PER_AVERAGE = 128
"""Loads in the slow average of the battery's voltage (Pybricks' ``battery.c``)."""


class NoiseSources(NamedTuple):
    """Generators of a body's noise, one for each purpose: how often a sensor is read must not move
    anything else.

    Attributes:
        readings: of all sensors' readings.
        heading: of the gyroscope's noise that adds up.
    """

    readings: Noise
    heading: Noise


class TwinBody(StandingRobot):
    """Robot on an engine; implements :class:`brickhub.virtual.body.Body`. Raises TwinError if the
    model does not match the robot.

    The simulation is deterministic, bit for bit, given the arguments and the calls.

    Args:
        robot, scene, engine, prefix: as of a :class:`StandingRobot`.
        physics: its parameters.
        noise: generators of the sensors' noise.

    Attributes:
        link: parameters of the hub's link.
        steps: of the physics since the body was made.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        engine: Engine,
        physics: Physics,
        noise: NoiseSources,
        prefix: str = "",
    ) -> None:
        super().__init__(
            robot,
            scene,
            engine,
            physics,
            prefix,
        )
        self._noise = noise.readings
        self._heading_noise = SummedNoise(noise.heading)
        self._turning = TurningParts(engine)
        self.steps = 0
        self._steps_since_update = 0
        self._heading_at_start_deg = 0.0
        self.coast()

    def _use(self, physics: Physics) -> None:
        super()._use(physics)
        self.link = physics.link
        self._up = up(physics)
        self.battery_mv = round(physics.battery_v * 1000)
        self._terminal_v = physics.battery_v
        self._average_v = physics.battery_v
        self._encoder_step_mdeg = round(physics.encoder_resolution_deg * 1000)
        self._acceleration_bias_mm_s2: Vector = (
            physics.acceleration_bias_x_mm_s2,
            physics.acceleration_bias_y_mm_s2,
            physics.acceleration_bias_z_mm_s2,
        )
        self._gyro_scale = 1.0 + physics.gyro_scale_error_pct / 100.0
        # The cosine of the largest angle: what reflects has a larger one.
        self._least_echo = math.cos(math.radians(physics.echo_angle_deg))

    def begin(
        self,
        physics: Physics | RandomPhysics,
        rng: Rng,
    ) -> None:
        super().begin(physics, rng)
        # The hub's gyroscope counts from where the robot stands when the hub is switched on.
        self._heading_at_start_deg = self._turns.heading_deg
        self._turns.rotation_rad = (0.0, 0.0, 0.0)

    def actuator(self, port: str) -> int:
        """Index of a motor's actuator in the model."""
        index, _ = self.motors.terminals[port]
        return index

    def is_stopped(self, port: str) -> bool:
        """Whether the joint of a motor has end stops."""
        joint = self.motors.joints[port]
        return bool(self.engine.indices("jnt_limited")[joint])

    def update_visuals(self) -> None:
        """Update the places of all parts to the joint positions, for drawings; physics steps do
        not."""
        self.engine.kinematics()
        self._turning.turn()

    # ---------------------------------------------------------------- time

    def advance_to(self, time_ms: int) -> None:
        """Integrate whole steps up to this simulated time."""
        remaining = time_ms * 2 // 5 - self.steps  # steps of 2.5 ms
        if self.is_held:
            # A hand keeps all of it as it is.
            self.steps += max(0, remaining)
            return
        while remaining > 0:
            # Up to the next load of the battery in one call, as each call takes time of its own.
            steps = STEPS_PER_LOAD - self.steps % STEPS_PER_LOAD
            steps = steps if steps < remaining else remaining
            self.engine.step(steps)
            remaining -= steps
            self.steps += steps
            self._steps_since_update += steps
            if self._steps_since_update >= _STEPS_PER_UPDATE:
                self.update_turns()
            if self.steps % STEPS_PER_LOAD == 0:
                self.load_battery()

    def update_turns(self) -> None:
        self._steps_since_update = 0
        super().update_turns()

    # ---------------------------------------------------------------- motors

    def coast(self) -> None:
        """Let all motors coast."""
        for port in self.motors.terminals:
            self.set_voltage(port, None)

    def load_battery(self) -> None:
        """Load the battery with the motors' present currents, and average its voltage as the
        firmware does, every 5 ms.

        A bridge gives a motor a share of the battery's voltage, and takes that share of the motor's
        current from it. The firmware chooses the share by its slow average (Pybricks'
        ``battery.c``).
        """
        engine = self.engine
        voltages_v = engine.ctrl
        torques_nm = engine.actuator_force
        amperes = self.motors.amperes
        power_w = 0.0
        for motor, amperes_per_nm in amperes:
            power_w += voltages_v[motor] * torques_nm[motor] * amperes_per_nm
        # The current follows from the voltage of the last time: this time's depends on it.
        before_v = self._terminal_v
        physics = self.physics
        terminal_v = physics.battery_v - physics.battery_ohm * power_w / before_v
        self._terminal_v = terminal_v
        # A bridge keeps its share until the firmware's next command.
        change = terminal_v / before_v
        for motor, _ in amperes:
            voltages_v[motor] *= change
        self._average_v += (terminal_v - self._average_v) / _LOADS_PER_AVERAGE
        self.battery_mv = int(self._average_v * 1000.0 + 0.5)

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft in whole steps of its rotation sensor, clockwise positive."""
        address, mdeg_per_rad = self.motors.shafts[port]
        step = self._encoder_step_mdeg
        return math.floor(self.engine.qpos[address] * mdeg_per_rad / step + 0.5) * step

    def set_voltage(
        self,
        port: str,
        voltage_mv: int | None,
    ) -> None:
        """Apply a voltage, at most the battery's; 0 shorts the motor (brake), ``None`` opens the
        circuit (coast)."""
        engine = self.engine
        actuator, circuit = self.motors.terminals[port]
        # A motor whose circuit is open has no torque, not even that of a brake: its actuator is
        # disabled.
        is_open = bool(engine.open_circuits & circuit)
        if (voltage_mv is None) is not is_open:
            engine.switch_circuits(circuit)
        if voltage_mv is not None:
            self.is_held = False
            # Comparisons, as `min` and `max` take longer, and each control loop comes here.
            share = voltage_mv / self.battery_mv
            if share > 1.0:
                share = 1.0
            elif share < -1.0:
                share = -1.0
            engine.ctrl[actuator] = share * self._terminal_v

    # ---------------------------------------------------------------- sensors

    def distance_mm(self, port: str) -> int:
        """Distance to the nearest obstacle or robot that throws one of five rays in the sensor's
        cone back, with noise, bias and failures; within the sensor's range.

        What is hard is a mirror of sound and throws back what meets it nearly at right angles; what
        is soft scatters sound, and is seen late.
        """
        physics = self.physics
        nearest, farthest = self._sensors.ranges_mm[port]
        # A sensor that never fails draws nothing for it.
        dropout_share = physics.distance_dropout_share
        if dropout_share and self._noise.random() < dropout_share:
            return farthest
        nearest_mm = self._nearest_echo_mm(port)
        if nearest_mm >= farthest:
            return farthest
        deviation_mm = physics.distance_noise_mm + physics.distance_noise_ratio * nearest_mm
        noise_mm = deviation_mm * self._noise.standard_normal()
        reading_mm = round(nearest_mm + physics.distance_bias_mm + noise_mm)
        return min(max(reading_mm, nearest), farthest)

    def _nearest_echo_mm(self, port: str) -> float:
        """Distance of an ultrasonic sensor to the nearest surface that it can hear; infinite if
        there is none."""
        sensors = self._sensors
        base = self._base
        position_m, _ = sensors.gazes[port]
        origin_m = plus(base.in_world(position_m), base.position())
        nearest_mm = math.inf
        for ray in sensors.rays[port]:
            direction = base.in_world(ray)
            hit = self.engine.ray(
                origin_m,
                direction,
                sensors.echoing_groups,
                sensors.silent_body,
            )
            if hit is None:
                continue
            distance_mm = hit.distance_m * 1000.0
            if hit.geom in sensors.soft_geoms:
                is_heard = distance_mm < self.physics.soft_range_mm
            else:
                is_heard = -dot(direction, hit.normal) >= self._least_echo
            if is_heard:
                nearest_mm = min(nearest_mm, distance_mm)
        return nearest_mm

    def sensed(
        self,
        port: str,
        sense: Sense,
    ) -> Sensed:
        """Present stimulus of a sensor, from the world around it; reflected light has noise."""
        if sense is Sense.TILT:
            return self.tilt_deg()
        sensors = self._sensors
        if sense is Sense.FORCE:
            return self.engine.sensordata[sensors.forces[port]]
        if sense is Sense.COUNT:
            # Nothing passes a sensor here that counts what passes.
            return 0.0
        if sense is Sense.ROTATION:
            return self._rotation(port)
        base = self._base
        position_m, forwards = sensors.gazes[port]
        eye_m = plus(base.in_world(position_m), base.position())
        gaze = base.in_world(forwards)
        if sense is Sense.DISTANCE:
            full_mm = INFRARED_MM[sensors.kinds[port]]
            rays = [base.in_world(ray) for ray in sensors.rays[port]]
            nearest_mm = min(sensors.world.distance_mm(eye_m, ray) for ray in rays)
            return 100.0 * min(nearest_mm / full_mm, 1.0)
        if sense is Sense.BEACON:
            left = base.in_world(sensors.lefts[port])
            return sensors.world.beacon(eye_m, gaze, left)
        if sense is Sense.AMBIENT:
            return sensors.world.ambient(eye_m, gaze)
        hue, saturation, value = sensors.world.surface(eye_m, gaze)
        noise_pct = self.physics.color_noise_pct * self._noise.standard_normal()
        reading_pct = min(max(value + noise_pct, 0.0), 100.0)
        return hue, saturation, reading_pct

    def _rotation(self, port: str) -> tuple[float, float]:
        """Angle since the start and rate of a gyroscope on a port, clockwise for who looks onto it
        against its axis, with drift, and noise of the rate."""
        physics = self.physics
        drift_share = SENSOR_DRIFTS[self._sensors.kinds[port]]
        angle_deg = drift_share * self._drift_deg()
        rate_deg_s = drift_share * physics.gyro_drift_deg_min / 60.0
        rate_deg_s += physics.gyro_noise_deg_s * self._noise.standard_normal()
        # Sensors are on the first body, which a fixed robot does not turn.
        if self.moves:
            self.update_turns()
            base = self._base
            _, axis = self._sensors.gazes[port]
            # Rotations are counter-clockwise here.
            scale = -math.degrees(self._gyro_scale)
            angle_deg += scale * dot(self._turns.rotation_rad, axis)
            rate_deg_s += scale * dot(base.angular_velocity(), base.in_hub(axis))
        return angle_deg, rate_deg_s

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch (nose down positive) and roll (right side down positive) from the direction of "up"
        in the hub's frame.

        As in the firmware, this is the fused orientation, which accelerations do not disturb, but
        the accelerometer's bias does.
        """
        x, y, z = self._base.up(self._up)
        bias_x, bias_y, bias_z = self._acceleration_bias_mm_s2
        up_x = x + bias_x / _GRAVITY_MM_S2
        up_y = y + bias_y / _GRAVITY_MM_S2
        up_z = z + bias_z / _GRAVITY_MM_S2
        across = math.hypot(up_y, up_z)
        pitch_deg = math.degrees(math.atan2(-up_x, across))
        roll_deg = math.degrees(math.atan2(up_y, up_z))
        noise_deg = self.physics.tilt_noise_deg
        draw = self._noise.standard_normal
        # In this order: runs with a seed are repeated by it.
        noisy_pitch_deg = pitch_deg + noise_deg * draw()
        noisy_roll_deg = roll_deg + noise_deg * draw()
        return noisy_pitch_deg, noisy_roll_deg

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub, with noise, scale error and drift; counter-clockwise
        about each axis is positive."""
        scale = self._gyro_scale
        noise_deg_s = self.physics.gyro_noise_deg_s
        drift_deg_s = self.physics.gyro_drift_deg_min / 60.0
        draw = self._noise.standard_normal
        x, y, z = (
            math.degrees(rate) * scale + (noise_deg_s * draw() - drift_deg_s)
            for rate in self._base.angular_velocity()
        )
        return x, y, z

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub, with noise and bias; at rest (0, 0, +9810)."""
        noise_mm_s2 = self.physics.acceleration_noise_mm_s2
        draw = self._noise.standard_normal
        force = self._base.specific_force()
        x, y, z = (
            part * 1000.0 + (noise_mm_s2 * draw() + bias)
            for part, bias in zip(force, self._acceleration_bias_mm_s2, strict=True)
        )
        return x, y, z

    def true_place(self) -> tuple[float, float, float]:
        """Where the robot is on the floor: x and y in mm, heading in deg."""
        pose = self.pose()
        return 1000.0 * pose.x_m, 1000.0 * pose.y_m, pose.heading_deg

    def heading_deg(self) -> float:
        """Rotation about the vertical since the start, as summed up from the gyroscope, clockwise
        positive, not wrapped."""
        self.update_turns()
        now_s = self.steps * TIMESTEP_S
        noise_deg = self._heading_noise.deg(now_s, self.physics.gyro_noise_deg_s)
        error_deg = noise_deg + self._drift_deg()
        turned_deg = self._turns.heading_deg - self._heading_at_start_deg
        return turned_deg * self._gyro_scale + error_deg

    def rotation_deg(self) -> tuple[float, float, float]:
        """Angular velocity in the frame of the hub, summed up since the start, without noise."""
        self.update_turns()
        scale = self._gyro_scale
        drift_deg = self._drift_deg()
        x, y, z = self._base.in_hub(self._turns.rotation_rad)
        return (
            math.degrees(x) * scale - drift_deg,
            math.degrees(y) * scale - drift_deg,
            math.degrees(z) * scale - drift_deg,
        )

    def _drift_deg(self) -> float:
        """What the gyroscope has drifted since the start, clockwise."""
        return self.physics.gyro_drift_deg_min / 60.0 * self.steps * TIMESTEP_S
