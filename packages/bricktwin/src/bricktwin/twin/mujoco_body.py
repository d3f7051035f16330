"""Body simulated by MuJoCo: voltages in, angles and sensor readings out."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from brickhub.errors import TwinError
from brickhub.robot import MotorKind, Robot, Sense, UltrasonicSensor
from brickhub.virtual.body import Rng
from brickhub.virtual.stimuli import Sensed
from bricktwin.twin import ldraw
from bricktwin.twin.imu import FixedBase, FloatingBase, Turns, Vector
from bricktwin.twin.model_physics import RobotPart, backlash_joints, set_physics, up
from bricktwin.twin.models.kept_models import robot_model
from bricktwin.twin.models.mjcf import OBSTACLE_GROUP, yaw_quaternion
from bricktwin.twin.models.mounts import body_of, site_name
from bricktwin.twin.models.rods import Rods
from bricktwin.twin.models.spinners import Spinners
from bricktwin.twin.objects import Block, Solid
from bricktwin.twin.physics import Physics, RandomPhysics
from bricktwin.twin.scene import Scene
from bricktwin.twin.senses import WorldSenses, percent
from bricktwin.twin.stance import Feet, standing_pose
from bricktwin.twin.starts import ends_of_ranges, refuse_overlap

_NEAREST_MM, _FARTHEST_MM = UltrasonicSensor.NEAREST_MM, UltrasonicSensor.FARTHEST_MM
_CONE_DEG = (-12.0, -6.0, 0.0, 6.0, 12.0)
_SETTLING_STEPS = 400
_FAR_M = 100.0
# Steps between two updates of the turns: few enough that no robot turns by half a turn.
_STEPS_PER_UPDATE = 20
# A smaller torque of gravity is rounding, as on a vertical joint.
_MIN_PULL_NM = 1e-3


@dataclass(frozen=True)
class Pose:
    """Pose of a robot.

    Attributes:
        x_m, y_m: position of the chassis' origin on the floor (2Wheeler: the middle of its axle; RoboArm: always 0).
        heading_deg: clockwise positive seen from above, 0 along x, not wrapped.
    """

    x_m: float
    y_m: float
    heading_deg: float


@functools.lru_cache(maxsize=8)
def _compiled(robot: Robot, scene: Scene, _looks: Path | None) -> mujoco.MjModel:
    """Compiled model, cached because a new body is made often and a copy takes a tenth of the time. Copy it before use."""
    return robot_model(robot, scene)


class MujocoBody:
    """Robot in MuJoCo; implements :class:`brickhub.virtual.body.Body`. Raises TwinError if there is no model of this robot,
    or it cannot be placed in this scene.

    The simulation is deterministic, bit for bit, given the arguments and the calls.

    Args:
        robot: description of the robot.
        scene: surroundings of the robot.
        physics: parameters, or a sampler of them for each reset.
        seed: seed of the sensors' noise and of the first start.

    Attributes:
        model, data: MuJoCo's model and data, e.g. for a renderer.
        physics: the present parameters.
    """

    def __init__(self, robot: Robot, scene: Scene, physics: Physics | RandomPhysics, seed: int) -> None:
        self.robot = robot
        self._kinds: dict[str, MotorKind] = {motor.port: motor.kind for motor in robot.motors}
        self.scene = scene
        self._nominal = _compiled(robot, scene, ldraw.folder())
        self.model = copy.copy(self._nominal)
        self.data = mujoco.MjData(self.model)
        self._random_physics = physics if isinstance(physics, RandomPhysics) else None
        self._bind()
        self._apply(Physics() if isinstance(physics, RandomPhysics) else physics)
        noise_seed, start_seed = np.random.SeedSequence(seed).spawn(2)
        self._noise = np.random.default_rng(noise_seed)
        self._steps = self._steps_since_update = 0
        self._turns, self._heading_at_start_deg = Turns(), 0.0
        self._settle()
        self._check_starts()
        self.reset(np.random.default_rng(start_seed))
        self._heading_at_start_deg = self._turns.heading_deg
        self._turns.rotation_rad[:] = 0.0

    @property
    def link_interval_ms(self) -> float:
        """Connection interval of the hub's link."""
        return self.physics.link_interval_ms

    def _bind(self) -> None:
        """Look up all names and arrays once."""
        model, data = self.model, self.data
        self._bind_motors()
        self._open_circuits = 0
        self._backlash = backlash_joints(model)
        feet = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("foot_")]
        self._feet = Feet(model, feet) if len(feet) > 1 else None  # nothing stands on one
        self._moves = bool(model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)
        self._base = FloatingBase(model, data) if self._moves else FixedBase(model, data)
        self._rods, self._spinners = Rods(model), Spinners(model)
        self._bind_sensors()
        # A pushable block has a free joint, after the robot's joints.
        self._block_addresses = [int(model.joint(f"object_{number}").qposadr[0]) for number in self._pushable()]
        self._detected_groups = np.zeros(6, np.uint8)
        self._detected_groups[OBSTACLE_GROUP] = 1
        self._qpos, self._qvel = data.qpos, data.qvel
        self._bind_values()

    def _bind_values(self) -> None:
        """View the joints and the voltages without NumPy, which is slow for single values."""
        self._joint_positions = cast("memoryview[float]", memoryview(self.data.qpos))
        self._voltages_v = cast("memoryview[float]", memoryview(self.data.ctrl))

    def _bind_motors(self, prefix: str = "") -> None:
        """Look up the motors; ``prefix`` begins the names of this robot."""
        model, ports = self.model, [motor.port for motor in self.robot.motors]
        joints = {port: model.joint(f"{prefix}motor_{port}") for port in ports}
        actuators = {port: int(model.actuator(f"{prefix}motor_{port}").id) for port in ports}
        self._gears = {port: float(model.actuator_gear[index, 0]) for port, index in actuators.items()}
        self._shaft = {port: (int(joints[port].qposadr[0]), gear * math.degrees(1000.0)) for port, gear in self._gears.items()}
        self._terminals = {port: (index, 1 << int(model.actuator_group[index])) for port, index in actuators.items()}

    def _bind_sensors(self, prefix: str = "", undetected_body: int = -1) -> None:
        """Look up the sensors; those for ultrasound do not detect ``undetected_body``."""
        rays = np.array([(math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0) for angle in _CONE_DEG])
        sensors = [sensor for sensor in self.robot.sensors if sensor.kind.model.senses]
        self._sensor_kinds = {sensor.port: sensor.kind for sensor in sensors}
        self._sensor_frames = {sensor.port: self._site(f"{prefix}{site_name(sensor)}") for sensor in sensors}
        sonars = [port for port, kind in self._sensor_kinds.items() if kind.model.range_mm is not None]
        places = {port: self._sensor_frames[port] for port in sonars}
        self._sonars = {port: (position, rays @ frame.T) for port, (position, frame) in places.items()}
        self._undetected_body = undetected_body
        forces = [port for port, kind in self._sensor_kinds.items() if Sense.FORCE in kind.model.senses]
        self._forces = {port: self.data.sensor(f"{prefix}force_{port}").data for port in forces}
        self._world = WorldSenses(self.model, self.data, self.scene)

    def _site(self, name: str) -> tuple[Vector, NDArray[np.float64]]:
        """Position of a site on the chassis [3], and its axes as columns [3, 3]. Raises TwinError if there is no such site."""
        index = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if index < 0:
            sensor = next(sensor for sensor in self.robot.sensors if sensor.port == name[-1])
            raise TwinError(
                f"the model of robot '{self.robot.name}' has no place for '{sensor.name}' (a site '{name}'); give it one, or the "
                "robot no model and the scene what the sensor reads"
            )
        frame = np.empty(9)
        mujoco.mju_quat2Mat(frame, self.model.site_quat[index])
        return self.model.site_pos[index].copy(), frame.reshape(3, 3)

    def _pushable(self) -> dict[int, Block]:
        """Pushable blocks of the scene, by their number among its solids."""
        solids = [item for item in self.scene.objects if isinstance(item, Solid)]
        return {number: item for number, item in enumerate(solids) if isinstance(item, Block) and item.mass_g is not None}

    # ---------------------------------------------------------------- physics and start

    def _apply(self, physics: Physics) -> None:
        model = self.model
        self.physics = physics
        self._up = up(physics)
        self.battery_mv = round(physics.battery_v * 1000)
        self._encoder_step_mdeg = round(physics.encoder_resolution_deg * 1000)
        motors = [(self._terminals[port][0], kind) for port, kind in self._kinds.items()]
        robot = RobotPart(motors, int(model.jnt_bodyid[0]) if self._moves else None)
        set_physics(model, self._nominal, physics, [robot], range(model.nbody))
        for joint in self._backlash:
            play, address = model.jnt_range[joint, 1], model.jnt_qposadr[joint]
            self._qpos[address] = min(max(self._qpos[address], -play), play)

    def _settle(self) -> None:
        """Open all circuits; let a robot on wheels settle on the floor and record its stance."""
        for port in self._kinds:
            self.set_voltage(port, None)
        if self._feet is not None or not self._moves:
            return
        if self.scene.objects:
            self._qpos[0] = _FAR_M  # away from objects at the start position
        slope, self.model.opt.gravity[:] = self.model.opt.gravity.copy(), self._nominal.opt.gravity
        mujoco.mj_step(self.model, self.data, _SETTLING_STEPS)  # on a level floor: with open circuits it may roll
        self.model.opt.gravity[:] = slope
        self._standing_height_m = float(self._qpos[2])
        self._standing_quaternion = self._qpos[3:7].copy()
        self._qpos[self.model.jnt_qposadr[self._backlash]] = 0.0
        self._qpos[[address for address, _ in self._shaft.values()]] = 0.0

    def reset(self, rng: Rng) -> None:
        """Place the robot at the start of an episode; motors keep their angles, clock and program continue. ``rng``: generator
        of the start pose, and of the physics if random."""
        if self._random_physics is not None:
            self._apply(self._random_physics.sample(rng))
        self._qvel[:] = 0.0
        self._reset_blocks(rng)
        if self._moves:
            self._place(rng.uniform)
        else:
            self._take_up_backlash()
        self.data.qacc_warmstart[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        refuse_overlap(self.model, self.data, self.scene)
        self._update_turns()

    def _check_starts(self) -> None:
        """Raise TwinError if the robot would be inside of an obstacle at an end of the ranges of its start."""
        if self._moves and (self.scene.objects or self.scene.wall_distance_mm is not None):
            for draw in ends_of_ranges(4):
                self._place(draw)
                mujoco.mj_forward(self.model, self.data)
                refuse_overlap(self.model, self.data, self.scene)

    def _reset_blocks(self, rng: Rng) -> None:
        """Put pushable blocks back to their start positions."""
        for address, block in zip(self._block_addresses, self._pushable().values(), strict=True):
            self._qpos[address : address + 7] = self.model.qpos0[address : address + 7]
            if any(block.spread_mm):
                self._qpos[address : address + 2] += [rng.uniform(-spread / 1000, spread / 1000) for spread in block.spread_mm]

    def _place(self, draw: Callable[[float, float], float]) -> None:
        """Place the robot on the floor, in front of the wall if there is one; ``draw`` chooses from a range."""
        yaw = -math.radians(draw(*self.scene.heading_deg))
        standing, height_m = self._stand()
        turn, quaternion = np.array(yaw_quaternion(yaw)), np.empty(4)
        mujoco.mju_mulQuat(quaternion, turn, standing)
        x_mm, y_mm = (low if low == high else draw(low, high) for low, high in self.scene.start_mm)
        self._qpos[0:3] = (x_mm / 1000, y_mm / 1000, height_m)
        self._qpos[3:7] = quaternion
        if self.scene.wall_distance_mm is not None:
            distance_m = draw(*self.scene.wall_distance_mm) / 1000
            wall = self.model.geom("wall")
            sonar_m = self._base.in_world(next(iter(self._sonars.values()))[0])
            self._qpos[0] = wall.pos[0] - wall.size[0] - distance_m - sonar_m[0]
            self._qpos[1] = -sonar_m[1]

    def _stand(self) -> tuple[Vector, float]:
        """Orientation and height of the standing robot: constant on wheels, derived from the present leg angles on legs."""
        if self._feet is None:
            return self._standing_quaternion, self._standing_height_m
        model, data = self.model, self.data
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        chassis = int(model.jnt_bodyid[0])
        frame, origin = data.xmat[chassis].reshape(3, 3), data.xpos[chassis]
        points_m, centre_m = self._feet.points_m(data) - origin, data.subtree_com[chassis] - origin
        quaternion, height_m = standing_pose(points_m @ frame, centre_m @ frame)
        return quaternion, height_m + self._feet.radius_m

    def _take_up_backlash(self) -> None:
        """Move each joint to the end of its backlash to which gravity pulls it, so that no arm drops at a start."""
        mujoco.mj_forward(self.model, self.data)
        for joint in self._backlash:
            pull_nm = -float(self.data.qfrc_bias[self.model.jnt_dofadr[joint]])
            end = np.sign(pull_nm) if abs(pull_nm) > _MIN_PULL_NM else 0.0
            self._qpos[self.model.jnt_qposadr[joint]] = end * self.model.jnt_range[joint, 1]

    def pose(self) -> Pose:
        """True pose of the robot: for metrics, not for agents."""
        self._update_turns()
        x_m, y_m, _ = self._base.position().tolist()
        return Pose(x_m, y_m, self._turns.heading_deg)

    def update_visuals(self) -> None:
        """Update the drawn geometry to the joint positions, for renderers; physics steps do not."""
        mujoco.mj_kinematics(self.model, self.data)
        self._spinners.turn(self.model, self.data)
        self._rods.turn(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    # ---------------------------------------------------------------- time

    def advance_to(self, time_ms: int) -> None:
        """Integrate whole steps up to this simulated time."""
        remaining = time_ms * 2 // 5 - self._steps
        while remaining > 0:
            steps = remaining if remaining <= _STEPS_PER_UPDATE else _STEPS_PER_UPDATE
            mujoco.mj_step(self.model, self.data, steps)
            remaining -= steps
            self._steps += steps
            self._steps_since_update += steps
            if self._steps_since_update >= _STEPS_PER_UPDATE:
                self._update_turns()

    def _update_turns(self) -> None:
        self._steps_since_update = 0
        self._turns.update(self._base.orientation())

    # ---------------------------------------------------------------- motors

    def angle_mdeg(self, port: str) -> int:
        """Angle of a motor's shaft in whole steps of its rotation sensor, clockwise positive."""
        address, mdeg = self._shaft[port]
        step = self._encoder_step_mdeg
        angle: float = self._joint_positions[address]
        return math.floor(angle * mdeg / step + 0.5) * step

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        """Apply a voltage, at most the battery's; 0 shorts the motor (brake), ``None`` opens the circuit (coast)."""
        actuator, circuit = self._terminals[port]
        if (voltage_mv is None) is not bool(self._open_circuits & circuit):
            self._open_circuits ^= circuit
            self.model.opt.disableactuator = self._open_circuits
        if voltage_mv is not None:
            limit = self.battery_mv
            voltage_mv = limit if voltage_mv > limit else -limit if voltage_mv < -limit else voltage_mv
            self._voltages_v[actuator] = voltage_mv * 0.001

    # ---------------------------------------------------------------- sensors

    def distance_mm(self, port: str) -> int:
        """Distance to the nearest obstacle or robot that one of five rays in a cone of 24 degrees hits, with noise; 40..2000."""
        position, rays = self._sonars[port]
        origin = self._base.in_world(position) + self._base.position()
        nearest_mm = math.inf
        for ray in rays:
            direction = self._base.in_world(ray)
            distance_m = mujoco.mj_ray(
                self.model, self.data, origin, direction, self._detected_groups, True, self._undetected_body, None
            )
            if distance_m >= 0.0:
                nearest_mm = min(nearest_mm, distance_m * 1000.0)
        if nearest_mm >= _FARTHEST_MM:
            return _FARTHEST_MM
        deviation_mm = self.physics.distance_noise_mm + self.physics.distance_noise_ratio * nearest_mm
        reading_mm = round(nearest_mm + deviation_mm * self._noise.standard_normal())
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
        eye, gaze = self._base.in_world(position) + self._base.position(), self._base.in_world(frame[:, 0].copy())
        if sense is Sense.DISTANCE:
            return percent(self._world.distance_mm(eye, gaze), body_of(self._sensor_kinds[port]).infrared_mm)
        if sense is Sense.AMBIENT:
            return self._world.ambient(eye, gaze)
        hue, saturation, value = self._world.surface(eye, gaze)
        noise_pct = self.physics.color_noise_pct * self._noise.standard_normal()
        return hue, saturation, min(max(value + noise_pct, 0.0), 100.0)

    def tilt_deg(self) -> tuple[float, float]:
        """Pitch (nose down positive) and roll (right side down positive) from the direction of "up" in the hub's frame.

        As in the firmware, this is the fused orientation, which accelerations do not disturb.
        """
        up_x, up_y, up_z = self._base.up(self._up).tolist()
        pitch_deg = math.degrees(math.atan2(-up_x, math.hypot(up_y, up_z)))
        roll_deg = math.degrees(math.atan2(up_y, up_z))
        noise_pitch, noise_roll = (self.physics.tilt_noise_deg * self._noise.standard_normal(2)).tolist()
        return pitch_deg + noise_pitch, roll_deg + noise_roll

    def angular_velocity_deg_s(self) -> tuple[float, float, float]:
        """Gyroscope in the frame of the hub, with noise; counter-clockwise about each axis is positive."""
        noise = self.physics.gyro_noise_deg_s * self._noise.standard_normal(3)
        x, y, z = (np.degrees(self._base.angular_velocity()) + noise).tolist()
        return x, y, z

    def acceleration_mm_s2(self) -> tuple[float, float, float]:
        """Accelerometer in the frame of the hub, with noise; at rest (0, 0, +9810)."""
        noise = self.physics.acceleration_noise_mm_s2 * self._noise.standard_normal(3)
        x, y, z = (self._base.specific_force() * 1000.0 + noise).tolist()
        return x, y, z

    def heading_deg(self) -> float:
        """Rotation about the vertical since the start, clockwise positive, not wrapped."""
        self._update_turns()
        return self._turns.heading_deg - self._heading_at_start_deg

    def rotation_deg(self) -> tuple[float, float, float]:
        """Angular velocity in the frame of the hub, summed up since the start, without noise."""
        self._update_turns()
        x, y, z = np.degrees(self._base.in_hub(self._turns.rotation_rad)).tolist()
        return x, y, z
