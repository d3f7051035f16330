"""Body simulated by MuJoCo: voltages in, angles and sensor readings out, with the physics of the
twin."""

import copy
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from brickhub.robot import Robot, Sense, UltrasonicSensor
from brickhub.virtual.body import Rng
from brickhub.virtual.stimuli import Sensed
from bricktwin.plans import ldraw_library
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP, SHAPE_GROUP, TIMESTEP_S, yaw_quaternion
from bricktwin.twin.models.motors import motor_constants
from bricktwin.twin.models.mounts import INFRARED_MM, site_name
from bricktwin.twin.models.turning import TurningParts
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import FixedBase, FloatingBase, SummedNoise, Turns, Vector, WorldSenses
from bricktwin.twin.stance import Feet, refuse_overlap, standing_pose

_NEAREST_MM = UltrasonicSensor.NEAREST_MM
_FARTHEST_MM = UltrasonicSensor.FARTHEST_MM
_CONE_DEG = (-12.0, -6.0, 0.0, 6.0, 12.0)
_SETTLING_STEPS = 400
_FAR_M = 100.0
_GRAVITY_MM_S2 = 9810.0
# Steps between two updates of the turns: few enough that no robot turns by half a turn.
_STEPS_PER_UPDATE = 20
STEPS_PER_LOAD = 2
_LOADS_PER_AVERAGE = 128
_AT_REST = 5e-3
"""Speed of each joint below which a robot is at rest, m/s and rad/s."""
_HELD_KG_M2 = 1e3
"""Inertia of a shaft that a motor holds: nothing on a robot moves it within a second."""


@dataclasses.dataclass(frozen=True)
class Pose:
    """Pose of a robot.

    Attributes:
        x_m, y_m: position of the chassis' origin on the floor (2Wheeler: the middle of its axle;
        RoboArm: always 0).
        heading_deg: clockwise positive seen from above, 0 along x, not wrapped.
    """

    x_m: float
    y_m: float
    heading_deg: float


def _end(ends: Iterator[int], *bounds: float) -> float:
    """An end of a range: 0 for the lower one."""
    return bounds[next(ends)]


@functools.lru_cache(maxsize=8)
def _compiled(robot: Robot, scene: Scene, _looks: Path | None) -> mujoco.MjModel:
    """Compiled model, cached because a new body is made often and a copy takes a tenth of the time.
    Copy it before use."""
    return robot_model(robot, scene)


class MujocoBody:
    """Robot in MuJoCo; implements :class:`brickhub.virtual.body.Body`. Raises TwinError if there is
    no model of this robot, or it cannot be placed in this scene.

    The simulation is deterministic, bit for bit, given the arguments and the calls.

    Args:
        robot: description of the robot.
        scene: surroundings of the robot.
        physics: parameters, or a sampler of them for each reset.
        seed: seed of the sensors' noise and of the first start.

    Attributes:
        model, data: MuJoCo's model and data, e.g. for a renderer.
        tyres: geometries of the drive base's tyres, left and right, if it has such.
        chassis: index of the first body; ``moves``: whether it moves freely.
        physics: the present parameters; ``link``: those of the link.
        steps: of the physics since the body was made.
    """

    def __init__(
        self, robot: Robot, scene: Scene, physics: Physics | RandomPhysics, seed: int
    ) -> None:
        self.robot = robot
        self.scene = scene
        self._nominal = _compiled(robot, scene, ldraw_library.folder())
        self.model = copy.copy(self._nominal)
        self.data = mujoco.MjData(self.model)
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        self._bind()
        self._apply(Physics() if isinstance(physics, RandomPhysics) else physics)
        noise_seed, start_seed, heading_seed = np.random.SeedSequence(seed).spawn(3)
        self._noise = np.random.default_rng(noise_seed)
        self._heading_noise = SummedNoise(np.random.default_rng(heading_seed))
        self.steps = self._steps_since_update = 0
        self._turns = Turns()
        self._heading_at_start_deg = 0.0
        self._settle()
        self._check_starts()
        self.reset(np.random.default_rng(start_seed))
        self._heading_at_start_deg = self._turns.heading_deg
        self._turns.rotation_rad[:] = 0.0

    def actuator(self, port: str) -> int:
        """Index of a motor's actuator in the model."""
        return self._terminals[port][0]

    def is_stopped(self, port: str) -> bool:
        """Whether the joint of a motor has end stops."""
        return bool(self.model.jnt_limited[self.model.actuator_trnid[self.actuator(port), 0]])

    def _bind(self, prefix: str = "") -> None:
        """Look up all names and arrays once; ``prefix`` begins the names of this robot in an
        arena."""
        model = self.model
        data = self.data
        root = int(model.body(f"{prefix}chassis").jntadr[0]) if prefix else 0
        self.chassis = int(model.jnt_bodyid[root])
        self.moves = bool(model.jnt_type[root] == mujoco.mjtJoint.mjJNT_FREE)
        self._bind_motors(prefix)
        self._backlash = _backlash_joints(model)
        feet = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("foot_")]
        # Nothing stands on one foot; in an arena a robot keeps the stance in which it has settled.
        self._feet = Feet(model, feet) if len(feet) > 1 and not prefix else None
        self.base_address = int(model.jnt_qposadr[root])
        dof = int(model.jnt_dofadr[root])
        imu = f"{prefix}imu"
        self._base = (
            FloatingBase(model, data, self.base_address, dof, imu)
            if self.moves
            else FixedBase(model, data, imu)
        )
        self._turning = TurningParts(model)
        self._bind_sensors(prefix)
        # A pushable block has a free joint, after the robot's joints.
        self._block_addresses = [
            int(model.joint(f"object_{number}").qposadr[0]) for number in self.scene.pushable
        ]
        self._detected_groups = np.zeros(6, np.uint8)
        # Other robots are obstacles too, but not this one.
        self._detected_groups[[OBSTACLE_GROUP, SHAPE_GROUP] if prefix else OBSTACLE_GROUP] = 1
        self._undetected_body = self.chassis if prefix else -1
        self._qpos = data.qpos
        self._qvel = data.qvel
        self._options = model.opt
        # NumPy is slow for single values.
        self._joint_positions = cast("memoryview[float]", memoryview(data.qpos))
        self._voltages_v = cast("memoryview[float]", memoryview(data.ctrl))
        self._torques_nm = cast("memoryview[float]", memoryview(data.actuator_force))

    def _bind_motors(self, prefix: str) -> None:
        model = self.model
        ports = [motor.port for motor in self.robot.motors]
        base = self.robot.drive_base
        wheels = (
            []
            if base is None
            else [self.robot.motor(name).port for name in (base.left, base.right)]
        )
        tyres = [
            mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"{prefix}tyre_{port}")
            for port in wheels
        ]
        # a model of the user may have other names
        self.tyres = tyres if min(tyres, default=-1) >= 0 else []
        joints = {port: model.joint(f"{prefix}motor_{port}") for port in ports}
        actuators = {port: int(model.actuator(f"{prefix}motor_{port}").id) for port in ports}
        self._gears = {
            port: float(model.actuator_gear[index, 0]) for port, index in actuators.items()
        }
        self._shaft = {
            port: (int(joints[port].qposadr[0]), gear * math.degrees(1000.0))
            for port, gear in self._gears.items()
        }
        constants = {motor.port: motor_constants(motor.kind) for motor in self.robot.motors}
        self._amperes = [
            (index, 1.0 / constants[port].torque_nm_a) for port, index in actuators.items()
        ]
        self.shaft_dofs = [int(joint.dofadr[0]) for joint in joints.values()]
        self._terminals = {
            port: (index, 1 << int(model.actuator_group[index]))
            for port, index in actuators.items()
        }

    def _bind_sensors(self, prefix: str) -> None:
        rays = np.array(
            [
                (math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0)
                for angle in _CONE_DEG
            ]
        )
        sensors = [sensor for sensor in self.robot.sensors if sensor.kind.model.senses]
        self._sensor_kinds = {sensor.port: sensor.kind for sensor in sensors}
        self._sensor_frames = {
            sensor.port: self._site(f"{prefix}{site_name(sensor)}") for sensor in sensors
        }
        sonars = [
            port for port, kind in self._sensor_kinds.items() if kind.model.range_mm is not None
        ]
        places = {port: self._sensor_frames[port] for port in sonars}
        self._sonars = {
            port: (position, rays @ frame.T) for port, (position, frame) in places.items()
        }
        soft = [number for number, item in enumerate(self.scene.solids) if item.soft]
        self._soft_geoms = {int(self.model.geom(f"object_{number}").id) for number in soft}
        forces = [
            port for port, kind in self._sensor_kinds.items() if Sense.FORCE in kind.model.senses
        ]
        self._forces = {port: self.data.sensor(f"{prefix}force_{port}").data for port in forces}
        self._world = WorldSenses(self.model, self.data, self.scene)

    def _site(self, name: str) -> tuple[Vector, NDArray[np.float64]]:
        """Position of a site on the chassis [3], and its axes as columns [3, 3]. Raises TwinError
        if there is no such site."""
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if index < 0:
            sensor = next(sensor for sensor in self.robot.sensors if sensor.port == name[-1])
            raise TwinError(
                f"the model of robot '{self.robot.name}' has no place for '{sensor.name}' (a site "
                f"'{name}'); give it one, or the "
                "robot no model and the scene what the sensor reads"
            )
        frame = np.empty(9)
        mujoco.mju_quat2Mat(frame, self.model.site_quat[index])
        return self.model.site_pos[index].copy(), frame.reshape(3, 3)

    # ---------------------------------------------------------------- physics and start

    def _use(self, physics: Physics) -> None:
        """Set the parameters that are not the model's."""
        self.physics = physics
        self.link = physics.link
        self._up = _up(physics)
        self.battery_mv = round(physics.battery_v * 1000)
        self._terminal_v = self._average_v = physics.battery_v
        self._encoder_step_mdeg = round(physics.encoder_resolution_deg * 1000)
        self._acceleration_bias_mm_s2: Vector = np.array(
            [
                physics.acceleration_bias_x_mm_s2,
                physics.acceleration_bias_y_mm_s2,
                physics.acceleration_bias_z_mm_s2,
            ]
        )
        self._gyro_scale = 1.0 + physics.gyro_scale_error_pct / 100.0
        self._least_echo = math.cos(math.radians(physics.echo_angle_deg))

    def _apply(self, physics: Physics) -> None:
        model = self.model
        self._use(physics)
        set_physics(model, self._nominal, physics, [self], range(model.nbody))
        for joint in self._backlash:
            play = model.jnt_range[joint, 1]
            address = model.jnt_qposadr[joint]
            self._qpos[address] = min(max(self._qpos[address], -play), play)

    def coast(self) -> None:
        """Let all motors coast."""
        for port in self._terminals:
            self.set_voltage(port, None)

    def _settle(self) -> None:
        """Open all circuits; let a robot on wheels settle on the floor and record its stance."""
        self.coast()
        if self._feet is not None or not self.moves:
            return
        if self.scene.objects:
            self._qpos[0] = _FAR_M  # away from objects at the start position
        settle(self.model, self.data, [self])
        self.record_stance()
        self._qpos[self.model.jnt_qposadr[self._backlash]] = 0.0
        self._qpos[[address for address, _ in self._shaft.values()]] = 0.0

    def reset(self, rng: Rng) -> None:
        """Put the robot down at the start of an episode and let it come to rest; motors keep their
        angles, clock and program continue. ``rng``: generator of the start pose, and of the physics
        if random."""
        if self._random_physics is not None:
            drawn = self._random_physics.sample(rng)
            # A load on a base that is fixed changes nothing.
            self._apply(drawn if self.moves else dataclasses.replace(drawn, side_load_g=0.0))
        self._qvel[:] = 0.0
        self._reset_blocks(rng)
        if self.moves:
            self._place(rng.uniform)
        come_to_rest(self.model, self.data, [self], self.scene)

    def _check_starts(self) -> None:
        """Raise TwinError if the robot would be inside of an obstacle at an end of the ranges of
        its start."""
        if self.moves and (self.scene.objects or self.scene.wall_distance_mm is not None):
            for ends in itertools.product((0, 1), repeat=4):
                self._place(functools.partial(_end, iter(ends)))
                mujoco.mj_forward(self.model, self.data)
                refuse_overlap(self.model, self.data, self.scene)

    def _reset_blocks(self, rng: Rng) -> None:
        """Put pushable blocks, and what a hand has moved, back to their start positions."""
        self.data.mocap_pos[:] = self.model.body_pos[self.model.body_mocapid >= 0]
        for address, block in zip(self._block_addresses, self.scene.pushable.values(), strict=True):
            self._qpos[address : address + 7] = self.model.qpos0[address : address + 7]
            if any(block.spread_mm):
                self._qpos[address : address + 2] += [
                    rng.uniform(-spread / 1000, spread / 1000) for spread in block.spread_mm
                ]

    def _place(self, draw: Callable[[float, float], float]) -> None:
        """Place the robot on the floor, in front of the wall if there is one; ``draw`` chooses from
        a range."""
        heading_deg = draw(*self.scene.heading_deg)
        x_mm, y_mm = (low if low == high else draw(low, high) for low, high in self.scene.start_mm)
        self.put(Pose(x_mm / 1000, y_mm / 1000, heading_deg))
        if self.scene.wall_distance_mm is not None:
            self.face_wall(draw(*self.scene.wall_distance_mm), heading_deg)

    def face_wall(self, distance_mm: float, heading_deg: float) -> None:
        """Put the robot on the floor with its first ultrasonic sensor at this distance from the
        scene's wall."""
        self.put(Pose(0.0, 0.0, heading_deg))
        face_m = self.model.body("wall").pos[0] - self.model.geom("wall").size[0]
        sonar_m = self._base.in_world(next(iter(self._sonars.values()))[0])
        self._qpos[0] = face_m - distance_mm / 1000 - sonar_m[0]
        self._qpos[1] = -sonar_m[1]

    def put(self, start: Pose) -> None:
        """Put the standing robot on the floor."""
        standing, height_m = self._stand()
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(
            quaternion, np.array(yaw_quaternion(-math.radians(start.heading_deg))), standing
        )
        self._qpos[self.base_address : self.base_address + 7] = (
            start.x_m,
            start.y_m,
            height_m,
            *quaternion,
        )

    def record_stance(self) -> None:
        """Record the stance of a robot on wheels, after it has settled on the floor."""
        _, _, height_m, *quaternion = self._qpos[self.base_address : self.base_address + 7].tolist()
        self._standing = np.array(quaternion), height_m

    def _stand(self) -> tuple[Vector, float]:
        """Orientation and height of the standing robot: constant on wheels, derived from the
        present leg angles on legs."""
        if self._feet is None:
            return self._standing
        model = self.model
        data = self.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        chassis = self.chassis
        frame = data.xmat[chassis].reshape(3, 3)
        origin = data.xpos[chassis]
        points_m = self._feet.points_m(data) - origin
        centre_m = data.subtree_com[chassis] - origin
        quaternion, height_m = standing_pose(points_m @ frame, centre_m @ frame)
        return quaternion, height_m + self._feet.radius_m

    def pose(self) -> Pose:
        """True pose of the robot: for metrics, not for agents."""
        self.update_turns()
        x_m, y_m, _ = self._base.position().tolist()
        return Pose(x_m, y_m, self._turns.heading_deg)

    def update_visuals(self) -> None:
        """Update the drawn geometry to the joint positions, for renderers; physics steps do not."""
        mujoco.mj_kinematics(self.model, self.data)
        self._turning.turn(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    # ---------------------------------------------------------------- time

    def advance_to(self, time_ms: int) -> None:
        """Integrate whole steps up to this simulated time."""
        remaining = time_ms * 2 // 5 - self.steps
        while remaining > 0:
            steps = STEPS_PER_LOAD - self.steps % STEPS_PER_LOAD
            steps = steps if steps < remaining else remaining
            mujoco.mj_step(self.model, self.data, steps)
            remaining -= steps
            self.steps += steps
            self._steps_since_update += steps
            if self._steps_since_update >= _STEPS_PER_UPDATE:
                self.update_turns()
            if self.steps % STEPS_PER_LOAD == 0:
                self.load_battery()

    def update_turns(self) -> None:
        """Add the turn since the last call; to be called before the robot has turned by half a
        turn."""
        self._steps_since_update = 0
        self._turns.update(self._base.orientation())

    # ---------------------------------------------------------------- motors

    def load_battery(self) -> None:
        """Load the battery with the motors' present currents, and average its voltage as the
        firmware does, every 5 ms.

        A bridge gives a motor a share of the battery's voltage, and takes that share of the motor's
        current from it. The firmware chooses the share by its slow average (Pybricks'
        ``battery.c``).
        """
        voltages = self._voltages_v
        torques = self._torques_nm
        power_w = 0.0
        for motor, amperes_per_nm in self._amperes:
            power_w += voltages[motor] * torques[motor] * amperes_per_nm
        before_v = self._terminal_v
        physics = self.physics
        self._terminal_v = terminal_v = physics.battery_v - physics.battery_ohm * power_w / before_v
        change = terminal_v / before_v
        for motor, _ in self._amperes:
            voltages[motor] *= change
        self._average_v += (terminal_v - self._average_v) / _LOADS_PER_AVERAGE
        self.battery_mv = int(self._average_v * 1000.0 + 0.5)

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft in whole steps of its rotation sensor, clockwise positive."""
        address, mdeg = self._shaft[port]
        step = self._encoder_step_mdeg
        angle: float = self._joint_positions[address]
        return math.floor(angle * mdeg / step + 0.5) * step

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        """Apply a voltage, at most the battery's; 0 shorts the motor (brake), ``None`` opens the
        circuit (coast)."""
        actuator, circuit = self._terminals[port]
        if (voltage_mv is None) is not bool(self._options.disableactuator & circuit):
            self._options.disableactuator ^= circuit
        if voltage_mv is not None:
            share = voltage_mv / self.battery_mv
            share = 1.0 if share > 1.0 else -1.0 if share < -1.0 else share
            self._voltages_v[actuator] = share * self._terminal_v

    # ---------------------------------------------------------------- sensors

    def distance_mm(self, port: str) -> int:
        """Distance to the nearest obstacle or robot that throws one of five rays in a cone of 24
        degrees back, with noise, bias and failures; 40..2000.

        What is hard is a mirror of sound and throws back what meets it nearly at right angles; what
        is soft scatters sound, and is seen late.
        """
        if (
            self.physics.distance_dropout_share
            and self._noise.random() < self.physics.distance_dropout_share
        ):
            return _FARTHEST_MM
        position, rays = self._sonars[port]
        origin = self._base.in_world(position) + self._base.position()
        nearest_mm = math.inf
        geom = np.empty(1, np.int32)
        normal = np.empty(3)
        for ray in rays:
            direction = self._base.in_world(ray)
            distance_m = mujoco.mj_ray(
                self.model,
                self.data,
                origin,
                direction,
                self._detected_groups,
                True,
                self._undetected_body,
                geom,
                normal,
            )
            if distance_m >= 0.0:
                is_soft = geom[0] in self._soft_geoms
                if (
                    distance_m * 1000.0 < self.physics.soft_range_mm
                    if is_soft
                    else -(direction @ normal) >= self._least_echo
                ):
                    nearest_mm = min(nearest_mm, distance_m * 1000.0)
        if nearest_mm >= _FARTHEST_MM:
            return _FARTHEST_MM
        deviation_mm = (
            self.physics.distance_noise_mm + self.physics.distance_noise_ratio * nearest_mm
        )
        reading_mm = round(
            nearest_mm
            + self.physics.distance_bias_mm
            + deviation_mm * self._noise.standard_normal()
        )
        return min(max(reading_mm, _NEAREST_MM), _FARTHEST_MM)

    def sensed(self, port: str, sense: Sense) -> Sensed:
        """Present stimulus of a sensor, from the world around it; reflected light has noise."""
        if sense is Sense.TILT:
            return self.tilt_deg()
        if sense is Sense.FORCE:
            return float(self._forces[port][0])
        if sense is Sense.COUNT:
            return 0.0
        position, frame = self._sensor_frames[port]
        eye = self._base.in_world(position) + self._base.position()
        gaze = self._base.in_world(frame[:, 0].copy())
        if sense is Sense.DISTANCE:
            return 100.0 * min(
                self._world.distance_mm(eye, gaze) / INFRARED_MM[self._sensor_kinds[port]], 1.0
            )
        if sense is Sense.AMBIENT:
            return self._world.ambient(eye, gaze)
        hue, saturation, value = self._world.surface(eye, gaze)
        noise_pct = self.physics.color_noise_pct * self._noise.standard_normal()
        return hue, saturation, min(max(value + noise_pct, 0.0), 100.0)

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch (nose down positive) and roll (right side down positive) from the direction of "up"
        in the hub's frame.

        As in the firmware, this is the fused orientation, which accelerations do not disturb, but
        the accelerometer's bias does.
        """
        up_x, up_y, up_z = (
            self._base.up(self._up) + self._acceleration_bias_mm_s2 / _GRAVITY_MM_S2
        ).tolist()
        pitch_deg = math.degrees(math.atan2(-up_x, math.hypot(up_y, up_z)))
        roll_deg = math.degrees(math.atan2(up_y, up_z))
        noise_pitch, noise_roll = (
            self.physics.tilt_noise_deg * self._noise.standard_normal(2)
        ).tolist()
        return pitch_deg + noise_pitch, roll_deg + noise_roll

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub, with noise, scale error and drift; counter-clockwise
        about each axis is positive."""
        scale = self._gyro_scale
        noise_deg_s = self.physics.gyro_noise_deg_s
        drift_deg_s = self.physics.gyro_drift_deg_min / 60.0
        rates = self._base.angular_velocity().tolist()
        noise = self._noise.standard_normal(3).tolist()
        # NumPy is slow for three values.
        x, y, z = (
            math.degrees(rate) * scale + (noise_deg_s * a - drift_deg_s)
            for rate, a in zip(rates, noise, strict=True)
        )
        return x, y, z

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub, with noise and bias; at rest (0, 0, +9810)."""
        noise = (
            self.physics.acceleration_noise_mm_s2 * self._noise.standard_normal(3)
            + self._acceleration_bias_mm_s2
        )
        x, y, z = (self._base.specific_force() * 1000.0 + noise).tolist()
        return x, y, z

    def heading_deg(self) -> float:
        """Rotation about the vertical since the start, as summed up from the gyroscope, clockwise
        positive, not wrapped."""
        self.update_turns()
        noise_deg = (
            self._heading_noise.deg(self.steps * TIMESTEP_S, self.physics.gyro_noise_deg_s)
            + self._drift_deg()
        )
        return (self._turns.heading_deg - self._heading_at_start_deg) * self._gyro_scale + noise_deg

    def rotation_deg(self) -> tuple[float, float, float]:
        """Angular velocity in the frame of the hub, summed up since the start, without noise."""
        self.update_turns()
        rotation = (
            np.degrees(self._base.in_hub(self._turns.rotation_rad)) * self._gyro_scale
            - self._drift_deg()
        )
        x, y, z = rotation.tolist()
        return x, y, z

    def _drift_deg(self) -> float:
        """What the gyroscope has drifted since the start, clockwise."""
        return self.physics.gyro_drift_deg_min / 60.0 * self.steps * TIMESTEP_S


SIDE_LOAD_OFFSET_M = (0.0, 0.048, 0.0)
"""Position of the side load relative to the chassis' centre of mass: 6 modules of LEGO to the left,
in the hub's axes."""


def settle(model: mujoco.MjModel, data: mujoco.MjData, robots: Sequence[MujocoBody]) -> None:
    """Let robots come to rest where they are put, with their motors held: play is taken up, feet
    find the floor."""
    places = [slice(robot.base_address, robot.base_address + 2 * robot.moves) for robot in robots]
    starts_m = [data.qpos[place].copy() for place in places]
    shafts = [dof for robot in robots for dof in robot.shaft_dofs]
    armature = model.dof_armature.copy()
    model.dof_armature[shafts] = _HELD_KG_M2
    for _ in range(_SETTLING_STEPS // _STEPS_PER_UPDATE):
        mujoco.mj_step(model, data, _STEPS_PER_UPDATE)
        if np.abs(data.qvel).max() < _AT_REST:
            break
    model.dof_armature[:] = armature
    for place, start_m in zip(places, starts_m, strict=True):
        data.qpos[place] = start_m
    data.qvel[:] = 0.0
    data.qacc_warmstart[:] = 0.0
    mujoco.mj_forward(model, data)


def come_to_rest(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robots: Sequence[MujocoBody],
    scene: Scene | None = None,
) -> None:
    """Let robots that were put somewhere come to rest. Raises TwinError if one is inside of an
    obstacle of the ``scene``, or of an arena."""
    data.qacc_warmstart[:] = 0.0
    mujoco.mj_forward(model, data)
    refuse_overlap(model, data, scene)
    settle(model, data, robots)
    for robot in robots:
        robot.update_turns()


def _backlash_joints(model: mujoco.MjModel) -> list[int]:
    """Joints between a motor's shaft and what it drives."""
    return [joint for joint in range(model.njnt) if "backlash_" in model.joint(joint).name]


def set_physics(
    model: mujoco.MjModel,
    nominal: mujoco.MjModel,
    physics: Physics,
    robots: Sequence[MujocoBody],
    bodies: Sequence[int],
) -> None:
    """Set a model's parameters. Raises TwinError if there is a side load, and a robot without a
    chassis that moves.

    Args:
        nominal: the same model as compiled.
        bodies: bodies whose masses are scaled.
    """
    model.opt.gravity[:] = nominal.opt.gravity[2] * _up(physics)
    model.geom_friction[:] = nominal.geom_friction * physics.friction_scale
    model.pair_friction[:] = nominal.pair_friction * physics.friction_scale
    model.body_mass[bodies] = nominal.body_mass[bodies] * physics.mass_scale
    model.body_inertia[bodies] = nominal.body_inertia[bodies] * physics.mass_scale
    play = math.radians(physics.backlash_deg)
    model.jnt_range[_backlash_joints(model)] = (-play, play)
    for robot in robots:
        for tyre, share in zip(robot.tyres, (0.5, -0.5), strict=False):
            size = 1.0 + share * physics.wheel_difference_pct / 100.0
            model.geom_size[tyre] = nominal.geom_size[tyre] * size
            model.geom_rbound[tyre] = nominal.geom_rbound[tyre] * size
            model.geom_aabb[tyre] = nominal.geom_aabb[tyre] * size
        for motor, scale in zip(robot.robot.motors, physics.motor_scales, strict=False):
            actuator = robot.actuator(motor.port)
            dof = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
            friction_nm = motor_constants(motor.kind).friction_nm * abs(
                nominal.actuator_gear[actuator, 0]
            )
            model.dof_frictionloss[dof] = (
                nominal.dof_frictionloss[dof] + (physics.motor_friction_scale - 1.0) * friction_nm
            )
            model.actuator_biasprm[actuator, 2] = nominal.actuator_biasprm[actuator, 2] / scale
        if robot.moves:
            _add_side_load(model, nominal, robot.chassis, physics.side_load_g / 1000)
        elif physics.side_load_g:
            raise TwinError(
                "physics: side_load_g is for robots that move; leave it at 0 for one that stands "
                "on a fixed base"
            )
    mujoco.mj_setConst(model, mujoco.MjData(model))  # derives constants from the masses


def _up(physics: Physics) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Upward direction [3] in the axes of the floor, which rises along x."""
    slope = math.radians(physics.slope_deg)
    return np.array([math.sin(slope), 0.0, math.cos(slope)])


def _add_side_load(
    model: mujoco.MjModel, nominal: mujoco.MjModel, body: int, load_kg: float
) -> None:
    """Add a point mass at the side of a chassis: mass, centre of mass and inertia change (parallel
    axis theorem)."""
    model.body_ipos[body] = nominal.body_ipos[body]
    model.body_iquat[body] = nominal.body_iquat[body]
    if load_kg == 0.0:
        return
    mass_kg = float(model.body_mass[body])
    offset = np.array(SIDE_LOAD_OFFSET_M)
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, nominal.body_iquat[body])
    axes = frame.reshape(3, 3)
    reduced_kg = mass_kg * load_kg / (mass_kg + load_kg)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    inertia += reduced_kg * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    moments, columns = np.linalg.eigh(inertia)
    columns[:, 0] *= np.linalg.det(columns)  # a rotation, not a mirror image
    mujoco.mju_mat2Quat(model.body_iquat[body], columns.ravel())
    model.body_inertia[body] = moments
    model.body_ipos[body] = nominal.body_ipos[body] + offset * load_kg / (mass_kg + load_kg)
    model.body_mass[body] = mass_kg + load_kg
